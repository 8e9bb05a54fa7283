"""What comes on a connection beside messages is metered, and one client never holds up others."""

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
from robotouille_server.transport.admission import LOOP_BUDGET
from robotouille_server.transport.connection import (
    FRAMES_BURST,
    MAX_EXCESS,
    MAX_OWN,
    MAX_REQUEST,
    MAX_UNSENT,
    Connection,
)
from tests.support.fuzzing.wire import (
    BINARY,
    CONTINUATION,
    PING,
    PONG,
    TEXT,
    Closed,
    Wire,
    frame,
    request,
)
from tests.support.servers import raw, serving
from tests.support.virtual_time import run

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


def dropped(server: Server, reason: str) -> float:
    value = server.metrics.registry.get_sample_value(
        "robotouille_dropped_connections_total", {"reason": reason}
    )
    return value or 0.0


async def is_cut(wire: Wire) -> bool:
    """Whether the server ends the connection without a word."""
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
def test_a_flood_of_control_frames_is_cut_off(tmp_path: Path, opcode: int, hello: bool) -> None:
    async def main() -> None:
        async with wired(tmp_path, hello=hello) as (server, wire):
            await wire.write(frame(b"", opcode) * int(FRAMES_BURST + MAX_EXCESS + 2))
            assert await is_cut(wire)
            assert dropped(server, "flood") == 1

    run(main())


def test_pings_at_a_usual_rate_are_answered(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as client:
            for number in range(100):
                waiter = await client.socket.ping(f"{number}")
                await asyncio.wait_for(waiter, 1)
                await asyncio.sleep(0.1)

    run(main())


def test_pings_are_not_answered_to_those_who_do_not_read(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as client:
            (connection,) = server._open
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

    run(main())


class _Full:
    """A transport that says how much waits, and what is written to it."""

    def __init__(self, transport: object, unsent: object, sent: list[bytes]) -> None:
        self._transport, self.get_write_buffer_size = transport, unsent
        self._sent = sent

    def write(self, data: bytes) -> None:
        self._sent.append(bytes(data))

    def __getattr__(self, name: str) -> object:
        return getattr(self._transport, name)


def test_messages_in_many_parts_are_cut_off(tmp_path: Path) -> None:
    parts = frame(b"", CONTINUATION, fin=False) * int(FRAMES_BURST)
    message = frame(b"", TEXT, fin=False) + parts + frame(LIST, CONTINUATION)

    async def main() -> None:
        async with wired(tmp_path) as (server, wire):
            await wire.write(message)
            assert await is_cut(wire)
            assert dropped(server, "flood") == 1

    run(main())


def test_a_message_does_not_gather_parts_for_ever(tmp_path: Path) -> None:
    """Slowly enough they are within what a connection may send."""

    async def main() -> None:
        async with wired(tmp_path) as (server, wire):
            await wire.write(frame(b"", TEXT, fin=False))
            try:
                for _ in range(200):
                    await wire.write(frame(b"", CONTINUATION, fin=False) * 20)
                    await asyncio.sleep(0.5)
            except Closed:
                pass
            assert dropped(server, "flood") == 1

    run(main())


def test_large_parts_count_for_more_than_small_ones(tmp_path: Path) -> None:
    part = frame(b" " * 60_000, CONTINUATION, fin=False)
    again = frame(b" " * 60_000, TEXT, fin=False) + part + frame(b"", CONTINUATION)

    async def main() -> None:
        async with wired(tmp_path) as (_server, wire):
            await wire.write(again * 2)
            assert await is_cut(wire)

    run(main())


def test_a_message_in_some_parts_is_read(tmp_path: Path) -> None:
    async def main() -> None:
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

    run(main())


@pytest.mark.parametrize("size", [1, 2, 3, 5, 7, 100, 1000])
def test_the_request_and_the_first_frames_come_in_any_pieces(tmp_path: Path, size: int) -> None:
    """Together, too, and where a frame ends with what a request ends with."""
    tricky = json.dumps({"type": "say", "text": "x"}).encode()[:-2] + b'y"}'
    mask = b"\r\n\r\n"
    masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(LIST))
    odd = bytes([0x81, 0x80 | len(LIST)]) + mask + masked
    stream = request("robotouille.v1.json") + frame(HELLO) + odd + frame(tricky) + odd

    async def main() -> None:
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

    run(main())


def test_a_segment_that_ends_like_a_request_swallows_nothing(tmp_path: Path) -> None:
    """A frame was lost whose beginning came in a segment that ends in an empty line."""
    text = json.dumps({"type": "say", "text": "1\r\n\r\n2"}).encode().replace(b"\\r\\n", b"    ")
    payload = json.dumps({"type": "list", "ref": 5}).encode()
    padded = payload + b" \r\n\r\n" + b" " * 20

    async def main() -> None:
        async with wired(tmp_path) as (_, wire):
            whole = frame(padded)
            end = whole.index(b"\r\n\r\n") + 4
            await wire.write(whole[:end])
            await asyncio.sleep(0.01)
            await wire.write(whole[end:] + frame(text))
            async for answer in wire.messages():
                assert (answer["type"], answer["ref"]) == ("episodes", 5)
                break

    run(main())


def test_what_comes_before_the_handshake_is_over_is_bounded(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            wire = await Wire.open(server.port)
            early = frame(b"x" * 6_000, BINARY) * 3
            assert len(early) > MAX_REQUEST
            await wire.write(request() + early)
            with pytest.raises(Closed):
                while True:
                    await wire.response()
            wire.cut()
            assert dropped(server, "early") == 1

    run(main())


def test_frames_against_the_rules_are_answered_with_their_status(tmp_path: Path) -> None:
    cases = {
        1002: [frame(LIST, masked=False), frame(LIST, 3), frame(LIST, reserved=4)],
        1007: [frame(b"\xff\xfe", TEXT)],
        1009: [frame(b"x" * 5, TEXT, claimed=MAX_OWN + 1), frame(b"", TEXT, claimed=2**62)],
    }

    async def main() -> None:
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

    run(main())


def test_one_client_gives_way_to_others_after_some_frames(tmp_path: Path) -> None:
    """Two send much at once: the second is answered before the first is done."""

    async def main() -> None:
        order: list[str] = []
        async with serving(tmp_path) as server:
            wires = [await Wire.open(server.port) for _ in range(2)]
            for wire in wires:
                await wire.upgrade(text=True)
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

    run(main())


def test_a_request_without_end_is_cut_off(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            wire = await Wire.open(server.port)
            head = request().removesuffix(b"\r\n")
            with pytest.raises(Closed):
                for number in range(100):
                    await wire.write(head if number == 0 else b"X: " + b"y" * 1000 + b"\r\n")
                    await asyncio.sleep(0.01)
                await wire.response()
            assert dropped(server, "early") == 1
            wire.cut()

    run(main())


def test_all_together_have_so_much_of_a_turn(tmp_path: Path) -> None:
    """However many send at once, in between the loop looks at what else is due."""

    async def main() -> None:
        async with serving(tmp_path) as server:
            wires = [await Wire.open(server.port) for _ in range(20)]
            for wire in wires:
                await wire.upgrade(text=True)
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

    run(main())
