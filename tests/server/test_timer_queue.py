"""What a server's process stood still (SIGSTOP, a suspended machine) is nobody's absence."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from websockets.asyncio.client import connect as open_socket

from robotouille_server.rooms.room import Room
from robotouille_server.runtime.timer_queue import TimerQueue
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import VirtualTimeLoop, run

HELLO = {"type": "hello", "protocol": 1, "name": "bob"}
STILL = 50.0


def stand_still(seconds: float = STILL) -> None:
    """Time goes on, and nothing of this process does."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop._jumping.now += seconds


async def begin(ada: Raw, bob: Raw, **options: Any) -> tuple[str, str]:
    """Both have joined; the code, and Bob's resume token."""
    created = await ada.ask({"type": "create", "task": "multi_agent/02", **options}, "created")
    join = {"type": "join", "episode": created["code"]}
    await ada.ask(join, "joined")
    return created["code"], (await bob.ask(join, "joined"))["resume"]


async def seat_is_taken(room: Room, seconds: float) -> bool:
    await asyncio.sleep(seconds)
    return room.episode.in_progress and room.episode.seats["robot2"].taken


@pytest.mark.parametrize("absence", ["wait", "pause", "end"])
def test_an_absent_seat_is_not_charged_for_it(tmp_path: Path, absence: str) -> None:
    async def main() -> None:
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

    run(main())


def test_real_time_does_not_catch_up(tmp_path: Path) -> None:
    async def main() -> None:
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

    run(main())


def test_a_move_has_its_whole_budget(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server) as ada, raw(server) as bob:
            code, _ = await begin(ada, bob, clock="lockstep", move_budget=20)
            episode = server.lobby.find(code).episode
            await asyncio.sleep(10)
            stand_still()
            await asyncio.sleep(5)
            assert episode.step == 0
            await asyncio.sleep(10)
            assert episode.step == 1

    run(main())


def test_a_newcomer_has_time_to_say_hello(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path, hello_seconds=10) as server:
            async with open_socket(server.url, compression=None) as socket:
                await asyncio.sleep(5)
                stand_still()
                await asyncio.sleep(5)
                bob = Raw(socket, text=True)
                assert (await bob.ask(HELLO, "welcome", "bye"))["type"] == "welcome"

    run(main())


def test_only_what_was_waited_for_counts() -> None:
    """Neither a quiet hour nor a busy second is a standstill."""

    async def main() -> None:
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

    run(main())


class Exact:
    """A loop that calls back at the very moment that was asked for."""

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


def test_what_is_due_is_done_however_times_are_rounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once the loop waited again and again for a moment that, the lost seconds taken off, was not
    quite due."""
    loop, done = Exact(), []
    monkeypatch.setattr(asyncio, "get_running_loop", lambda: loop)
    agenda = TimerQueue()
    for number in range(1, 200):
        agenda.lost += number / 7
        agenda.call_at(agenda.time() + 1 / number, done.append)
        loop.run()
        assert len(done) == number
