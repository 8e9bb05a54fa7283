"""A fake MQTT broker in this process, and a real Mosquitto in a folder."""

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
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import aiomqtt
from paho.mqtt.subscribeoptions import SubscribeOptions

from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.mqtt.broker import NameTakenError
from robotouille_server.mqtt.client import MQTT_RECEIVE_MAXIMUM, BoundedClient
from robotouille_server.mqtt.messages import CommandReply
from robotouille_server.mqtt.service import on_broker
from tests.support.servers import serving

__all__ = [
    "FakeBroker",
    "Lab",
    "Mosquitto",
    "Publication",
    "missing",
    "mosquitto",
    "role_token",
    "serving_with_broker",
]

TIMEOUT = 5.0
"""Client timeout in seconds."""


class Publication(NamedTuple):
    """A published message."""

    topic: str
    content: dict[str, Any]
    qos: int
    retain: bool
    correlation: bytes | None


class FakeBroker:
    """Broker that records publications; tests may set its failures at any time.

    Attributes:
        gone: No connection succeeds.
        stalled: No publication succeeds; each takes `TIMEOUT` to fail.
        breaks_at_steps: The connection breaks when steps are published.
    """

    def __init__(self) -> None:
        self.gone = self.stalled = self.breaks_at_steps = self.taken_over = False
        self.attempts = 0
        self.largest_packet = inf
        self.published: list[Publication] = []
        self.commands: asyncio.Queue[aiomqtt.Message] = asyncio.Queue()
        self.cut = asyncio.Event()

    @asynccontextmanager
    async def connect(self, owns_name: bool) -> AsyncIterator[BoundedClient]:
        """Yield a connection, or raise `MqttError` if the broker is gone."""
        self.attempts += 1
        if self.gone:
            raise aiomqtt.MqttError("connection refused")
        self.cut = asyncio.Event()
        try:
            yield cast("BoundedClient", FakeClient(self))
        finally:
            if owns_name and self.taken_over:
                raise NameTakenError

    def take_over(self) -> None:
        """Close the connection, because another server has connected with the same name."""
        self.taken_over = True
        self.cut.set()

    def break_off(self, *, gone: bool = False) -> None:
        """Close the connection."""
        self.gone = gone
        self.cut.set()

    def command(self, content: Any, *, retain: bool = False, **properties: Any) -> None:
        """Deliver a command, with MQTT 5 properties."""
        payload = content if isinstance(content, bytes) else json.dumps(content).encode()
        received: Any = SimpleNamespace(**properties)
        self.commands.put_nowait(aiomqtt.Message("commands", payload, 1, retain, 0, received))

    def on(self, end: str) -> list[dict[str, Any]]:
        """Return the messages published on topics that end with `end`."""
        return [each.content for each in self.published if each.topic.endswith(end)]


class FakeClient:
    """`BoundedClient` that is connected to a `FakeBroker`."""

    def __init__(self, broker: FakeBroker) -> None:
        self.largest_packet = broker.largest_packet
        self.receive_maximum = MQTT_RECEIVE_MAXIMUM
        self._broker = broker
        self._subscribed = False

    async def subscribe(self, topic: str, options: SubscribeOptions) -> tuple[int]:
        assert (topic, options.QoS) == ("robotouille/v1/lab/commands", 1)
        assert options.retainHandling == SubscribeOptions.RETAIN_DO_NOT_SEND
        self._subscribed = True
        return (1,)

    async def publish(
        self, topic: str, payload: bytes, qos: int, retain: bool = False, properties: Any = None
    ) -> None:
        if self._broker.stalled:
            await asyncio.sleep(TIMEOUT)
            raise aiomqtt.MqttError("timed out")
        if self._broker.breaks_at_steps and topic.endswith("steps"):
            self._broker.break_off()
        if self._broker.cut.is_set():
            raise aiomqtt.MqttError("closed")
        correlation = getattr(properties, "CorrelationData", None)
        publication = Publication(topic, json.loads(payload), qos, retain, correlation)
        self._broker.published.append(publication)

    @property
    async def messages(self) -> AsyncIterator[aiomqtt.Message]:
        cut = asyncio.ensure_future(self._broker.cut.wait())
        commands = self._broker.commands if self._subscribed else asyncio.Queue[Any]()
        command = asyncio.ensure_future(commands.get())
        try:
            while not cut.done():
                await asyncio.wait({command, cut}, return_when=asyncio.FIRST_COMPLETED)
                if command.done():
                    yield command.result()
                    command = asyncio.ensure_future(commands.get())
            raise aiomqtt.MqttError("closed")
        finally:
            cut.cancel()
            command.cancel()


@asynccontextmanager
async def serving_with_broker(
    folder: Path, **options: Any
) -> AsyncIterator[tuple[Server, FakeBroker]]:
    """Run a server called `lab` that publishes to a fake broker."""
    broker = FakeBroker()
    async with serving(folder, mqtt="mqtt://broker", mqtt_name="lab", **options) as server:
        async with on_broker(server, connect=broker.connect, rng=random.Random(1)):
            yield server, broker
            await server.stop()


def role_token(
    server: Server, role: Role = Role.OPERATOR, subject: str = "lab", **limits: Any
) -> str:
    """Return a role token of this server that is valid for an hour."""
    return server.tokens.mint_role(role, subject, **{"seconds": 3600, **limits})


def missing() -> str:
    """Return why Mosquitto is unavailable, or an empty string."""
    programs = ("mosquitto", "mosquitto_passwd")
    return "" if all(map(_program, programs)) else "Mosquitto is not installed"


def _program(name: str) -> str | None:
    return shutil.which(name) or shutil.which(name, path="/usr/sbin:/usr/local/sbin")


class Mosquitto:
    """Mosquitto process on a free port, which tests may start and stop repeatedly."""

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
        file.chmod(0o644)  # Mosquitto drops its root privileges.

    @property
    def url(self) -> str:
        return f"mqtt://127.0.0.1:{self.port}"

    def start(self) -> None:
        """Start the broker and wait until it accepts connections."""
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
        """Send a signal, such as SIGSTOP or SIGCONT."""
        assert self._process is not None
        self._process.send_signal(number)

    def stop(self) -> None:
        """Kill the process."""
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
    """Run Mosquitto. With `users` (names and passwords), it requires a password. `options` are
    lines for its listener.
    """
    folder.mkdir(exist_ok=True)
    for above in (folder, *folder.parents):  # Started by root, it reads files as another user.
        if above.stat().st_mode & 0o777 == 0o700:
            above.chmod(0o711)
    broker = Mosquitto(folder, users or {}, acl, options)
    broker.start()
    try:
        yield broker
    finally:
        broker.stop()


class Lab:
    """Laboratory client that sends commands to a server and reads the replies."""

    def __init__(self, server: Server, broker: FakeBroker, role: Role = Role.OPERATOR) -> None:
        self.broker = broker
        self.token = role_token(server, role)
        self._refs = count(1)

    async def ask(self, kind: str, **fields: Any) -> CommandReply:
        content = {"type": kind, "ref": f"r{next(self._refs)}", "token": self.token, **fields}
        return await self.send({key: value for key, value in content.items() if value != ""})

    async def send(self, content: Any, **received: Any) -> CommandReply:
        before = len(self.broker.on("answers"))
        self.broker.command(content, **received)
        await asyncio.sleep(1)
        (answer,) = self.broker.on("answers")[before:]
        return CommandReply.model_validate(answer)

    async def refused(self, kind: str, **fields: Any) -> str:
        answer = await self.ask(kind, **fields)
        assert answer.error is not None
        assert not answer.ok
        return answer.error.code
