"""Settings of the connection to the broker, and brokers that misbehave."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from robotouille.errors import RobotouilleError
from robotouille_server import ServerSettings
from robotouille_server.mqtt.broker import BrokerAddress, server_name
from robotouille_server.mqtt.service import on_broker
from robotouille_server.runtime.workers import WorkerSlot
from tests.mqtt.lying import CONNACK
from tests.support.operator import table
from tests.support.samples import quick_sample
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


def test_each_worker_has_its_own_name() -> None:
    settings = ServerSettings(mqtt_name="lab")
    assert server_name(settings, WorkerSlot(), 8765) == "lab"
    assert server_name(settings, WorkerSlot(index=1, count=2), 8765) == "lab-w1"
    assert server_name(ServerSettings(), WorkerSlot(), 8765).endswith("-8765")


@pytest.mark.parametrize("name", ["a/b", "+", "a#", "a b", "$SYS", "x" * 65])
def test_names_that_are_invalid_in_topics_are_refused(name: str) -> None:
    with pytest.raises(RobotouilleError, match="--mqtt-name"):
        server_name(ServerSettings(mqtt_name=name), WorkerSlot(), 8765)


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
    quick_sample(
        [
            (CONNACK + b"\x00\xff" * 10, 1.0),
            (CONNACK, None),
            (REFUSED, 1.0),
            (REFUSED, None),
            (b"HTTP/1.1 400 Bad Request\r\n\r\n", 1.0),
            (CONNACK, 1.0),
            (b"", 1.0),
            (b"", None),
        ],
        3,
    ),
    ids=["nonsense", "stalls", "refuses", "refuses-open", "http", "connack", "closes", "silent"],
)
@virtual
async def test_episodes_continue_with_a_bad_broker_and_sockets_are_closed(
    tmp_path: Path, answer: bytes, closes_after: float | None
) -> None:
    broker = BadBroker(answer, closes_after)
    async with broker.listening() as url:
        async with serving(tmp_path, mqtt=url, mqtt_name="lab") as server:
            async with on_broker(server), table(server, step_rate=2.0) as play:
                await play.until(lambda game: game.step >= 120)
                assert 5 <= broker.accepted <= 20
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
