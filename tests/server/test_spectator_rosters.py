"""Whoever only watches may come and go as often as they like: the others hear little of it."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from robotouille_server.rooms.broadcast.spectator_rosters import ROSTER_SECONDS, SpectatorRosters
from robotouille_server.runtime.timer_queue import TimerQueue
from tests.support.servers import Raw, raw, serving
from tests.support.virtual_time import run

HELLO = {"type": "hello", "protocol": 1, "name": "eve"}


class Table:
    """When rosters were published, in seconds from the beginning; `failing` withholds them."""

    def __init__(self) -> None:
        self.failing = False
        self.published: list[float] = []
        self._timers = TimerQueue()
        self._begun = self._timers.time()
        self.rosters = SpectatorRosters(self._timers, lambda: self.failing, self._publish)

    def _publish(self) -> None:
        self.published.append(round(self._timers.time() - self._begun, 2))


def test_the_first_is_told_at_once_and_those_after_it_together() -> None:
    async def main() -> None:
        table = Table()
        for _ in range(100):  # In one second.
            table.rosters.changed()
            await asyncio.sleep(0.01)
        await asyncio.sleep(5)
        assert table.published == [0.0, 0.25, 0.5, 0.75, 1.0]
        table.rosters.changed()
        await asyncio.sleep(0)
        await asyncio.sleep(0.01)
        assert table.published[5:] == [6.0]

    run(main())


def test_all_of_one_turn_of_the_event_loop_are_told_in_one_roster() -> None:
    async def main() -> None:
        table = Table()
        for _ in range(50):
            table.rosters.changed()
        await asyncio.sleep(5)
        assert table.published == [0.0]

    run(main())


def test_nothing_is_told_while_it_is_withheld_and_all_of_it_once_after_that() -> None:
    async def main() -> None:
        table = Table()
        table.failing = True
        for _ in range(20):
            table.rosters.changed()
            await asyncio.sleep(0.5)
        assert table.published == []
        table.failing = False
        table.rosters.released()
        await asyncio.sleep(5)
        table.rosters.released()
        await asyncio.sleep(5)
        assert table.published == [10.0]

    run(main())


async def rosters(one: Raw, seconds: float) -> list[dict[str, Any]]:
    """Those that come in so many seconds."""
    got = []
    try:
        async with asyncio.timeout(seconds):
            while True:
                got.append(await one.expect("roster"))
    except TimeoutError:
        return got


async def join_and_leave(server: Any, watch: dict[str, Any], seconds: float) -> int:
    """As quickly as the budget of one connection allows; how often."""
    loop, often = asyncio.get_running_loop(), 0
    end = loop.time() + seconds
    async with raw(server, name="eve") as eve:
        while loop.time() < end:
            if (await eve.ask(watch, "joined"))["type"] == "joined":
                often += (await eve.ask({"type": "leave"}, "left"))["type"] == "left"
            await asyncio.sleep(0.02)
    return often


async def cut_and_resume(server: Any, watch: dict[str, Any], seconds: float) -> int:
    """Always over a new connection; how often."""
    loop, often, resume = asyncio.get_running_loop(), 0, ""
    end = loop.time() + seconds
    async with raw(server, name="eve") as eve:
        resume = (await eve.ask(watch, "joined"))["resume"]
    while loop.time() < end:
        async with raw(server, hello=False) as eve:
            assert (await eve.ask({**HELLO, "resume": resume}, "welcome"))["resumed"] is True
            resume = (await eve.expect("joined"))["resume"]
        often += 1
        await asyncio.sleep(0.01)
    return often


@pytest.mark.parametrize("flap", [join_and_leave, cut_and_resume])
def test_who_flaps_does_not_flood_the_players(tmp_path: Path, flap: Any) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, raw(server, name="ada") as ada:
            created = await ada.ask({"type": "create", "task": "multi_agent/01"}, "created")
            join = {"type": "join", "episode": created["code"]}
            await ada.ask(join, "joined")
            await ada.expect("roster")
            seconds = 1
            watch = {**join, "role": "spectator"}
            got, often = await asyncio.gather(
                rosters(ada, seconds + 1), flap(server, watch, seconds)
            )
            assert often > 10
            assert len(got) <= seconds / ROSTER_SECONDS + 2
            assert {roster["spectators"] for roster in got if "spectators" in roster} == {1}
            assert "spectators" not in got[-1], "the last is how it stands"

    run(main())


def test_a_newcomer_is_sent_a_roster_without_waiting(tmp_path: Path) -> None:
    """`join` is answered by a roster: for one's own nobody waits."""

    async def main() -> None:
        async with serving(tmp_path) as server, raw(server, name="ada") as ada:
            created = await ada.ask({"type": "create", "task": "multi_agent/01"}, "created")
            watch = {"type": "join", "episode": created["code"], "role": "spectator"}
            loop = asyncio.get_running_loop()
            for number in range(1, 4):
                async with raw(server) as eve:
                    asked = loop.time()
                    await eve.ask(watch, "joined")
                    assert (await eve.expect("roster"))["spectators"] == 1, number
                    assert loop.time() - asked < ROSTER_SECONDS / 2
                    await eve.ask({"type": "leave"}, "left")

    run(main())
