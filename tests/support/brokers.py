"""A broker in this process, which does what a test wants, and Mosquitto in a folder."""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from itertools import count
from pathlib import Path
from typing import Any, Literal, NamedTuple

from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.mqtt import on_broker
from robotouille_server.mqtt.connection import BrokerError, Connection, Received
from robotouille_server.mqtt.models import Answer
from tests.support.servers import serving

__all__ = [
    "FakeBroker",
    "Lab",
    "Mosquitto",
    "Publication",
    "missing",
    "mosquitto",
    "role_token",
    "told",
]

TIMEOUT = 5.0
"""Of a client whose broker does not answer."""


class Publication(NamedTuple):
    """What was published, with its quality of service."""

    topic: str
    content: dict[str, Any]
    qos: int
    retain: bool
    correlation: bytes | None


class FakeBroker:
    """Takes what is published; `gone` and `stalled` may be set at any time, by `break_off` too."""

    def __init__(self) -> None:
        self.gone = self.stalled = False
        self.attempts = 0
        self.published: list[Publication] = []
        self.subscribed: list[str] = []
        self._commands: asyncio.Queue[Received] = asyncio.Queue()
        self._cut = asyncio.Event()

    @asynccontextmanager
    async def connect(self) -> AsyncIterator[Connection]:
        """A connection, if it is there."""
        self.attempts += 1
        if self.gone:
            raise BrokerError("connection refused")
        self._cut = asyncio.Event()
        yield FakeConnection(self)

    def break_off(self, *, gone: bool = False) -> None:
        """Close the connection."""
        self.gone = gone
        self._cut.set()

    def command(self, content: Any, **received: Any) -> None:
        """Deliver a command."""
        payload = content if isinstance(content, bytes) else json.dumps(content).encode()
        self._commands.put_nowait(Received(payload, **received))

    def on(self, end: str) -> list[dict[str, Any]]:
        """What was published on topics that end so."""
        return [each.content for each in self.published if each.topic.endswith(end)]

    async def take(self, publication: Publication) -> None:
        if self.stalled:
            await asyncio.sleep(TIMEOUT)
            raise BrokerError("timed out")
        if self._cut.is_set():
            raise BrokerError("closed")
        self.published.append(publication)

    async def next_command(self) -> Received:
        command = asyncio.ensure_future(self._commands.get())
        cut = asyncio.ensure_future(self._cut.wait())
        try:
            await asyncio.wait({command, cut}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            cut.cancel()
            if not command.done():
                command.cancel()
        if not command.done():
            raise BrokerError("closed")
        return command.result()


class FakeConnection:
    """A connection to a `FakeBroker`."""

    def __init__(self, broker: FakeBroker) -> None:
        self._broker = broker

    async def subscribe(self, topic: str) -> None:
        self._broker.subscribed.append(topic)

    async def publish(
        self,
        topic: str,
        payload: bytes,
        *,
        qos: Literal[0, 1] = 1,
        retain: bool = False,
        correlation: bytes | None = None,
    ) -> None:
        content = json.loads(payload)
        await self._broker.take(Publication(topic, content, qos, retain, correlation))

    async def receive(self) -> Received:
        return await self._broker.next_command()


@asynccontextmanager
async def told(folder: Path, **options: Any) -> AsyncIterator[tuple[Server, FakeBroker]]:
    """A server called `lab`, and the broker that is told of it."""
    broker = FakeBroker()
    async with serving(folder, mqtt="mqtt://broker", mqtt_name="lab", **options) as server:
        async with on_broker(server, connect=broker.connect, rng=random.Random(1)):
            yield server, broker
            await server.stop()


def role_token(
    server: Server, role: Role = Role.OPERATOR, subject: str = "lab", **limits: Any
) -> str:
    """A token of this server, good for an hour."""
    return server.tokens.mint_role(role, subject, **{"seconds": 3600, **limits})


def missing() -> str:
    """Why there can be no Mosquitto here; empty if there can."""
    programs = ("mosquitto", "mosquitto_passwd")
    return "" if all(map(_program, programs)) else "Mosquitto is not installed"


def _program(name: str) -> str | None:
    return shutil.which(name) or shutil.which(name, path="/usr/sbin:/usr/local/sbin")


class Mosquitto:
    """The broker, on a port of its own: `start` and `stop` it as often as needed."""

    def __init__(
        self, folder: Path, users: dict[str, str], acl: str, options: Sequence[str]
    ) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port: int = free.getsockname()[1]
        self._process: subprocess.Popen[bytes] | None = None
        self._config = folder / "mosquitto.conf"
        lines = [f"listener {self.port} 127.0.0.1", *options]
        lines += ["set_tcp_nodelay true", "persistence false"]
        if users:
            lines += ["allow_anonymous false", f"password_file {folder / 'passwords'}"]
            self._add_users(folder / "passwords", users)
        else:
            lines.append("allow_anonymous true")
        if acl:
            (folder / "acl").write_text(acl)
            (folder / "acl").chmod(0o644)
            lines.append(f"acl_file {folder / 'acl'}")
        self._config.write_text("\n".join(lines) + "\n")

    def _add_users(self, file: Path, users: dict[str, str]) -> None:
        file.touch()
        for name, password in users.items():
            program = str(_program("mosquitto_passwd"))
            subprocess.run([program, "-b", str(file), name, password], check=True)
        file.chmod(0o644)  # Mosquitto gives up root.

    @property
    def url(self) -> str:
        return f"mqtt://127.0.0.1:{self.port}"

    def start(self) -> None:
        """It runs, and can be reached."""
        program = str(_program("mosquitto"))
        command = [program, "-c", str(self._config)]
        self._process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        until = time.monotonic() + 20
        while True:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port)):
                return
            assert time.monotonic() < until and self._process.poll() is None, "no broker"
            time.sleep(0.02)

    def send_signal(self, number: signal.Signals) -> None:
        """Stop it where it stands (SIGSTOP), or let it go on."""
        assert self._process is not None
        self._process.send_signal(number)

    def stop(self) -> None:
        """Kill it."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


@contextmanager
def mosquitto(
    folder: Path,
    users: dict[str, str] | None = None,
    acl: str = "",
    options: Sequence[str] = (),
) -> Iterator[Mosquitto]:
    """A Mosquitto that runs; with `users` (names and passwords) it asks for one. `options` are
    lines about its listener."""
    folder.mkdir(exist_ok=True)
    for above in (folder, *folder.parents):  # It reads its files as somebody else, if we are root.
        if above.stat().st_mode & 0o777 == 0o700:
            above.chmod(0o711)
    broker = Mosquitto(folder, users or {}, acl, options)
    broker.start()
    try:
        yield broker
    finally:
        broker.stop()


class Lab:
    """Sends commands to a server, and reads the answers."""

    def __init__(self, server: Server, broker: FakeBroker, role: Role = Role.OPERATOR) -> None:
        self.broker = broker
        self.token = role_token(server, role)
        self._refs = count(1)

    async def ask(self, kind: str, **fields: Any) -> Answer:
        content = {"type": kind, "ref": f"r{next(self._refs)}", "token": self.token, **fields}
        return await self.send({key: value for key, value in content.items() if value != ""})

    async def send(self, content: Any, **received: Any) -> Answer:
        before = len(self.broker.on("answers"))
        self.broker.command(content, **received)
        await asyncio.sleep(1)
        (answer,) = self.broker.on("answers")[before:]
        return Answer.model_validate(answer)

    async def refused(self, kind: str, **fields: Any) -> str:
        answer = await self.ask(kind, **fields)
        assert answer.error is not None
        assert not answer.ok
        return answer.error.code
