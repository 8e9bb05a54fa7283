"""Rosters that spectators and slow seats cause."""

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
from robotouille_server.rooms.publishing.audience import DELIVERY_SECONDS
from robotouille_server.rooms.publishing.publisher import ROSTER_SECONDS
from tests.support.samples import quick_sample
from tests.support.servers import Raw, crash, raw, serving
from tests.support.virtual_time import virtual

HELLO = {"type": "hello", "protocol": 1, "name": "eve"}


async def rosters(one: Raw, seconds: float) -> list[dict[str, Any]]:
    """Return the rosters of some seconds."""
    got = []
    try:
        async with asyncio.timeout(seconds):
            while True:
                got.append(await one.expect("roster"))
    except TimeoutError:
        return got


async def join_and_leave(server: Any, watch: dict[str, Any], seconds: float) -> int:
    """Join and leave as quickly as the budget allows; return how often."""
    loop, often = asyncio.get_running_loop(), 0
    end = loop.time() + seconds
    async with raw(server, name="eve") as eve:
        while loop.time() < end:
            if (await eve.ask(watch, "joined"))["type"] == "joined":
                often += (await eve.ask({"type": "leave"}, "left"))["type"] == "left"
            await asyncio.sleep(0.02)
    return often


async def cut_and_resume(server: Any, watch: dict[str, Any], seconds: float) -> int:
    """Reconnect all the time; return how often."""
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


@pytest.mark.parametrize("flap", quick_sample([join_and_leave, cut_and_resume]))
@virtual
async def test_unstable_spectator_does_not_flood_players(tmp_path: Path, flap: Any) -> None:
    async with serving(tmp_path) as server, raw(server, name="ada") as ada:
        created = await ada.ask({"type": "create", "task": "multi_agent/01"}, "created")
        join = {"type": "join", "episode": created["code"]}
        await ada.ask(join, "joined")
        await ada.expect("roster")
        seconds = 1
        watch = {**join, "role": "spectator"}
        got, often = await asyncio.gather(rosters(ada, seconds + 1), flap(server, watch, seconds))
        assert often > 10
        assert len(got) <= seconds / ROSTER_SECONDS + 2
        assert {roster["spectators"] for roster in got if "spectators" in roster} == {1}
        assert "spectators" not in got[-1], "the last is how it stands"


@virtual
async def test_new_spectator_gets_a_roster_at_once(tmp_path: Path) -> None:
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


TASK = "multi_agent/01"


class Ear(Raw):
    """Connection that records all messages with their times, and counts its actions."""

    def __init__(self, connection: Raw) -> None:
        super().__init__(connection.socket, connection.text)
        self.reported: list[tuple[float, dict[str, Any]]] = []
        self.seq = 0
        self.listening = asyncio.create_task(self._listen())

    async def _listen(self) -> None:
        while True:
            message = await self.receive()
            self.reported.append((asyncio.get_running_loop().time(), message))

    async def act(self) -> None:
        self.seq += 1
        await self.send({"type": "act", "seq": self.seq, "action": None})
        await asyncio.sleep(0.01)

    def rosters(self, since: float) -> list[tuple[float, list[str]]]:
        """Return the rosters since a time: the delay of each and the seats it announces."""
        return [
            (round(at - since, 1), message.get("waits_for", []))
            for at, message in self.reported
            if message["type"] == "roster" and at >= since
        ]


@asynccontextmanager
async def table(server: Server, **create: Any) -> AsyncIterator[tuple[Ear, Ear, Ear]]:
    """Run an episode: Ada and Bob play, Eve watches with the text view."""
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
        await asyncio.sleep(0.2)
        yield ears
        for ear in ears:
            ear.listening.cancel()


def now() -> float:
    return asyncio.get_running_loop().time()


@virtual
async def test_lockstep_announces_slow_seats_and_changes(tmp_path: Path) -> None:
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
        received = [(2.0, ["robot1", "robot2"]), (5.0, ["robot1"]), (6.0, [])]
        assert eve.rosters(begun) == received
        assert ada.rosters(begun) == received


@virtual
async def test_turn_clock_announces_slow_seats(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, table(server, clock="turn") as (ada, bob, eve):
        await ada.act()
        begun = now()
        await asyncio.sleep(3.0)
        await bob.act()
        await asyncio.sleep(3.0)
        assert [who for _, who in eve.rosters(begun)] == [["robot2"], [], ["robot1"]]


@pytest.mark.parametrize("clock", ["turn", "lockstep"])
@virtual
async def test_short_waits_are_not_announced(tmp_path: Path, clock: str) -> None:
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


@virtual
async def test_real_time_announces_nothing(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, table(server, clock="realtime") as (*_, eve):
        begun = now()
        await asyncio.sleep(10.0)
        assert eve.rosters(begun) == []


@virtual
async def test_pause_ends_a_wait_and_resume_starts_a_new_one(tmp_path: Path) -> None:
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


@virtual
async def test_absent_seats_are_not_announced(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, table(server) as (ada, bob, eve):
        await asyncio.sleep(3.0)
        async with raw(server, name="max") as newcomer:
            code = next(iter(server.lobby.rooms.values())).code
            join = {"type": "join", "episode": code, "role": "spectator"}
            await newcomer.send(join)
            assert (await newcomer.expect("roster"))["waits_for"] == ["robot1", "robot2"]
        begun = now()
        await bob.socket.close()
        await asyncio.sleep(2 * DELIVERY_SECONDS)
        assert eve.rosters(begun)[-1][1] == ["robot1"]
        await ada.act()
        await asyncio.sleep(2 * DELIVERY_SECONDS)
        assert eve.rosters(begun)[-1][1] == []


@virtual
async def test_move_budget_ends_an_announced_wait(tmp_path: Path) -> None:
    async with serving(tmp_path) as server, table(server, move_budget=10) as (*_, eve):
        begun = now()
        await asyncio.sleep(25.0)
        both = ["robot1", "robot2"]
        assert [who for _, who in eve.rosters(begun)] == [both, [], both, [], both]


@virtual
async def test_client_library_reports_waits_after_a_restart(tmp_path: Path) -> None:
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
