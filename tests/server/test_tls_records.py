"""TLS records pass the meter whole, in order, and few at a time."""

from __future__ import annotations

import asyncio
from asyncio.sslproto import SSLProtocol
from math import inf
from typing import Any, cast

from hypothesis import given
from hypothesis import strategies as st

from robotouille_server.transport.loop_budget import LOOP_BUDGET, LoopBudget
from robotouille_server.transport.tls_records import (
    BYTES_AT_A_TIME,
    HANDSHAKE,
    HANDSHAKE_COST,
    HEAD_BYTES,
    MAX_HANDSHAKE_BYTES,
    RECORD_COST,
    RECORDS_AT_A_TIME,
    RecordMeter,
)
from tests.support.virtual_time import run

DATA = 23


def record(content: int, kind: int = DATA) -> bytes:
    return bytes((kind, 3, 3)) + content.to_bytes(2, "big") + bytes(content)


class Socket(asyncio.Transport):
    """Transport of a socket whose client is the test."""

    def __init__(self) -> None:
        super().__init__()
        self.reading = self.closed = False
        self.protocol: Any = None

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        self.protocol = protocol

    def is_closing(self) -> bool:
        return self.closed

    def close(self) -> None:
        self.closed = True

    def abort(self) -> None:
        self.closed = True

    def pause_reading(self) -> None:
        self.reading = False

    def resume_reading(self) -> None:
        self.reading = True

    def receive(self, data: bytes) -> None:
        while data:
            buffer = self.protocol.get_buffer(-1)
            size = min(len(buffer), len(data))
            buffer[:size] = data[:size]
            self.protocol.buffer_updated(size)
            data = data[size:]


class TLS(asyncio.BufferedProtocol):
    """Protocol in place of TLS, which notes what it receives."""

    def __init__(self) -> None:
        self.received: list[bytes] = []
        self.at_end = self.lost = False
        self._buffer = bytearray(64 * 1024)

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        assert not self.at_end
        self.received.append(bytes(self._buffer[:nbytes]))

    def eof_received(self) -> None:
        self.at_end = True

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost = True


class StillClock:
    """Event loop whose time stands still, so that a slow machine does not begin a new turn."""

    def __init__(self) -> None:
        self.call_soon = asyncio.get_running_loop().call_soon

    def time(self) -> float:
        return 0.0


class Pair:
    """Meter between a socket and TLS, with the budget of a running event loop."""

    def __init__(self, **limits: float) -> None:
        self.budget = LoopBudget(cast("asyncio.AbstractEventLoop", StillClock()))
        self.socket, self.tls = Socket(), TLS()
        self.meter = RecordMeter(self.socket, self.budget, **limits)
        self.meter.set_protocol(self.tls)
        self.meter.resume_reading()

    @property
    def received(self) -> bytes:
        return b"".join(self.tls.received)


async def turns(count: int = 1) -> None:
    for _ in range(count):
        await asyncio.sleep(0)


@given(
    st.lists(st.tuples(st.integers(0, 17_000), st.sampled_from([DATA, HANDSHAKE])), max_size=40),
    st.lists(st.integers(1, 9_000), max_size=40),
    st.booleans(),
)
def test_records_arrive_whole_and_in_order(
    records: list[tuple[int, int]], cuts: list[int], pauses: bool
) -> None:
    stream = b"".join(record(size, kind) for size, kind in records)

    async def main() -> None:
        pair, rest = Pair(max_handshake=inf), stream
        for cut in [*cuts, len(stream)]:
            while not pair.socket.reading:
                await turns()
            if pauses:
                pair.meter.pause_reading()
                assert not pair.socket.reading
            pair.socket.receive(rest[:cut])
            rest = rest[cut:]
            if pauses:
                pair.meter.resume_reading()
        pair.socket.protocol.eof_received()
        await turns(500)
        assert pair.received == stream
        assert pair.tls.at_end
        assert pair.socket.closed

    run(main())


@given(st.binary(max_size=60_000))
def test_data_that_is_no_record_arrives_or_waits(data: bytes) -> None:
    async def main() -> None:
        pair = Pair()
        pair.socket.receive(data)
        await turns(500)
        assert data.startswith(pair.received)

    run(main())


async def test_turn_takes_few_records_of_a_connection() -> None:
    pair, tiny = Pair(), record(17)
    pair.socket.receive(tiny * 100)
    assert pair.received == tiny * RECORDS_AT_A_TIME
    assert not pair.socket.reading
    await turns()
    assert pair.received == tiny * 2 * RECORDS_AT_A_TIME
    await turns(10)
    assert pair.received == tiny * 100
    assert pair.socket.reading


async def test_turn_takes_few_handshakes_of_all_connections() -> None:
    hello = record(300, HANDSHAKE)
    pairs = [Pair() for _ in range(10)]
    for pair in pairs[1:]:
        pair.meter._budget = pairs[0].budget
    for pair in pairs:
        pair.socket.receive(hello)
    assert sum(pair.received == hello for pair in pairs) == LOOP_BUDGET / HANDSHAKE_COST
    await turns(10)
    assert all(pair.received == hello for pair in pairs)


async def test_client_waits_for_one_of_many_connections_of_another_address() -> None:
    """A stranger could otherwise delay every client by hundreds of connections."""
    flood, ada = [Pair() for _ in range(50)], Pair()
    for pair in (*flood, ada):
        pair.meter._budget = flood[0].budget
        pair.meter.group = "203.0.113.7"
    ada.meter.group = "203.0.113.8"
    for pair in (*flood, ada):
        pair.socket.receive(record(17) * RECORDS_AT_A_TIME * 2)
    assert not ada.received
    await turns()
    assert ada.received
    assert not flood[-1].received


async def test_records_are_charged_to_the_budget() -> None:
    pair = Pair()
    for _ in range(int(LOOP_BUDGET / RECORD_COST)):
        assert not pair.budget.over
        pair.socket.receive(record(17))
    assert pair.budget.over


async def test_nothing_is_read_while_the_client_does_not_read() -> None:
    """TLS answers some records itself, so the answers would fill the server's memory."""
    pair = Pair()
    pair.tls.pause_writing = lambda: None  # type: ignore[method-assign]
    pair.tls.resume_writing = lambda: None  # type: ignore[method-assign]
    pair.socket.protocol.pause_writing()
    assert not pair.socket.reading
    pair.socket.receive(record(17))
    await turns(3)
    assert not pair.received
    pair.socket.protocol.resume_writing()
    await turns(3)
    assert pair.received == record(17)
    assert pair.socket.reading


async def test_client_with_a_long_handshake_is_disconnected() -> None:
    pair = Pair()
    for size in (100, MAX_HANDSHAKE_BYTES - 200):
        pair.socket.receive(record(17) + record(size, HANDSHAKE))
        await turns(5)
        assert not pair.socket.closed
    before = pair.received
    pair.socket.receive(record(17) + record(200, HANDSHAKE))
    await turns(5)
    assert pair.socket.closed
    assert pair.received == before + record(17)


async def test_oversized_record_reaches_tls_which_rejects_it() -> None:
    pair = Pair()
    pair.socket.receive((bytes((DATA, 3, 3)) + b"\xff\xff").ljust(40_000, b"\0"))
    await turns(3)
    assert len(pair.received) > HEAD_BYTES


async def test_no_more_records_are_passed_on_than_tls_has_room_for() -> None:
    pair = Pair()
    stream = record(BYTES_AT_A_TIME - HEAD_BYTES - 1) + record(18 * 1024)
    pair.socket.receive(stream)
    await turns(5)
    assert pair.received == stream
    assert max(len(passed) for passed in pair.tls.received) <= SSLProtocol.max_size


async def test_lost_connection_drops_waiting_records() -> None:
    pair = Pair()
    pair.socket.receive(record(17) * 100)
    before = pair.received
    pair.socket.protocol.connection_lost(None)
    assert pair.tls.lost
    await turns(10)
    assert pair.received == before
