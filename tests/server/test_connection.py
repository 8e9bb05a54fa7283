"""Connections: limits on frames other than messages, and fairness between clients."""

from __future__ import annotations

import asyncio
import itertools
import json
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from robotouille_server import Server
from robotouille_server.runtime.budgets import MAX_GREETINGS
from robotouille_server.transport.connection import (
    FRAMES_BURST,
    MAX_EXCESS,
    MAX_GREETING,
    MAX_OWN,
    MAX_REQUEST,
    MAX_UNSENT,
    SECONDS_AT_A_TIME,
    Connection,
)
from robotouille_server.transport.loop_budget import LOOP_BUDGET
from tests.support.fuzzing.wire import (
    CONTINUATION,
    PING,
    PONG,
    TEXT,
    Closed,
    Wire,
    frame,
    request,
)
from tests.support.metrics import dropped
from tests.support.servers import raw, serving
from tests.support.virtual_time import virtual

HELLO = json.dumps({"type": "hello", "protocol": 1, "name": "eve", "ref": 1}).encode()
LIST = json.dumps({"type": "list", "ref": 2}).encode()


@asynccontextmanager
async def wired(folder: Path, *, hello: bool = True) -> AsyncIterator[tuple[Server, Wire]]:
    async with serving(folder) as server:
        wire = await Wire.open(server.port)
        assert await wire.upgrade(text=True) == 101
        if hello:
            await wire.ask({"type": "hello", "protocol": 1, "name": "eve"}, 1)
        yield server, wire
        wire.cut()


async def is_cut(wire: Wire) -> bool:
    """Return whether the server closes the connection without a message."""
    try:
        async with asyncio.timeout(5):
            while True:
                async for _ in wire.messages():
                    pass
    except Closed as closed:
        return closed.code is None
    except TimeoutError:
        return False


@pytest.mark.parametrize("hello", [True, False], ids=["after hello", "before hello"])
@pytest.mark.parametrize("opcode", [PING, PONG])
@virtual
async def test_flood_of_control_frames_is_cut_off(tmp_path: Path, opcode: int, hello: bool) -> None:
    async with wired(tmp_path, hello=hello) as (server, wire):
        await wire.write(frame(b"", opcode) * int(FRAMES_BURST + MAX_EXCESS + 2))
        assert await is_cut(wire)
        assert dropped(server.metrics, "flood") == 1


@virtual
async def test_usual_pings_are_answered(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as client:
        for number in range(100):
            waiter = await client.socket.ping(f"{number}")
            await asyncio.wait_for(waiter, 1)
            await asyncio.sleep(0.1)


@virtual
async def test_client_that_does_not_read_gets_no_pongs(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as client:
        (connection,) = server.connections.open
        unsent, sent = MAX_UNSENT + 1, []
        transport = connection.transport
        connection.transport = _Full(transport, lambda: unsent, sent)
        client.socket.transport.write(frame(b"1", PING))
        await asyncio.sleep(0.1)
        assert sent == []
        unsent = 0
        client.socket.transport.write(frame(b"2", PING))
        await asyncio.sleep(0.1)
        assert sent == [b"\x8a\x012"]


class _Full:
    """Transport with a given amount of unsent data, which records writes."""

    def __init__(self, transport: object, unsent: object, sent: list[bytes]) -> None:
        self._transport, self.get_write_buffer_size = transport, unsent
        self._sent = sent

    def write(self, data: bytes) -> None:
        self._sent.append(bytes(data))

    def __getattr__(self, name: str) -> object:
        return getattr(self._transport, name)


@virtual
async def test_message_in_too_many_fragments_is_cut_off(tmp_path: Path) -> None:
    parts = frame(b"", CONTINUATION, fin=False) * int(FRAMES_BURST)
    message = frame(b"", TEXT, fin=False) + parts + frame(LIST, CONTINUATION)
    async with wired(tmp_path) as (server, wire):
        await wire.write(message)
        assert await is_cut(wire)
        assert dropped(server.metrics, "flood") == 1


@virtual
async def test_slow_fragments_are_limited_too(tmp_path: Path) -> None:
    """A slow client stays within the rate of frames."""
    async with wired(tmp_path) as (server, wire):
        await wire.write(frame(b"", TEXT, fin=False))
        try:
            for _ in range(200):
                await wire.write(frame(b"", CONTINUATION, fin=False) * 20)
                await asyncio.sleep(0.5)
        except Closed:
            pass
        assert dropped(server.metrics, "flood") == 1


@virtual
async def test_large_fragments_cost_more(tmp_path: Path) -> None:
    part = frame(b" " * 60_000, CONTINUATION, fin=False)
    again = frame(b" " * 60_000, TEXT, fin=False) + part + frame(b"", CONTINUATION)
    async with wired(tmp_path) as (_server, wire):
        await wire.write(again * 2)
        assert await is_cut(wire)


@virtual
async def test_fragmented_message_is_read(tmp_path: Path) -> None:
    async with wired(tmp_path) as (_, wire):
        pieces = [bytes([byte]) for byte in LIST]
        first, *middle, last = pieces
        await wire.write(
            frame(first, TEXT, fin=False)
            + frame(b"", PING)
            + b"".join(frame(piece, CONTINUATION, fin=False) for piece in middle)
            + frame(last, CONTINUATION)
        )
        async for answer in wire.messages():
            assert answer["type"] == "episodes"
            break


@pytest.mark.parametrize("size", [1, 2, 3, 5, 7, 100, 1000])
@virtual
async def test_request_and_first_frames_may_be_split_anywhere(tmp_path: Path, size: int) -> None:
    """Even together, or where a frame ends like a request."""
    tricky = json.dumps({"type": "say", "text": "x"}).encode()[:-2] + b'y"}'
    mask = b"\r\n\r\n"
    masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(LIST))
    odd = bytes([0x81, 0x80 | len(LIST)]) + mask + masked
    stream = request("robotouille.v1.json") + frame(HELLO) + odd + frame(tricky) + odd
    async with serving(tmp_path) as server:
        wire = await Wire.open(server.port)
        for at in range(0, len(stream), size):
            await wire.write(stream[at : at + size])
            if size < 10 and at % (40 * size) == 0:
                await asyncio.sleep(0.001)
        await wire.response()
        kinds = []
        async for answer in wire.messages():
            kinds.append(answer["type"])
            if len(kinds) == 4:
                break
        assert kinds == ["welcome", "episodes", "error", "episodes"]
        wire.cut()


@virtual
async def test_request_without_end_is_bounded(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        wire = await Wire.open(server.port)
        await wire.write(request()[:-2] + b"X-More: x\r\n" * (MAX_REQUEST // 10))
        with pytest.raises(Closed):
            await wire.response()
        wire.cut()
        assert dropped(server.metrics, "early") == 1


@virtual
async def test_long_request_is_refused_although_it_ends(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        wire = await Wire.open(server.port)
        await wire.write(request()[:-2] + b"X-More: x\r\n" * (MAX_REQUEST // 10) + b"\r\n")
        with pytest.raises(Closed):
            await wire.response()
        wire.cut()
        assert dropped(server.metrics, "early") == 1


@virtual
async def test_invalid_frames_close_with_the_right_status(tmp_path: Path) -> None:
    cases = {
        1002: [frame(LIST, masked=False), frame(LIST, 3), frame(LIST, reserved=4)],
        1007: [frame(b"\xff\xfe", TEXT)],
        1009: [frame(b"x" * 5, TEXT, claimed=MAX_OWN + 1), frame(b"", TEXT, claimed=2**62)],
    }
    async with serving(tmp_path) as server:
        for status, wrong in cases.items():
            for one in wrong:
                wire = await Wire.open(server.port)
                await wire.upgrade(text=True)
                await wire.write(frame(HELLO) + one + frame(LIST))
                with pytest.raises(Closed) as closed:
                    async for answer in wire.messages():
                        assert answer["type"] == "welcome", answer
                assert closed.value.code == status
                wire.cut()


@pytest.mark.parametrize("fragmented", [False, True])
@virtual
async def test_server_buffers_no_long_message_before_welcome(
    tmp_path: Path, fragmented: bool
) -> None:
    content = b"x" * (MAX_GREETING + 1)
    start = frame(content[:-1], fin=False) + frame(b"x", CONTINUATION, fin=False)
    if not fragmented:
        start = frame(b"", claimed=len(content))
    async with wired(tmp_path, hello=False) as (_, wire):
        await wire.write(start)
        with pytest.raises(Closed) as closed:
            async with asyncio.timeout(1):
                async for answer in wire.messages():
                    raise AssertionError(answer)
        assert closed.value.code == 1009


@virtual
async def test_long_message_may_follow_hello_at_once(tmp_path: Path) -> None:
    long = {"type": "create", "ref": 3, "task": "x" * (2 * MAX_GREETING)}
    async with wired(tmp_path, hello=False) as (_, wire):
        await wire.write(frame(HELLO) + frame(json.dumps(long).encode()))
        answers = wire.messages()
        assert (await anext(answers))["type"] == "welcome"
        assert (await anext(answers))["code"] == "message/invalid-field"


async def welcomed(port: int) -> Wire:
    """Return a connection that has been welcomed."""
    wire = await Wire.open(port)
    await wire.upgrade(text=True)
    await wire.write(frame(HELLO))
    assert (await anext(wire.messages()))["type"] == "welcome"
    return wire


@virtual
async def test_client_with_many_frames_gives_way_to_others(tmp_path: Path) -> None:
    order: list[str] = []
    async with serving(tmp_path) as server:
        wires = [await welcomed(server.port) for _ in range(2)]
        hand_over = Connection._hand_over

        def noted(self: Connection, content: bytes, is_text: bool) -> None:
            order.append(str(self.remote_address))
            hand_over(self, content, is_text)

        many = b"".join(frame(struct.pack("B", 32) + LIST) for _ in range(100))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Connection, "_hand_over", noted)
            for wire in wires:
                wire._writer.write(many)
            await asyncio.sleep(0.1)
        assert len(order) == 200
        changes = sum(a != b for a, b in itertools.pairwise(order))
        assert changes >= 4, "one was served whole before the other"
        for wire in wires:
            wire.cut()


@virtual
async def test_endless_request_is_cut_off(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        wire = await Wire.open(server.port)
        head = request().removesuffix(b"\r\n")
        with pytest.raises(Closed):
            for number in range(100):
                await wire.write(head if number == 0 else b"X: " + b"y" * 1000 + b"\r\n")
                await asyncio.sleep(0.01)
            await wire.response()
        assert dropped(server.metrics, "early") == 1
        wire.cut()


@virtual
async def test_all_clients_share_the_budget_of_a_turn(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        wires = [await welcomed(server.port) for _ in range(20)]
        turn, handled = 0, []
        hand_over = Connection._hand_over

        def noted(self: Connection, content: bytes, is_text: bool) -> None:
            handled.append(turn)
            hand_over(self, content, is_text)

        async def count() -> None:
            nonlocal turn
            while True:
                turn += 1
                await asyncio.sleep(0)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Connection, "_hand_over", noted)
            counting = asyncio.create_task(count())
            for wire in wires:
                wire._writer.write(frame(LIST) * 30)
            while len(handled) < 600:
                await asyncio.sleep(0)
            counting.cancel()
        most = max(handled.count(number) for number in set(handled))
        assert most <= LOOP_BUDGET
        for wire in wires:
            wire.cut()


@virtual
async def test_clients_take_turns_though_their_messages_take_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with serving(tmp_path) as server:
        slow, quick = [await welcomed(server.port) for _ in range(2)]
        loop, late, handled = asyncio.get_running_loop(), [0.0], []
        now, hand_over = loop.time, Connection._hand_over

        def noted(self: Connection, content: bytes, is_text: bool) -> None:
            handled.append(len(content))
            late[0] += SECONDS_AT_A_TIME
            hand_over(self, content, is_text)

        monkeypatch.setattr(loop, "time", lambda: now() + late[0])
        monkeypatch.setattr(Connection, "_hand_over", noted)
        slow._writer.write(frame(b"{}") * 30)
        quick._writer.write(frame(b"{ }"))
        while len(handled) < 31:
            await asyncio.sleep(0)
        assert handled.index(len(b"{ }")) <= 2
        for wire in (slow, quick):
            wire.cut()


@virtual
async def test_few_messages_are_read_before_welcome(tmp_path: Path) -> None:
    async with serving(tmp_path) as server:
        wire = await Wire.open(server.port)
        await wire.upgrade(text=True)
        wrong = HELLO.replace(b'"protocol": 1', b'"protocol": 99')
        await wire.write(frame(wrong) * (MAX_GREETINGS + 1) + frame(HELLO))
        answers = []
        with pytest.raises(Closed) as closed:
            async for answer in wire.messages():
                answers.append(answer["code"])
        assert answers == ["protocol/version"] * MAX_GREETINGS + ["rate/limited"]
        assert closed.value.code == 1008
        wire.cut()
