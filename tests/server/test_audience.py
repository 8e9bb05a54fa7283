"""Spectators receive updates together, at most ten times a second."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed

from robotouille.episode import Stepped
from robotouille.episode.clocks import MAX_STEPS_AT_ONCE
from robotouille.protocol import messages
from robotouille.protocol.codec import JSON
from robotouille_server import Server
from robotouille_server.auth import Role
from robotouille_server.rooms.participants.seat_limits import (
    CHAT_LINES,
    CHAT_LINES_AT_ONCE,
    SPECTATOR_SHARE,
)
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.audience import (
    DELIVERY_SECONDS,
    MAX_STEPS,
    WRITE_COST,
    Audience,
    SharedMessage,
)
from robotouille_server.runtime.budgets import STEP_COST
from robotouille_server.runtime.timer_queue import TimerQueue
from robotouille_server.transport import LoopBudget
from robotouille_server.transport.loop_budget import LOOP_BUDGET
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import virtual

SPECTATOR = "spectator"


class Watched:
    """Lockstep game of one player, who acts once in each call of `act`, and its spectators."""

    def __init__(self, server: Server, player: Raw, code: str, spectators: list[Raw]) -> None:
        self.server = server
        self.player = player
        self.code = code
        self.spectators = spectators
        self._seq = 0

    async def act(self, count: int = 1) -> None:
        """Act without waiting for time to pass."""
        for _ in range(count):
            self._seq += 1
            await self.player.ask({"type": "act", "seq": self._seq, "action": None}, "delta")


@asynccontextmanager
async def watched(folder: Path, *views: str, **options: Any) -> AsyncIterator[Watched]:
    """Open a game with a spectator of each view."""
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(
            serving(folder, messages_per_second=1e6, **options)
        )
        ada = await stack.enter_async_context(raw(server, name="ada"))
        create = {"type": "create", "task": "synchronous/01", "clock": "lockstep"}
        code = (await ada.ask({**create, "max_steps": 10_000}, "created"))["code"]
        join = {"type": "join", "episode": code}
        await ada.ask(join, "joined")
        spectators = []
        for number, view in enumerate(views):
            one = await stack.enter_async_context(raw(server, name=f"eve {number}"))
            await one.ask({**join, "role": SPECTATOR, "view": view}, "joined")
            spectators.append(one)
        await asyncio.sleep(1.0)
        for one in spectators:
            await pending(one)
        yield Watched(server, ada, code, spectators)


async def pending(one: Raw) -> list[dict[str, Any]]:
    """Return the messages that arrive before any time passes."""
    got = []
    try:
        async with asyncio.timeout(0.001):
            while True:
                got.append(await one.receive())
    except (TimeoutError, ConnectionClosed):
        return got


def steps(got: list[dict[str, Any]]) -> list[int]:
    return [message["step"] for message in got if message["type"] != "roster"]


@virtual
async def test_spectator_receives_every_step_in_at_most_ten_deliveries_a_second(
    tmp_path: Path,
) -> None:
    async with watched(tmp_path, "state") as game:
        (eve,) = game.spectators
        deliveries = []
        for _ in range(100):
            await game.act()
            if got := await pending(eve):
                deliveries.append(got)
            await asyncio.sleep(0.009)
        await asyncio.sleep(DELIVERY_SECONDS)
        deliveries.append(await pending(eve))
        assert steps([message for got in deliveries for message in got]) == list(range(1, 101))
        assert len(deliveries) <= 1 / DELIVERY_SECONDS + 2


@virtual
async def test_first_step_after_a_quiet_time_is_delivered_at_once(tmp_path: Path) -> None:
    async with watched(tmp_path, "state") as game:
        await game.act()
        assert steps(await pending(game.spectators[0])) == [1]


@virtual
async def test_text_view_shows_only_the_last_step(tmp_path: Path) -> None:
    async with watched(tmp_path, "text", "both") as game:
        text, both = game.spectators
        await game.act()
        for one in game.spectators:
            await pending(one)
        await game.act(20)
        await asyncio.sleep(DELIVERY_SECONDS)
        assert [(m["type"], m["step"]) for m in await pending(text)] == [("observation", 21)]
        got = await pending(both)
        assert [m["step"] for m in got if m["type"] == "delta"] == list(range(2, 22))
        assert [m["step"] for m in got if m["type"] == "observation"] == [21]


@virtual
async def test_snapshot_replaces_too_many_deltas(tmp_path: Path) -> None:
    async with watched(tmp_path, "state") as game:
        (eve,) = game.spectators
        await game.act()
        await pending(eve)
        await game.act(MAX_STEPS + 1)
        await asyncio.sleep(DELIVERY_SECONDS)
        got = await pending(eve)
        assert [(m["type"], m["step"]) for m in got] == [("snapshot", MAX_STEPS + 2)]
        await game.act()
        await asyncio.sleep(DELIVERY_SECONDS)
        assert steps(await pending(eve)) == [MAX_STEPS + 3]


@virtual
async def test_requests_for_snapshots_share_a_delivery(tmp_path: Path) -> None:
    async with watched(tmp_path, "state", "text") as game:
        for one in game.spectators:
            for _ in range(100):
                await one.send({"type": "resync"})
                await asyncio.sleep(0.005)
            await asyncio.sleep(DELIVERY_SECONDS)
        for one, kind in zip(game.spectators, ("snapshot", "observation"), strict=True):
            answers = [message["type"] for message in await pending(one)].count(kind)
            assert 4 <= answers <= 7


@virtual
async def test_chat_before_a_requested_snapshot_is_not_lost(tmp_path: Path) -> None:
    async with watched(tmp_path, "state") as game:
        (eve,) = game.spectators
        await game.act()
        await pending(eve)
        await game.player.ask({"type": "say", "text": "hello"}, "said")
        await eve.send({"type": "resync"})
        await game.act()
        await asyncio.sleep(DELIVERY_SECONDS)
        got = await pending(eve)
        assert [m["type"] for m in got] == ["said", "snapshot"]
        assert got[1]["step"] == 2
        await game.act()
        await asyncio.sleep(DELIVERY_SECONDS)
        assert steps(await pending(eve)) == [3]


@virtual
async def test_answer_follows_what_is_pending(tmp_path: Path) -> None:
    async with watched(tmp_path, "state") as game:
        (eve,) = game.spectators
        await game.act()
        await pending(eve)
        await game.player.ask({"type": "say", "text": "hello"}, "said")
        await game.act()
        await eve.send({"type": "leave"})
        assert [m["type"] for m in await pending(eve)] == ["said", "delta", "left"]
        await game.act()
        await asyncio.sleep(1.0)
        assert await pending(eve) == []


@virtual
async def test_returning_spectator_receives_joined_first_and_nothing_twice(tmp_path: Path) -> None:
    async with watched(tmp_path) as game, raw(game.server, name="zoe") as zoe:
        join = {"type": "join", "episode": game.code, "role": SPECTATOR}
        joined = await zoe.ask(join, "joined")
        await asyncio.sleep(1.0)
        await game.act()
        await pending(zoe)
        await game.act()
        await game.player.ask({"type": "say", "text": "hello"}, "said")
        seen = {"episode": joined["episode"], "step": 1, "said": 0}
        hello = {"type": "hello", "protocol": 1, "name": "zoe", "resume": joined["resume"]}
        async with raw(game.server, hello=False) as again:
            await again.send({**hello, "seen": seen})
            await asyncio.sleep(1.0)
            got = [message["type"] for message in await pending(again)]
        assert got[:4] == ["welcome", "joined", "delta", "said"]
        assert set(got[4:]) == {"roster"}


@virtual
async def test_spectator_receives_the_end_when_the_server_stops(tmp_path: Path) -> None:
    async with watched(tmp_path, "state") as game:
        await game.player.ask({"type": "say", "text": "hello"}, "said")
        await game.server.stop()
        got = [message["type"] for message in await pending(game.spectators[0])]
        assert got == ["said", "ended", "bye"]


@virtual
async def test_newcomer_receives_no_step_twice(tmp_path: Path) -> None:
    async with watched(tmp_path, "state") as game, raw(game.server, name="zoe") as zoe:
        await game.act(3)
        await zoe.ask({"type": "join", "episode": game.code, "role": SPECTATOR}, "joined")
        await asyncio.sleep(DELIVERY_SECONDS)
        assert (await zoe.receive())["step"] == 3
        await game.act()
        await asyncio.sleep(DELIVERY_SECONDS)
        assert steps([m for m in await pending(zoe) if m["type"] == "delta"]) == [4]


class Reader:
    """Connection that counts the messages it receives. `slow` is set if it does not read them.

    With `broken`, sending raises an error.
    """

    codec = JSON

    def __init__(self) -> None:
        self.received: list[int] = []
        self.slow = self.broken = False
        self.caught_up: Callable[[], None] = lambda: None

    @property
    def behind(self) -> bool:
        return self.slow

    def keeps_up(self, caught_up: Callable[[], None]) -> bool:
        self.caught_up = caught_up
        return not self.slow

    def send_frame(self, frame: bytes, count: int) -> None:
        if self.broken:
            raise ZeroDivisionError
        self.received.append(count)


def audience_with(budget: LoopBudget) -> Audience:
    """Return an audience whose snapshots are withheld, as while a disk is full."""

    def no_observation(event: Stepped) -> SharedMessage:
        raise AssertionError

    return Audience(TimerQueue(), budget, no_observation, lambda session: None)


def entered(audience: Audience) -> tuple[Session, Reader]:
    session, reader = Session("s", name="eve", kind="human", role=Role.SPECTATOR), Reader()
    session.peer = reader  # type: ignore[assignment]
    audience.enter(session)
    return session, reader


def notice() -> SharedMessage:
    return SharedMessage(messages.Notice(text="x"))


@virtual
async def test_delivery_to_many_gives_way_to_others() -> None:
    """The steps of other rooms are taken between the turns of a delivery."""
    audience = audience_with(LoopBudget(asyncio.get_running_loop()))
    readers = [entered(audience)[1] for _ in range(1000)]
    audience.add(notice())
    audience.add(notice())
    turns = [0]
    while turns[-1] < 1000:
        await asyncio.sleep(0)
        turns.append(sum(len(reader.received) for reader in readers))
    at_once = max(after - before for before, after in pairwise(turns))
    assert at_once <= LOOP_BUDGET / WRITE_COST
    assert all(reader.received == [2] for reader in readers)


@virtual
async def test_spectator_whose_snapshot_is_withheld_misses_no_chat() -> None:
    audience = audience_with(LoopBudget(asyncio.get_running_loop()))
    _, eve = entered(audience)
    eve.slow = True
    audience.add(notice())
    await asyncio.sleep(DELIVERY_SECONDS)
    eve.slow = False
    eve.caught_up()
    audience.add(notice())
    await asyncio.sleep(DELIVERY_SECONDS)
    audience.add(notice())
    await asyncio.sleep(DELIVERY_SECONDS)
    assert eve.received == [1, 1, 1]


@virtual
async def test_error_of_one_spectator_delays_no_update_of_the_others() -> None:
    audience = audience_with(LoopBudget(asyncio.get_running_loop()))
    readers = [entered(audience)[1] for _ in range(3)]
    readers[1].broken = True
    for _ in range(2):
        audience.add(notice())
        await asyncio.sleep(DELIVERY_SECONDS)
    audience.add(notice())
    audience.deliver_now()
    assert [reader.received for reader in readers] == [[1, 1, 1], [], [1, 1, 1]]


class BusyLoop(LoopBudget):
    """Budget of an event loop that is busy until `work` is called."""

    def _schedule(self) -> None:
        pass

    def work(self) -> None:
        self._turn()


@virtual
async def test_spectator_of_a_busy_server_receives_what_follows_an_empty_room() -> None:
    budget = BusyLoop(asyncio.get_running_loop())
    audience = audience_with(budget)
    last, _ = entered(audience)
    audience.add(notice())
    audience.leave(last)
    await asyncio.sleep(DELIVERY_SECONDS)
    _, eve = entered(audience)
    audience.add(notice())
    await asyncio.sleep(DELIVERY_SECONDS)
    budget.work()
    await asyncio.sleep(DELIVERY_SECONDS)
    budget.work()
    assert eve.received == [1]


@virtual
async def test_steps_that_one_player_completes_give_way_to_others(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        room = game.server.lobby.find(game.code)
        acts = [{"type": "act", "seq": seq, "action": None} for seq in range(1, 61)]
        for act in acts:
            await game.player.send(act)
        steps_taken = [room.episode.step]
        while room.episode.step < len(acts):
            await asyncio.sleep(0)
            steps_taken.append(room.episode.step)
        at_once = max(after - before for before, after in pairwise(steps_taken))
        assert at_once <= LOOP_BUDGET / STEP_COST + 1


@virtual
async def test_steps_of_declared_thinking_give_way_to_others(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
        create = {"type": "create", "task": "synchronous/01", "max_steps": 1000}
        rules = {"clock": "realtime", "thinking": "declared"}
        code = (await ada.ask({**create, **rules}, "created"))["code"]
        await ada.ask({"type": "join", "episode": code, "view": "text"}, "joined")
        episode = server.lobby.find(code).episode
        await asyncio.sleep(1.0)
        await pending(ada)
        await ada.send({"type": "act", "seq": 1, "action": None, "think_ms": 86_400_000})
        steps_taken = [0]
        while not episode.ended:
            # Another client is answered while the steps are taken.
            await bob.ask({"type": "list"}, "episodes")
            steps_taken.append(episode.step)
        assert steps_taken[-1] == 1000
        at_once = max(after - before for before, after in pairwise(steps_taken))
        assert at_once <= 10 * LOOP_BUDGET / STEP_COST
        texts = [m["step"] for m in await pending(ada) if m["type"] == "observation"]
        assert texts == list(range(MAX_STEPS_AT_ONCE, 1001, MAX_STEPS_AT_ONCE))


async def lines_accepted(one: Raw, count: int) -> int:
    """Say lines at once; return how many are accepted."""
    accepted = 0
    for _ in range(count):
        answer = await one.ask({"type": "say", "text": "x"}, "said")
        accepted += answer["type"] == "said"
        assert answer.get("code", "rate/chat") == "rate/chat"
    return accepted


@virtual
async def test_chat_of_a_seat_is_limited(tmp_path: Path) -> None:
    async with watched(tmp_path) as game:
        assert await lines_accepted(game.player, 30) == CHAT_LINES_AT_ONCE
        await asyncio.sleep(2.0)
        assert await lines_accepted(game.player, 30) == 2 * CHAT_LINES


@virtual
async def test_chat_of_spectators_is_limited_together(tmp_path: Path) -> None:
    async with watched(tmp_path, "state", "state", "state") as game:
        for one in game.spectators:
            for _ in range(40):
                await one.send({"type": "say", "text": "x"})
        await asyncio.sleep(DELIVERY_SECONDS)
        lines = [m for m in await pending(game.player) if m["type"] == "said"]
        assert len(lines) == SPECTATOR_SHARE * CHAT_LINES_AT_ONCE
