"""Message budgets and the costs of messages."""

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
from robotouille.protocol.codec import JSON, MAX_FIELDS, MAX_ITEMS, MAX_LIST, MSGPACK
from robotouille_server import Server
from robotouille_server.runtime.budgets import (
    COSTS,
    KIB,
    MAX_HELLO_BYTES,
    FloodError,
    MessageBudget,
    TokenBucket,
    cost_of,
)
from tests.support.fuzzing.wire import TEXT, Closed, Wire, frame
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import virtual

RATE = 10.0
BURST = 2 * RATE


@pytest.fixture
def budget() -> MessageBudget:
    return MessageBudget(RATE, 0.0)


def affordable(budget: MessageBudget, now: float, size: int = 0, answered: int = 0) -> bool:
    return budget.charge(now, size, answered, greeted=True)


def test_budget_allows_bursts_and_a_rate(budget: MessageBudget) -> None:
    assert sum(affordable(budget, 0.0) for _ in range(50)) == BURST
    assert sum(affordable(budget, 1.0) for _ in range(50)) == RATE
    assert budget.exceeded == "more than 10 messages a second"


def test_long_messages_and_answers_cost_more(budget: MessageBudget) -> None:
    assert affordable(budget, 0.0, size=4 * KIB)
    assert not budget.take(0.0, BURST - 4)
    assert budget.take(0.0, BURST - 5)
    later = BURST / RATE
    assert affordable(budget, later, answered=round(BURST - 1) * KIB)
    assert not affordable(budget, later)


def test_only_short_refused_messages_are_parsed(budget: MessageBudget) -> None:
    budget.take(0.0, BURST)
    assert not affordable(budget, 0.0, size=MAX_HELLO_BYTES)
    with pytest.raises(ProtocolError, match="more than 10 messages"):
        affordable(budget, 0.0, size=MAX_HELLO_BYTES + 1)


def test_many_refused_messages_are_a_flood() -> None:
    def refused_until_flood(size: int) -> int:
        budget, count = MessageBudget(RATE, 0.0), 0
        budget.take(0.0, BURST)
        with pytest.raises(FloodError):
            while not affordable(budget, 0.0, size=size):
                count += 1
        return count

    assert refused_until_flood(size=1) > refused_until_flood(size=MAX_HELLO_BYTES) == 100


def test_pause_lasts_until_the_reserve_is_restored(
    budget: MessageBudget,
) -> None:
    assert budget.pause(0.0) == 0
    budget.take(0.0, BURST)
    assert budget.pause(0.0) == pytest.approx(0.25)
    assert budget.pause(0.25) == pytest.approx(0.0)


def test_bucket_allows_bursts_and_then_its_rate() -> None:
    budget = TokenBucket(10, 0.0)
    assert sum(budget.take(0.0) for _ in range(100)) == 20
    assert not budget.take(0.09)
    assert budget.take(0.11)
    taken = sum(budget.take(0.11 + tick / 1000) for tick in range(10_000))
    assert 99 <= taken <= 101


def test_bucket_holds_at_most_its_burst() -> None:
    budget = TokenBucket(10, 0.0, burst=3)
    assert budget.left(1e6) == 3
    assert not budget.take(1e6, cost=4)
    assert budget.take(1e6, cost=3)
    assert not budget.take(1e6)


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
    """Return all messages of a while."""
    found = []
    try:
        async with asyncio.timeout(seconds):
            async for answer in wire.messages():
                found.append(answer)
    except (TimeoutError, Closed):
        pass
    return found


@virtual
async def test_concurrent_resyncs_share_snapshots(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as host:
        wire = await watcher(server, await kitchen(host))
        await answers(wire)
        await wire.write(RESYNC * 30)
        kinds = [answer["type"] for answer in await answers(wire)]
        assert 1 <= kinds.count("snapshot") <= 3
        wire.cut()


@virtual
async def test_snapshots_are_charged_by_size(tmp_path: Path) -> None:
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


@virtual
async def test_joining_and_leaving_is_charged(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as host:
        code = await kitchen(host)
        wire = await watcher(server, code)
        leave = frame(b'{"type": "leave"}', TEXT)
        join = wire.encode({**WATCH, "episode": code})
        await wire.write((leave + join) * 90)
        kinds = [answer["type"] for answer in await answers(wire)]
        assert kinds.count("snapshot") < 40
        wire.cut()


def test_returning_costs_as_much_as_joining() -> None:
    hello = messages.Hello(protocol=1, name="ada", resume="token")
    assert (
        cost_of(hello) == COSTS[messages.Join] > cost_of(hello.model_copy(update={"resume": None}))
    )


@virtual
async def test_expensive_messages_are_processed_one_per_turn(tmp_path: Path) -> None:
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


@virtual
async def test_number_of_absent_spectators_is_bounded(tmp_path: Path) -> None:
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


def test_message_with_many_errors_is_refused_early() -> None:
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


def test_announced_list_lengths_allocate_no_memory() -> None:
    """A thousand nested announcements took 40 ms and have 3 kB."""
    tracemalloc.start()
    with pytest.raises(ProtocolError):
        MSGPACK.decode_client(b"\xdc\xff\xff" * 1000)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**20


@virtual
async def test_only_small_messages_are_read_before_hello(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server, hello=False) as client:
        long = {"type": "hello", "protocol": 1, "name": "x" * MAX_HELLO_BYTES}
        answer = await client.ask(long, "welcome")
        assert (answer["type"], answer["code"]) == ("error", "message/too-large")
        assert "before hello" in answer["message"]
        hello = {"type": "hello", "protocol": 1, "name": "ada", "token": "x" * 2000}
        assert (await client.ask(hello, "welcome"))["code"] == "auth/invalid"


@virtual
async def test_long_messages_are_accepted_less_often(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as client:
        long = {"type": "say", "text": "x" * 60_000}
        codes = []
        for _ in range(12):
            codes.append((await client.ask(long, "said"))["code"])
        assert codes[0] == "message/invalid-field"
        assert codes.index("rate/limited") <= 7


@virtual
@pytest.mark.parametrize(
    "action", ["cut the letuce", {"name": "dance", "args": []}], ids=["sentence", "name"]
)
@pytest.mark.parametrize("delay_ms", [0, 50])
async def test_mistakes_count_as_several_messages(
    tmp_path: Path, action: Any, delay_ms: int
) -> None:
    async with serving(tmp_path, messages_per_second=RATE) as server, raw(server) as client:
        treatments = {"robot1": {"delay_ms": delay_ms}}
        create = {"type": "create", "task": "synchronous/01", "treatments": treatments}
        code = (await client.ask(create, "created"))["code"]
        await client.ask({"type": "join", "episode": code}, "joined")
        await asyncio.sleep(2.0)
        codes = []
        for seq in range(1, 4):
            act = {"type": "act", "seq": seq, "action": action}
            codes.append((await client.ask(act, "rejected"))["code"])
        assert codes[0] == "action/unknown"
        assert codes[-1] == "rate/limited"
