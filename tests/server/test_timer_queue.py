"""Timers and rounds over all rooms."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from websockets.asyncio.client import connect as open_socket

from robotouille.episode.clocks import MAX_CATCH_UP, MAX_LATE_AT_ONCE
from robotouille_server.rooms.room import Room
from robotouille_server.runtime.timer_queue import RUN_SECONDS, Rounds, TimerQueue
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import STILL, run, stand_still, virtual

HELLO = {"type": "hello", "protocol": 1, "name": "bob"}


async def begin(ada: Raw, bob: Raw, **options: Any) -> tuple[str, str]:
    """Let both participants join; return the code and Bob's resume token."""
    created = await ada.ask({"type": "create", "task": "multi_agent/02", **options}, "created")
    join = {"type": "join", "episode": created["code"]}
    await ada.ask(join, "joined")
    return created["code"], (await bob.ask(join, "joined"))["resume"]


async def seat_is_taken(room: Room, seconds: float) -> bool:
    await asyncio.sleep(seconds)
    return room.episode.in_progress and room.episode.seats["robot2"].taken


@pytest.mark.parametrize("absence", ["wait", "pause", "end"])
@virtual
async def test_suspension_does_not_use_up_grace(tmp_path: Path, absence: str) -> None:
    async with serving(tmp_path, grace=30) as server, raw(server) as ada:
        async with raw(server, name="bob") as bob:
            code, resume = await begin(ada, bob, absence=absence, clock="lockstep")
        room = server.lobby.find(code)
        await asyncio.sleep(10)
        stand_still()
        assert await seat_is_taken(room, 15), "lost by standing still"
        async with raw(server, hello=False) as again:
            welcome = await again.ask({**HELLO, "resume": resume}, "welcome")
            assert welcome["resumed"] is True
            assert (await again.expect("joined"))["seat"] == "robot2"
        stand_still()
        assert await seat_is_taken(room, 25)
        assert not await seat_is_taken(room, 10), "never given up"


@virtual
async def test_real_time_does_not_catch_up_after_suspension(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
        code, _ = await begin(ada, bob, clock="realtime", step_rate=5)
        episode = server.lobby.find(code).episode
        await asyncio.sleep(2.1)
        before = episode.step
        stand_still()
        await asyncio.sleep(0.25)
        assert episode.step - before in (1, 2)
        await asyncio.sleep(2)
        assert episode.step - before in (11, 12)


@virtual
async def test_late_steps_in_real_time_give_way_to_others(tmp_path: Path) -> None:
    """With limited sight, ten steps at once delayed the steps of all other episodes by 200 ms."""
    async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
        code, _ = await begin(ada, bob, clock="realtime", step_rate=60)
        episode = server.lobby.find(code).episode
        await asyncio.sleep(1.0)
        steps_taken = [episode.step]
        stand_still(1.0)
        while steps_taken[-1] < steps_taken[0] + MAX_CATCH_UP:
            await asyncio.sleep(0)
            steps_taken.append(episode.step)
        assert max(after - before for before, after in pairwise(steps_taken)) <= MAX_LATE_AT_ONCE
        await asyncio.sleep(1.0)
        assert episode.step - steps_taken[-1] in (59, 60, 61)


@virtual
async def test_suspension_does_not_use_up_the_move_budget(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
        code, _ = await begin(ada, bob, clock="lockstep", move_budget=20)
        episode = server.lobby.find(code).episode
        await asyncio.sleep(10)
        stand_still()
        await asyncio.sleep(5)
        assert episode.step == 0
        await asyncio.sleep(10)
        assert episode.step == 1


@virtual
async def test_suspension_does_not_use_up_the_time_for_hello(tmp_path: Path) -> None:
    async with serving(tmp_path, hello_seconds=10) as server:
        async with open_socket(server.url, compression=None) as socket:
            await asyncio.sleep(5)
            stand_still()
            await asyncio.sleep(5)
            bob = Raw(socket, text=True)
            assert (await bob.ask(HELLO, "welcome", "bye"))["type"] == "welcome"


@virtual
async def test_quiet_or_busy_periods_are_no_suspension() -> None:
    agenda, loop, called = TimerQueue(), asyncio.get_running_loop(), []
    begun = agenda.time()
    await asyncio.sleep(3600)
    assert agenda.time() == pytest.approx(begun + 3600)
    appointment = agenda.call_at(agenda.time() + 600, called.append)
    await asyncio.sleep(300)
    stand_still(4)
    await asyncio.sleep(10)
    assert agenda.lost == 0
    stand_still()
    await asyncio.sleep(200)
    assert (called, round(agenda.lost)) == ([], pytest.approx(STILL, abs=2))
    await asyncio.sleep(150)
    assert called == [appointment.due]
    assert agenda.time() <= loop.time() - STILL


class Exact:
    """Event loop that calls back exactly at the requested time."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.waits: tuple[float, Callable[[], None]] | None = None

    def time(self) -> float:
        return self.now

    def call_at(self, when: float, call: Callable[[], None]) -> Exact:
        self.waits = when, call
        return self

    def when(self) -> float:
        assert self.waits is not None
        return self.waits[0]

    def cancel(self) -> None:
        self.waits = None

    def run(self) -> None:
        assert self.waits is not None
        (self.now, call), self.waits = self.waits, None
        call()


def test_rounding_does_not_delay_timers(monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop once waited repeatedly for a time that rounding kept in the future."""
    loop, done = Exact(), []
    monkeypatch.setattr(asyncio, "get_running_loop", lambda: loop)
    agenda = TimerQueue()
    for number in range(1, 200):
        agenda.lost += number / 7
        agenda.call_at(agenda.time() + 1 / number, done.append)
        loop.run()
        assert len(done) == number


def test_timer_that_sets_another_for_the_present_does_not_continue_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loop, called = Exact(), []
    monkeypatch.setattr(asyncio, "get_running_loop", lambda: loop)
    timers = TimerQueue()

    def again(due: float) -> None:
        called.append(due)
        timers.call_at(timers.time(), again)

    timers.call_at(timers.time(), again)
    for runs in range(1, 4):
        loop.run()
        assert len(called) == runs


def test_run_ends_after_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, called = Exact(), []
    monkeypatch.setattr(asyncio, "get_running_loop", lambda: loop)
    timers = TimerQueue()

    def work(due: float) -> None:
        called.append(due)
        loop.now += RUN_SECONDS / 2

    for _ in range(5):
        timers.call_at(timers.time(), work)
    loop.run()
    assert len(called) == 2
    assert loop.when() <= loop.now, "the next run begins after the sockets"


SECONDS = 10.0


class Seen:
    """Object that counts its checks."""

    turn = 0

    def __init__(self, *, busy: bool) -> None:
        self._busy = busy
        self.turns: list[int] = []

    def look(self) -> bool:
        self.turns.append(Seen.turn)
        return self._busy


async def count_turns() -> None:
    while True:
        Seen.turn += 1
        await asyncio.sleep(0)


def test_object_with_work_gets_a_turn_of_its_own() -> None:
    async def main() -> list[set[int]]:
        found = []
        for busy in (True, False):
            live = {Seen(busy=busy) for _ in range(3)}
            rounds = Rounds(live, 0.0, Seen.look)
            counting = asyncio.create_task(count_turns())
            rounds.begin()
            while not all(one.turns for one in live):
                await asyncio.sleep(0)
            rounds.stop()
            counting.cancel()
            found.append({one.turns[0] for one in live})
        return found

    apart, together = run(main())
    assert len(apart) == 3
    assert len(together) == 1
