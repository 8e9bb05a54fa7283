"""Connections to brokers that misbehave leave nothing behind: in virtual time, by real sockets."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from tests.support.operator import table
from tests.support.servers import serving
from tests.support.virtual_time import run

pytest.importorskip("aiomqtt")

from robotouille_server.mqtt import on_broker

CONNACK = bytes([0x20, 3, 0, 0, 0])
REFUSED = bytes([0x20, 3, 0, 0x86, 0])
"""Bad user name or password."""


class BadBroker:
    """Answers to a connection with some bytes, and closes it after a while, if at all; `open` are
    those that nobody has closed."""

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
def test_games_go_on_and_nothing_is_left(
    tmp_path: Path, answer: bytes, closes_after: float | None
) -> None:
    async def main() -> None:
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

    run(main())


def test_a_server_starts_and_stops_without_a_broker(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, mqtt="mqtt://127.0.0.1:1") as server, on_broker(server):
            async with table(server) as play:
                await play.until(lambda game: game.step >= 10)

    run(main())
