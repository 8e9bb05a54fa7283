"""NATS servers of `docker-compose.yml`, run as processes with their own files."""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import subprocess
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("nats", reason="needs the extra `cluster`")

import nats
from nats.errors import Error

from tests.support.compose import compose
from tests.support.nats import missing
from tests.support.scripts import script_module
from tests.support.sources import ROOT
from tests.support.worker_processes import lasting_ports

pytestmark = [
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(bool(missing()), reason=missing()),
    pytest.mark.skipif(not shutil.which("wget"), reason="wget is not installed"),
]

NAMES = ("nats1", "nats2", "nats3")
PORTS = (4222, 6222, 8222)
"""Ports of each container."""
SECONDS = 60
USER = "1000:1000" if os.geteuid() == 0 else f"{os.geteuid()}:{os.getegid()}"


class NatsLab:
    """Three NATS servers, each with the files and the command of its container."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        first = iter(range(lasting_ports(9), 32_768))
        self.ports = {name: {port: next(first) for port in PORTS} for name in NAMES}
        list(script_module(ROOT / "lab/make_secrets.py").make(folder, USER))
        self.content = compose()

    def secret(self, name: str) -> str:
        return (self.folder / "lab/secrets" / name).read_text()

    def start(self, name: str) -> subprocess.Popen[bytes]:
        service = self.content["services"][name]
        root = self.folder / "roots" / name
        for volume in service["volumes"]:
            source, inside, *_ = volume.split(":")
            if (ROOT / source).is_file():
                self._write(root / inside.strip("/"), name, (ROOT / source).read_text())
        for secret in service["secrets"]:
            self._write(root / "run/secrets" / secret, name, self.secret(secret))
        program, *words = [word.replace("/etc/", f"{root}/etc/") for word in service["command"]]
        found = shutil.which(program) or shutil.which(program, path="/usr/sbin")
        with (self.folder / f"{name}.log").open("ab") as log:
            return subprocess.Popen([str(found), *words], stdout=log, stderr=log)

    def _write(self, path: Path, name: str, text: str) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.here(name, text))

    def here(self, name: str, text: str) -> str:
        """Map the hosts, ports and folders in a container's text to local ones."""
        for host, ports in self.ports.items():
            for port, local in ports.items():
                text = text.replace(f"{host}:{port}", f"127.0.0.1:{local}")
        for port, local in self.ports[name].items():
            text = re.sub(rf"(0\.0\.0\.0|127\.0\.0\.1):{port}\b", f"127.0.0.1:{local}", text)
        text = text.replace("store_dir: /data", f"store_dir: {self.folder / 'lab/data' / name}")
        # NATS 2.9, which Debian has, does not know this option.
        return re.sub(r"^ *sync_interval: always$", "", text, flags=re.MULTILINE)

    def health(self, name: str) -> bool:
        kind, *words = self.content["services"][name]["healthcheck"]["test"]
        assert kind == "CMD"
        command = [self.here(name, word) for word in words]
        return subprocess.run(command, stderr=subprocess.DEVNULL, timeout=60).returncode == 0

    def url(self, name: str) -> str:
        return f"nats://127.0.0.1:{self.ports[name][4222]}"

    def logs(self) -> str:
        return "\n".join((self.folder / f"{name}.log").read_text() for name in NAMES)


async def eventually(find: Callable[[], Awaitable[bool]]) -> None:
    """Call a function until its result is true."""
    async with asyncio.timeout(SECONDS):
        while not await find():
            await asyncio.sleep(0.05)


@pytest.fixture
def running(tmp_path: Path) -> Iterator[NatsLab]:
    made = NatsLab(tmp_path)
    with ExitStack() as stack:
        for name in NAMES:
            process = stack.enter_context(made.start(name))
            stack.callback(process.kill)
        yield made
    print(made.logs())


async def test_servers_of_the_lab_form_a_cluster(running: NatsLab) -> None:
    for name in NAMES:
        await eventually(partial(asyncio.to_thread, running.health, name))
    password = running.secret("nats_server")
    urls = [running.url(name) for name in NAMES]
    client = await nats.connect(urls, user="server", password=password, allow_reconnect=False)
    try:
        stream = client.jetstream()

        async def replicated() -> bool:
            try:
                await stream.add_stream(name="log", subjects=["moves"], num_replicas=3)
                return (await stream.publish("moves", b"one")).seq >= 1
            except Error:
                return False

        await eventually(replicated)
    finally:
        await client.close()


async def test_servers_of_the_lab_require_the_password(running: NatsLab) -> None:
    await eventually(partial(asyncio.to_thread, running.health, "nats1"))
    server, route = running.secret("nats_server"), running.secret("nats_route")
    port = running.ports["nats1"][4222]
    assert await answer(port, user="server", **{"pass": server}) == b"PONG\r\n"
    for given in ({}, {"user": "server", "pass": route}, {"user": "route", "pass": route}):
        assert await answer(port, **given) == b"-ERR 'Authorization Violation'\r\n"


async def answer(port: int, **credentials: str) -> bytes:
    """Return the answer of a NATS server to credentials."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    options = {**credentials, "verbose": False, "pedantic": False}
    writer.write(f"CONNECT {json.dumps(options)}\r\nPING\r\n".encode())
    try:
        async with asyncio.timeout(SECONDS):
            assert (await reader.readline()).startswith(b"INFO ")
            return await reader.readline()
    finally:
        writer.close()
