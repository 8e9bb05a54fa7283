"""What a message costs follows what it takes to read and to answer it."""

from __future__ import annotations

import asyncio
import json
import tracemalloc
from pathlib import Path
from typing import Any

import msgpack
import pytest

from robotouille import ProtocolError
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON, MAX_FIELDS, MAX_ITEMS, MAX_LIST, MSGPACK, SUBPROTOCOLS
from robotouille_server import Server
from robotouille_server.conversation.message_budget import COSTS, MAX_HELLO_BYTES
from robotouille_server.rooms.broadcast.snapshots import Snapshots
from robotouille_server.runtime.token_bucket import TokenBucket
from tests.support.fuzzing.wire import TEXT, Closed, Wire, frame
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run

WATCH = {"type": "join", "role": "spectator"}
RESYNC = frame(b'{"type": "resync"}', TEXT)


async def kitchen(client: Raw) -> str:
    created = await client.ask({"type": "create", "task": "multi_agent/01"}, "created")
    return str(created["code"])


async def watcher(server: Server, code: str) -> Wire:
    wire = await Wire.open(server.port)
    await wire.upgrade(text=True)
    await wire.ask({"type": "hello", "protocol": 1, "name": "eve"}, 1)
    await wire.ask({**WATCH, "episode": code}, 2)
    return wire


async def answers(wire: Wire, seconds: float = 0.2) -> list[dict[str, Any]]:
    """All that comes for a while."""
    found = []
    try:
        async with asyncio.timeout(seconds):
            async for answer in wire.messages():
                found.append(answer)
    except (TimeoutError, Closed):
        pass
    return found


def test_many_resyncs_at_once_are_answered_by_few_snapshots(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as host:
            wire = await watcher(server, await kitchen(host))
            await answers(wire)
            await wire.write(RESYNC * 30)
            kinds = [answer["type"] for answer in await answers(wire)]
            assert 1 <= kinds.count("snapshot") <= 3
            wire.cut()

    run(main())


def test_snapshots_are_paid_for_by_their_size(tmp_path: Path) -> None:
    """One connection gets as many bytes of them as its budget has KiB, whenever it asks."""

    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as host:
            wire = await watcher(server, await kitchen(host))
            got = []
            for _ in range(100):
                await wire.write(RESYNC)
                got += await answers(wire, 0.001)
            sent = sum(len(json.dumps(a)) for a in got if a["type"] == "snapshot")
            prices = COSTS[messages.Resync] * 1024 * len(got)
            assert sent + prices < 2 * 450 * 1024
            assert any(answer.get("code") == "rate/limited" for answer in got)
            wire.cut()

    run(main())


def test_going_in_and_out_is_paid_for(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as host:
            code = await kitchen(host)
            wire = await watcher(server, code)
            leave = frame(b'{"type": "leave"}', TEXT)
            join = wire.encode({**WATCH, "episode": code})
            await wire.write((leave + join) * 90)
            kinds = [answer["type"] for answer in await answers(wire)]
            assert kinds.count("snapshot") < 40
            wire.cut()

    run(main())


def test_one_costly_message_is_dealt_with_in_a_turn(tmp_path: Path) -> None:
    """So that those who join, leave and list as fast as they can hold nobody up."""

    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as host:
            code = await kitchen(host)
            wire = await watcher(server, code)
            handled: list[int] = []
            turn = 0

            async def count() -> None:
                nonlocal turn
                while True:
                    turn += 1
                    await asyncio.sleep(0)

            infos = server.lobby.infos

            def noted(*request: Any, **who: Any) -> Any:
                handled.append(turn)
                return infos(*request, **who)

            server.lobby.infos = noted  # type: ignore[method-assign]
            counting = asyncio.create_task(count())
            await wire.write(frame(b'{"type": "list"}', TEXT) * 20)
            while len(handled) < 20:
                await asyncio.sleep(0)
            counting.cancel()
            assert len(set(handled)) == 20
            wire.cut()

    run(main())


def test_spectators_who_come_and_go_are_not_kept_without_end(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, max_spectators=5) as server, raw(server) as host:
            code = await kitchen(host)
            room = server.lobby.find(code)
            for _ in range(30):
                (await watcher(server, code)).cut()
                await asyncio.sleep(0.01)
            assert len(room.members) <= 6
            wire = await watcher(server, code)
            assert room.spectators == 1
            wire.cut()

    run(main())


def test_a_snapshot_is_encoded_once_a_step_for_all(tmp_path: Path) -> None:
    async def main() -> None:
        made = 0
        of_state = Snapshots._of_state

        def counted(self: Snapshots, codec: Any) -> Any:
            nonlocal made
            before = len(self._packed)
            fields = of_state(self, codec)
            made += len(self._packed) > before
            return fields

        async with serving(tmp_path) as server, raw(server) as host:
            code = await kitchen(host)
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(Snapshots, "_of_state", counted)
                wires = [await watcher(server, code) for _ in range(5)]
            assert made == 1
            for wire in wires:
                wire.cut()

    run(main())


@pytest.mark.parametrize("codec", [JSON, MSGPACK], ids=SUBPROTOCOLS[::-1])
@pytest.mark.parametrize("counts", [(1, 2), (16, 1), (9, 9), (20, 30)])
def test_joined_fields_are_the_message_of_all(codec: Any, counts: tuple[int, int]) -> None:
    parts = [{f"{i}-{j}": [j, "é"] for j in range(count)} for i, count in enumerate(counts)]
    joined = codec.join([codec.pack_fields(part) for part in parts])
    assert joined == codec.pack(parts[0] | parts[1])


def test_what_is_wrong_in_many_ways_is_refused_before_it_is_looked_into() -> None:
    many = {f"{i:x}": 0 for i in range(MAX_FIELDS)}
    long = {"type": "join", "episode": "x", "known": [0] * MAX_ITEMS}
    deep = {"type": "act", "seq": 1, "action": {"name": "x", "args": [{"a": list(range(99))}] * 9}}
    for wrong in ({"type": "hello", **many}, long, deep):
        for codec, payload in ((JSON, json.dumps(wrong)), (MSGPACK, msgpack.packb(wrong))):
            with pytest.raises(ProtocolError) as caught:
                codec.decode_client(payload)  # type: ignore[arg-type]
            assert caught.value.code == "message/malformed"
            limits = (MAX_FIELDS, MAX_ITEMS, MAX_LIST)
            assert any(str(limit) in str(caught.value) for limit in limits)


def test_memory_is_not_had_for_what_a_list_only_announces() -> None:
    """A thousand of these within each other took 40 ms, and are 3 kB."""
    tracemalloc.start()
    with pytest.raises(ProtocolError):
        MSGPACK.decode_client(b"\xdc\xff\xff" * 1000)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**20


def test_only_small_messages_are_read_before_hello(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server, hello=False) as client:
            long = {"type": "hello", "protocol": 1, "name": "x" * MAX_HELLO_BYTES}
            answer = await client.ask(long, "welcome")
            assert (answer["type"], answer["code"]) == ("error", "message/too-large")
            assert "before hello" in answer["message"]
            hello = {"type": "hello", "protocol": 1, "name": "ada", "token": "x" * 2000}
            assert (await client.ask(hello, "welcome"))["code"] == "auth/invalid"

    run(main())


def test_long_messages_are_taken_less_often_than_short_ones(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as client:
            long = {"type": "say", "text": "x" * 60_000}
            codes = []
            for _ in range(12):
                codes.append((await client.ask(long, "said"))["code"])
            assert codes[0] == "message/invalid-field"
            assert codes.index("rate/limited") <= 7

    run(main())


def test_what_is_owed_has_to_come_back_first() -> None:
    budget = TokenBucket(10, 0.0)
    budget.owe(0.0, 50)
    assert not budget.take(2.9)
    assert budget.take(3.2)
    budget.owe(3.2, 0)
    assert budget.left(100.0) == 20
