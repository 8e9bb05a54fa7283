"""Everybody is told whom a step waits for, once that has taken two seconds."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from robotouille_client import connect
from robotouille_client.sansio.game_events import RosterChanged
from robotouille_server import Server
from tests.support.servers import Raw, crash, raw, serving
from tests.support.virtual_time import run

TASK = "multi_agent/01"


class Ear(Raw):
    """Hears everything in the background, with the time; counts its actions."""

    def __init__(self, connection: Raw) -> None:
        super().__init__(connection.socket, connection.text)
        self.heard: list[tuple[float, dict[str, Any]]] = []
        self.seq = 0
        self.listening = asyncio.create_task(self._listen())

    async def _listen(self) -> None:
        while True:
            message = await self.receive()
            self.heard.append((asyncio.get_running_loop().time(), message))

    async def act(self) -> None:
        self.seq += 1
        await self.send({"type": "act", "seq": self.seq, "action": None})
        await asyncio.sleep(0.01)

    def rosters(self, since: float) -> list[tuple[float, list[str]]]:
        """The rosters since a time: how much later, and whom the step waited for."""
        return [
            (round(at - since, 1), message.get("waits_for", []))
            for at, message in self.heard
            if message["type"] == "roster" and at >= since
        ]


@asynccontextmanager
async def table(server: Server, **create: Any) -> AsyncIterator[tuple[Ear, Ear, Ear]]:
    """Ada and bob play, eve watches in words; time has just begun."""
    async with (
        raw(server, name="ada") as one,
        raw(server, name="bob") as two,
        raw(server, name="eve") as three,
    ):
        created = await one.ask({"type": "create", "task": TASK, **create}, "created")
        join = {"type": "join", "episode": created["code"]}
        await three.ask({**join, "role": "spectator", "view": "text"}, "joined")
        await one.ask(join, "joined")
        await two.ask(join, "joined")
        ears = Ear(one), Ear(two), Ear(three)
        await asyncio.sleep(0.1)
        yield ears
        for ear in ears:
            ear.listening.cancel()


def now() -> float:
    return asyncio.get_running_loop().time()


def test_lockstep_tells_for_whom_it_waits_and_when_that_changes(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, table(server) as (ada, bob, eve):
            await ada.act()
            await bob.act()
            begun = now()
            await asyncio.sleep(1.9)
            assert eve.rosters(begun) == []
            await asyncio.sleep(3.1)
            await bob.act()
            await asyncio.sleep(1.0)
            await ada.act()
            await asyncio.sleep(1.0)
            told = [(2.0, ["robot1", "robot2"]), (5.0, ["robot1"]), (6.0, [])]
            assert eve.rosters(begun) == told
            assert ada.rosters(begun) == told

    run(main())


def test_turns_tell_whose_is_waited_for(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, table(server, clock="turn") as (ada, bob, eve):
            await ada.act()
            begun = now()
            await asyncio.sleep(3.0)
            await bob.act()
            await asyncio.sleep(3.0)
            assert [who for _, who in eve.rosters(begun)] == [["robot2"], [], ["robot1"]]

    run(main())


@pytest.mark.parametrize("clock", ["turn", "lockstep"])
def test_nothing_is_told_of_steps_that_take_less(tmp_path: Path, clock: str) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, table(server, clock=clock) as (ada, bob, eve):
            begun = now()
            for _ in range(10):
                await asyncio.sleep(0.8)
                await ada.act()
                await asyncio.sleep(0.8)
                await bob.act()
            assert eve.rosters(begun) == []
            room = next(iter(server.lobby.rooms.values()))
            assert room.episode.step == (20 if clock == "turn" else 10)

    run(main())


def test_real_time_waits_for_nobody(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, table(server, clock="realtime") as (*_, eve):
            begun = now()
            await asyncio.sleep(10.0)
            assert eve.rosters(begun) == []

    run(main())


def test_while_it_stands_still_nobody_is_waited_for_and_then_anew(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, table(server) as (ada, _, eve):
            room = next(iter(server.lobby.rooms.values()))
            await ada.act()
            await asyncio.sleep(3.0)
            begun = now()
            room.pause()
            await asyncio.sleep(10.0)
            room.resume()
            await asyncio.sleep(5.0)
            assert eve.rosters(begun) == [(0.0, []), (10.0, []), (12.0, ["robot2"])]

    run(main())


def test_who_is_away_is_not_waited_for_and_a_newcomer_is_told(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, table(server) as (ada, bob, eve):
            await asyncio.sleep(3.0)
            async with raw(server, name="max") as newcomer:
                code = next(iter(server.lobby.rooms.values())).code
                join = {"type": "join", "episode": code, "role": "spectator"}
                await newcomer.send(join)
                assert (await newcomer.expect("roster"))["waits_for"] == ["robot1", "robot2"]
            begun = now()
            await bob.socket.close()
            await asyncio.sleep(0.1)
            assert eve.rosters(begun)[-1][1] == ["robot1"]
            await ada.act()
            assert eve.rosters(begun)[-1][1] == []

    run(main())


def test_the_move_budget_ends_a_wait_that_was_told(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server, table(server, move_budget=10) as (*_, eve):
            begun = now()
            await asyncio.sleep(25.0)
            both = ["robot1", "robot2"]
            assert [who for _, who in eve.rosters(begun)] == [both, [], both, [], both]

    run(main())


def test_the_library_tells_and_after_a_restart_too(tmp_path: Path) -> None:
    async def main() -> None:
        async with serving(tmp_path) as server:
            port = server.port
            ada = connect(server.url, name="ada")
            bob = connect(server.url, name="bob")
            one, two = await ada.__aenter__(), await bob.__aenter__()
            created = await one.create(TASK)
            games = await one.join(created.code), await two.join(created.code)
            await asyncio.sleep(3.0)
            assert games[0].waits_for == ("robot1", "robot2")
            await crash(server)
        async with serving(tmp_path, seed=2, port=port):
            await asyncio.sleep(15.0)
            assert games[0].running
            assert games[0].waits_for == ("robot1", "robot2")
            games[0].poll()
            games[1].submit(None)
            await asyncio.sleep(0.1)
            (changed,) = [e for e in games[0].poll() if isinstance(e, RosterChanged)]
            assert changed.waits_for == games[0].waits_for == ("robot1",)
            await ada.__aexit__(None, None, None)
            await bob.__aexit__(None, None, None)

    run(main())


def test_a_game_that_nobody_waits_for_sets_no_timers_of_its_own(tmp_path: Path) -> None:
    """One look every two seconds, however many steps there are; none once it was told."""

    async def main() -> None:
        async with serving(tmp_path, move_budget="0") as server, table(server) as (ada, bob, _):
            room = next(iter(server.lobby.rooms.values()))
            timers, looks = room._host.timers, []
            call_at = timers.call_at
            timers.call_at = lambda due, call: looks.append(due) or call_at(due, call)  # type: ignore
            for _ in range(100):
                await ada.act()
                await bob.act()
            assert len(looks) <= 2
            await asyncio.sleep(5.0)
            looks.clear()
            await asyncio.sleep(3600.0)
            assert looks == []

    run(main())
