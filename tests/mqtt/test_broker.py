"""Settings of the connection to the broker, and brokers that misbehave."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiomqtt
import pytest

from robotouille.errors import RobotouilleError
from robotouille_server import ServerSettings
from robotouille_server.mqtt import broker as broker_module
from robotouille_server.mqtt.broker import (
    MAX_WAITING_BYTES,
    MAX_WAITING_COMMANDS,
    BrokerAddress,
    server_name,
)
from robotouille_server.mqtt.messages import MAX_PACKET_BYTES
from robotouille_server.mqtt.service import on_broker
from robotouille_server.runtime.workers import WorkerSlot
from tests.support.operator import table
from tests.support.servers import serving
from tests.support.virtual_time import virtual


def address(**settings: Any) -> BrokerAddress:
    return BrokerAddress.from_settings(ServerSettings(**settings))


@pytest.mark.parametrize(
    ("url", "host", "port", "user"),
    [
        ("mqtt://broker", "broker", 1883, None),
        ("mqtt://kit%40chen@10.0.0.1:2000/", "10.0.0.1", 2000, "kit@chen"),
        ("mqtt://[::1]", "::1", 1883, None),
        ("mqtts://broker", "broker", 8883, None),
    ],
)
def test_url_contains_host_port_and_user(url: str, host: str, port: int, user: str | None) -> None:
    found = address(mqtt=url)
    assert (found.host, found.port, found.user) == (host, port, user)
    assert (found.tls is not None) == url.startswith("mqtts")


@pytest.mark.parametrize(
    "url", ["broker:1883", "http://broker", "mqtt://", "mqtt://b/topic", "mqtt://b:x", "mqtt://b?a"]
)
def test_other_urls_are_refused(url: str) -> None:
    with pytest.raises(RobotouilleError, match="--mqtt"):
        address(mqtt=url)


@pytest.mark.parametrize("host", ["a..b", "a" * 64, "h h", "\ud800", "a" + "\u3002" * 2])
def test_invalid_host_names_are_refused(host: str) -> None:
    with pytest.raises(RobotouilleError, match="is not a host name"):
        address(mqtt=f"mqtt://{host}")


def test_error_about_a_password_in_the_url_hides_the_password() -> None:
    with pytest.raises(RobotouilleError, match="--mqtt-password-file") as refused:
        address(mqtt="mqtt://me:geheim@broker")
    assert "geheim" not in str(refused.value)


def test_password_file_must_be_private(tmp_path: Path) -> None:
    file = tmp_path / "password"
    file.write_text("geheim\n")
    file.chmod(0o600)
    found = address(mqtt="mqtt://me@broker", mqtt_password_file=file)
    assert found.password == "geheim"
    assert "geheim" not in repr(found) + str(found)
    file.chmod(0o644)
    with pytest.raises(RobotouilleError, match="chmod 600"):
        address(mqtt="mqtt://me@broker", mqtt_password_file=file)
    with pytest.raises(RobotouilleError, match="does not exist"):
        address(mqtt="mqtt://me@broker", mqtt_password_file=tmp_path / "none")


def test_password_can_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOTOUILLE_MQTT_PASSWORD", "geheim")
    assert address(mqtt="mqtt://me@broker").password == "geheim"


def test_error_names_an_unreadable_certificate_authority(tmp_path: Path) -> None:
    with pytest.raises(RobotouilleError, match=r"--mqtt-ca: .*none\.pem"):
        address(mqtt="mqtts://broker", mqtt_ca=tmp_path / "none.pem")


def test_each_worker_has_its_own_name() -> None:
    settings = ServerSettings(mqtt_name="lab")
    assert server_name(settings, WorkerSlot(), 8765) == "lab"
    assert server_name(settings, WorkerSlot(index=1, count=2), 8765) == "lab-w1"
    assert server_name(ServerSettings(), WorkerSlot(), 8765).endswith("-8765")


@pytest.mark.parametrize("name", ["a/b", "+", "a#", "a b", "$SYS", "x" * 65])
def test_names_that_are_invalid_in_topics_are_refused(name: str) -> None:
    with pytest.raises(RobotouilleError, match="--mqtt-name"):
        server_name(ServerSettings(mqtt_name=name), WorkerSlot(), 8765)


CONNACK = bytes([0x20, 3, 0, 0, 0])
REFUSED = bytes([0x20, 3, 0, 0x86, 0])
"""Bad user name or password."""


class BadBroker:
    """Broker that answers with some bytes and closes connections after a time, or never.

    `open` counts the connections that neither side has closed.
    """

    def __init__(self, answer: bytes, closes_after: float | None) -> None:
        self.answer = answer
        self.closes_after = closes_after
        self.accepted = self.open = 0

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.accepted += 1
        self.open += 1
        try:
            await reader.read(1)
            writer.write(self.answer)
            if self.closes_after is None:
                while await reader.read(1000):
                    pass
            else:
                await asyncio.sleep(self.closes_after)
        except ConnectionError:
            pass
        finally:
            self.open -= 1
            writer.close()

    @asynccontextmanager
    async def listening(self) -> AsyncIterator[str]:
        server = await asyncio.start_server(self.serve, "127.0.0.1", 0)
        async with server:
            yield f"mqtt://127.0.0.1:{server.sockets[0].getsockname()[1]}"


@pytest.mark.parametrize(
    ("answer", "closes_after"),
    [
        (b"", 1.0),
        (CONNACK, 1.0),
        (CONNACK + b"\x00\xff" * 10, 1.0),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", 1.0),
        (REFUSED, 1.0),
        (REFUSED, None),
        (b"", None),
        (CONNACK, None),
    ],
    ids=["closes", "connack", "nonsense", "http", "refuses", "refuses-open", "silent", "stalls"],
)
@virtual
async def test_episodes_continue_with_a_bad_broker_and_sockets_are_closed(
    tmp_path: Path, answer: bytes, closes_after: float | None
) -> None:
    broker = BadBroker(answer, closes_after)
    async with broker.listening() as url:
        async with serving(tmp_path, mqtt=url, mqtt_name="lab") as server:
            async with on_broker(server), table(server, step_rate=2.0) as play:
                await play.until(lambda game: game.step >= 240)
                assert 5 <= broker.accepted <= 40
                assert broker.open <= 1
                assert not server.metrics.mqtt_connected
                assert sum(server.metrics.lateness.counts[1:]) == 0
                tasks = asyncio.all_tasks()
        await asyncio.sleep(10)
        assert broker.open == 0
        assert len(tasks) < 30


@virtual
async def test_server_starts_and_stops_without_a_broker(tmp_path: Path) -> None:
    async with serving(tmp_path, mqtt="mqtt://127.0.0.1:1") as server, on_broker(server):
        async with table(server) as play:
            await play.until(lambda game: game.step >= 10)


def packet(first: int, body: bytes) -> bytes:
    """Return an MQTT packet with an honest length."""
    assert len(body) < 128
    return bytes([first, len(body)]) + body


async def received(reader: asyncio.StreamReader) -> tuple[int, bytes]:
    """Return the first byte and the body of the client's next packet."""
    first, length, shift = (await reader.readexactly(1))[0], 0, 0
    while (byte := (await reader.readexactly(1))[0]) >= 128:
        length, shift = length | (byte & 127) << shift, shift + 7
    return first, await reader.readexactly(length | byte << shift)


TOO_LONG = bytes([0x30, 0xFF, 0xFF, 0xFF, 0x7F]) + b"\0\1t\0"
"""Beginning of a message of 256 MiB."""
EXACTLY_ONCE = packet(0x34, b"\0\1t\0\1\0" + bytes(100))
"""Message of QoS 2."""


class LyingBroker:
    """Broker that works until the server is online, and then sends `lie` and `more` without end.

    `sent` counts the bytes of each connection after the lie.
    """

    def __init__(self, lie: bytes, more: bytes) -> None:
        self.lie = lie
        self.more = more
        self.sent: list[int] = []

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await received(reader)
            writer.write(CONNACK)
            _, subscribe = await received(reader)
            writer.write(packet(0x90, subscribe[:2] + b"\0\1"))
            _, presence = await received(reader)
            number = 2 + int.from_bytes(presence[:2], "big")
            writer.write(packet(0x40, presence[number : number + 2]))
            writer.write(self.lie)
            await self.pour(writer)
        except (ConnectionError, asyncio.IncompleteReadError):
            pass
        finally:
            writer.close()

    async def pour(self, writer: asyncio.StreamWriter) -> None:
        self.sent.append(0)
        while not writer.is_closing():
            writer.write(self.more)
            self.sent[-1] += len(self.more)
            await writer.drain()
            await asyncio.sleep(0.01)


@pytest.mark.parametrize(
    ("lie", "more"),
    [(TOO_LONG, bytes(65_536)), (b"", 600 * EXACTLY_ONCE)],
    ids=["too long", "QoS 2"],
)
@virtual
async def test_broker_that_ignores_the_limits_is_cut_off(
    tmp_path: Path, lie: bytes, more: bytes
) -> None:
    broker = LyingBroker(lie, more)
    listening = await asyncio.start_server(broker.serve, "127.0.0.1", 0)
    url = f"mqtt://127.0.0.1:{listening.sockets[0].getsockname()[1]}"
    async with listening, serving(tmp_path, mqtt=url, mqtt_name="lab") as server:
        async with on_broker(server), asyncio.timeout(60):
            while len(broker.sent) < 3:
                await asyncio.sleep(0.1)
        assert max(broker.sent[:2]) < 4 * 1024 * 1024


@virtual
async def test_waiting_commands_are_bounded_in_bytes() -> None:
    waiting = broker_module._CommandQueue(maxsize=MAX_WAITING_COMMANDS)
    command = aiomqtt.Message("commands", bytes(MAX_PACKET_BYTES), 1, False, 0, None)
    while not waiting.full():
        waiting.put_nowait(command)
    assert waiting.qsize() * MAX_PACKET_BYTES == MAX_WAITING_BYTES
    waiting.get_nowait()
    waiting.put_nowait(command)
    assert waiting.full()
