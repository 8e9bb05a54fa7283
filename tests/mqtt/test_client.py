"""Brokers and senders of commands that try to overload the server."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import ssl
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import trustme
from paho.mqtt.client import Client as Paho
from paho.mqtt.client import MQTTMessage
from paho.mqtt.properties import Properties
from structlog.testing import capture_logs

from robotouille.protocol.messages import Create
from robotouille_server import Server
from robotouille_server.mqtt import client as client_module
from robotouille_server.mqtt.client import MAX_UNSENT_PACKETS, MAX_WAITING_COMMANDS, BoundedClient
from robotouille_server.mqtt.messages import MAX_PROPERTY_BYTES
from robotouille_server.mqtt.service import on_broker
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.transport import LoopBudget
from tests.mqtt.lying import CONNACK, PINGRESP, LyingBroker, packet, published, received, text
from tests.support.brokers import role_token
from tests.support.samples import quick_sample
from tests.support.servers import serving
from tests.support.virtual_time import virtual

TOO_LONG = bytes([0x30, 0xFF, 0xFF, 0xFF, 0x7F]) + b"\0\1t\0"
"""Beginning of a message of 256 MiB."""
LONG_PINGRESP = bytes([0xD0, 0xFF, 0xFF, 0x04])
"""Beginning of a packet of 80 KiB that has no content otherwise."""
EXACTLY_ONCE = packet(0x34, b"\0\1t\0\1\0" + bytes(100))
"""Message of QoS 2."""
FLOOD = 600 * PINGRESP
USER_PROPERTY = b"\x26\0\0\0\0"
RESPONSE_TOPIC = b"\x08" + text("robotouille/v1/lab/answers/me")


@asynccontextmanager
async def connected(folder: Path, url: str, **options: Any) -> AsyncIterator[Server]:
    async with serving(folder, mqtt=url, mqtt_name="lab", **options) as server:
        async with on_broker(server), asyncio.timeout(60):
            yield server


@pytest.mark.parametrize(
    ("lie", "more"),
    quick_sample(
        [
            (TOO_LONG, bytes(65_536)),
            (b"", FLOOD),
            (LONG_PINGRESP, bytes(65_536)),
            (b"", 600 * EXACTLY_ONCE),
            (b"", 600 * packet(0x30, b"")),
            (CONNACK, FLOOD),
            (packet(0xC0, b""), FLOOD),
        ],
        2,
    ),
    ids=["long", "rate", "long ping", "QoS 2", "invalid", "CONNACK", "PINGREQ"],
)
@virtual
async def test_broker_that_ignores_the_limits_is_cut_off(
    tmp_path: Path, lie: bytes, more: bytes
) -> None:
    broker = LyingBroker(lie, more)
    async with broker.listening() as url, connected(tmp_path, url):
        while len(broker.sent) < 3:
            await asyncio.sleep(0.1)
    assert max(broker.sent[:2]) < 4 * 1024 * 1024


@virtual
async def test_broker_that_sends_commands_and_reads_nothing_is_cut_off() -> None:
    client = bounded_client(Metrics())
    for _ in range(MAX_UNSENT_PACKETS + 2):
        client._client._send_puback(1)
    with pytest.raises(ConnectionAbortedError):
        client._check_head(CONNACK[0])


def bounded_client(metrics: Metrics) -> BoundedClient:
    """Return a client without a connection that accepts the token `yes`."""
    return BoundedClient(
        hostname="broker",
        metrics=metrics,
        budget=LoopBudget(asyncio.get_running_loop()),
        authorized=lambda payload: b"yes" in payload,
    )


@pytest.mark.parametrize(
    "properties",
    [
        USER_PROPERTY * (MAX_PROPERTY_BYTES // 5 + 1),
        b"\x08" + text("\ufeff"),
        2 * RESPONSE_TOPIC,
        b"\x7f",
        b"\x26\xff\xff",
    ],
    ids=["many", "byte order mark", "twice", "unknown", "too short"],
)
@virtual
async def test_command_with_bad_properties_is_acknowledged_and_dropped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, properties: bytes
) -> None:
    # Honest brokers forward such commands. If the server closed the connection, or did not
    # acknowledge them, the broker would send them again.
    longest = 0
    unpack = Properties.unpack

    def measured(self: Properties, buffer: bytes) -> Any:
        nonlocal longest
        longest = max(longest, len(buffer))
        return unpack(self, buffer)  # type: ignore[no-untyped-call]

    monkeypatch.setattr(Properties, "unpack", measured)
    broker = LyingBroker(b"")
    async with broker.listening() as url, connected(tmp_path, url) as server:
        listed = {"type": "list", "ref": "l", "token": role_token(server)}
        broker.lie = published(b"{}", properties, number=7) + published(
            json.dumps(listed).encode(), RESPONSE_TOPIC + 9 * USER_PROPERTY, number=8
        )
        while not any(b'"ref":"l"' in body for _, body in broker.packets):
            await asyncio.sleep(0.1)
        assert server.metrics.mqtt_dropped_commands == 1
    acknowledged = [
        int.from_bytes(body[:2], "big") for first, body in broker.packets if first == 64
    ]
    assert acknowledged == [7, 8]
    answers = [body for first, body in broker.packets if first == 0x32]
    assert text("robotouille/v1/lab/answers/me") in answers[0]
    assert len(broker.sent) == 1
    assert longest < 1000


async def test_other_tasks_get_a_turn_after_each_packet_of_shifted_tls_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Each record ends within a packet, so TLS has decrypted data pending after every packet.
    authority = trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert("127.0.0.1").configure_cert(tls)
    broker = LyingBroker(packet(0x40, b"\0\x09\0") + 4_000 * PINGRESP, tls=tls)
    turn, reads = 0, Counter[int]()
    loop_read = Paho.loop_read

    def counted(self: Paho) -> object:
        reads[turn] += 1
        return loop_read(self)

    async def take_turns() -> None:
        nonlocal turn
        while True:
            turn += 1
            await asyncio.sleep(0)

    monkeypatch.setattr(Paho, "loop_read", counted)
    monkeypatch.setattr(client_module, "PACKETS_A_SECOND", 1e9)
    async with broker.listening() as url:
        async with connected(tmp_path, url, mqtt_ca=tmp_path / "ca.pem"):
            turns = asyncio.create_task(take_turns())
            while sum(reads.values()) < 4_000:
                await asyncio.sleep(0)
            most = max(reads.values())
            turns.cancel()
    assert most <= 2


@pytest.mark.slow
@virtual
async def test_acknowledgements_of_a_long_queue_do_not_count_as_a_flood(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_module, "PACKETS_A_SECOND", 50.0)
    broker = LyingBroker(b"")
    async with broker.listening() as url, connected(tmp_path, url) as server:
        for _ in range(200):
            server.lobby.create(Create())
        while sum(first == 0x32 for first, _ in broker.packets) < 200:
            await asyncio.sleep(0.1)
    assert len(broker.sent) == 1


@virtual
async def test_commands_above_the_rate_are_acknowledged_and_dropped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client_module, "COMMANDS_READ_A_SECOND", 20.0)
    broker = LyingBroker(b"".join(published(b"{}", number=number) for number in range(1, 101)))
    async with broker.listening() as url, connected(tmp_path, url) as server:
        while sum(first == 0x40 for first, _ in broker.packets) < 100:
            await asyncio.sleep(0.1)
        assert server.metrics.mqtt_dropped_commands == 80
    assert len(broker.sent) == 1


@virtual
async def test_refused_subscription_is_logged_with_its_topic(tmp_path: Path) -> None:
    broker = LyingBroker(b"", granted=0x87)
    with capture_logs() as logs:
        async with broker.listening() as url, connected(tmp_path, url):
            while not broker.sent:
                await asyncio.sleep(0.1)
    (error,) = [log for log in logs if "refuses the subscription" in log["event"]]
    assert error["topic"] == "robotouille/v1/lab/commands"
    assert error["reason"] == "Not authorized"


@virtual
async def test_waiting_refused_commands_leave_room_for_valid_ones() -> None:
    metrics = Metrics()
    client = bounded_client(metrics)

    def receive(payload: bytes) -> None:
        message = MQTTMessage(topic=b"commands")
        message.payload = payload
        client._on_message(client._client, None, message)

    for _ in range(MAX_WAITING_COMMANDS):
        receive(b"no")
    assert client._queue.qsize() == metrics.mqtt_dropped_commands == MAX_WAITING_COMMANDS // 2
    for _ in range(MAX_WAITING_COMMANDS):
        receive(b"yes")
    assert client._queue.qsize() == metrics.mqtt_dropped_commands == MAX_WAITING_COMMANDS


@pytest.mark.parametrize("pauses", range(4))
@virtual
async def test_broker_that_lies_at_once_causes_no_error_of_the_event_loop(
    tmp_path: Path, pauses: int
) -> None:
    """The client reads one packet in a turn: it may be connecting or subscribing at the lie."""
    errors: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, error: errors.append(error))
    greeted = 0

    async def greet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal greeted
        with contextlib.suppress(ConnectionError):
            await reader.read(1000)
            writer.write(CONNACK + pauses * PINGRESP + EXACTLY_ONCE)
            greeted += 1
            while await reader.read(1000):
                pass
        writer.close()

    async with await asyncio.start_server(greet, "127.0.0.1", 0) as broker:
        port = broker.sockets[0].getsockname()[1]
        async with connected(tmp_path, f"mqtt://127.0.0.1:{port}"):
            while greeted < 3:
                await asyncio.sleep(0.1)
    gc.collect()
    await asyncio.sleep(0)
    assert errors == []


@virtual
async def test_broker_gets_no_more_messages_at_once_than_it_accepts(tmp_path: Path) -> None:
    """Such a broker closes the connection, and the next connection would send them again."""
    limit, most, acknowledged = 2, 0, 0

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal most, acknowledged
        await received(reader)
        writer.write(packet(0x20, b"\0\0\3\x21" + limit.to_bytes(2, "big")))
        _, subscribe = await received(reader)
        writer.write(packet(0x90, subscribe[:2] + b"\0\1"))
        waiting: list[bytes] = []
        with contextlib.suppress(asyncio.IncompleteReadError):
            while True:
                try:
                    async with asyncio.timeout(0.1):
                        first, body = await received(reader)
                except TimeoutError:
                    acknowledged += len(waiting)
                    for number in waiting:
                        writer.write(packet(0x40, number))
                    waiting.clear()
                    continue
                if first & 0xF6 == 0x32:
                    end = 2 + int.from_bytes(body[:2], "big")
                    waiting.append(body[end : end + 2])
                    most = max(most, len(waiting))
        writer.close()

    async with await asyncio.start_server(accept, "127.0.0.1", 0) as broker:
        port = broker.sockets[0].getsockname()[1]
        async with connected(tmp_path, f"mqtt://127.0.0.1:{port}") as server:
            for _ in range(10):
                server.lobby.create(Create())
            while acknowledged < 11:
                await asyncio.sleep(0.1)
    assert most == limit
