"""A worker of the load tester in virtual time, with a real server and one that stalls."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import msgpack
import pytest
from websockets.asyncio.server import ServerConnection, serve
from websockets.typing import Subprotocol

from robotouille.episode.rules import Clock
from robotouille.protocol.codec import MSGPACK
from robotouille_client.loadtest.histogram import Measurements
from robotouille_client.loadtest.load_worker import LoadWorker
from robotouille_client.loadtest.workload import LoadPlan
from robotouille_server import Server
from tests.support.servers import serving
from tests.support.virtual_time import virtual

ONE_OF_EACH = {Clock.REALTIME: 1, Clock.LOCKSTEP: 1, Clock.TURN: 1}


class Watched:
    """A worker and all its reports."""

    def __init__(self, url: str, **plan: Any) -> None:
        (share,) = LoadPlan(url=url, **plan).shares()
        self.reports: list[dict[str, Any]] = []
        self.worker = LoadWorker(share, self.reports.append)

    @property
    def measured(self) -> Measurements:
        total = Measurements()
        for report in self.reports:
            if report["measured"]:
                total.merge(Measurements.from_json(report))
        return total

    def counted(self, name: str) -> float:
        return sum(report["counts"].get(name, 0) for report in self.reports)


@asynccontextmanager
async def playing(folder: Path, seconds: float, **plan: Any) -> AsyncIterator[tuple[Watched, Any]]:
    """Yield a worker that has measured for so many seconds, and its server."""
    async with serving(folder, messages_per_second=200, stall_seconds=3.0) as server:
        watched = Watched(server.url, **{"ramp": 1.0, **plan})
        await watched.worker.open()
        await asyncio.sleep(2)
        await watched.worker.spectate()
        await asyncio.sleep(2)
        watched.worker.measure()
        await asyncio.sleep(seconds)
        yield watched, server
        watched.worker.stop()


def live(server: Server) -> list[Any]:
    return [r for r in server.lobby.rooms.values() if r.episode.in_progress]


@pytest.mark.slow
@virtual
async def test_each_clock_is_played_at_the_requested_rate(tmp_path: Path) -> None:
    async with playing(tmp_path, 40, rooms=6, mix=ONE_OF_EACH, rate=5.0) as (watched, server):
        rooms = live(server)
        assert sorted(room.episode.rules.clock for room in rooms) == sorted([*Clock] * 2)
        measured = watched.measured
        for clock in Clock:
            took = measured.duration(f"action, {clock.value}")
            assert took.count == pytest.approx(2 * 40 * 5, rel=0.08), clock
            assert took.percentile(100) < 0.01, clock
        felt = measured.duration("action with its wait, realtime")
        assert 0.04 < felt.percentile(0) < felt.largest < 0.16
        assert measured.counts["steps"] == pytest.approx(measured.counts["steps due"], rel=0.06)
        assert not any(name.startswith("rejected") for name in measured.counts)
        applied = sum(s.tally.acted for r in rooms for s in r.episode.seats.values())
        assert applied == pytest.approx(6 * 44 * 5, rel=0.15)


@virtual
async def test_refused_rooms_are_counted_by_reason(tmp_path: Path) -> None:
    async with serving(tmp_path, max_episodes=2) as server:
        watched = Watched(server.url, rooms=5, ramp=0.5)
        await watched.worker.open()
        await asyncio.sleep(1)
        watched.worker.stop()
    reasons = {
        name: n
        for report in watched.reports
        for name, n in report["counts"].items()
        if name.startswith("not begun")
    }
    assert sum(reasons.values()) == 3
    assert all("server/full" in name for name in reasons)


@pytest.mark.slow
@virtual
async def test_players_return_to_their_seats_after_a_storm(tmp_path: Path) -> None:
    plan = {"rooms": 6, "mix": ONE_OF_EACH, "storm": 10}
    async with playing(tmp_path, 3, **plan) as (watched, server):
        rooms = live(server)
        names = {r.id: [s.name for s in r.episode.seats.values()] for r in rooms}
        steps = {room.id: room.episode.step for room in rooms}
        assert watched.worker.storm() == 10
        await asyncio.sleep(10)
        returned = watched.measured.duration("return")
        assert returned.count == 10
        assert 0 < returned.largest < 1
        assert watched.counted("lost in the storm") == 0
        for room in live(server):
            seats = room.episode.seats.values()
            assert all(seat.present for seat in seats)
            assert [seat.name for seat in seats] == names[room.id]
            assert room.episode.step >= steps[room.id] + 40


@pytest.mark.slow
@virtual
async def test_server_drops_only_slow_readers(tmp_path: Path) -> None:
    async with playing(tmp_path, 45, rooms=2, rate=2.0, slow_readers=3) as (watched, server):
        assert watched.counted("slow readers dropped") == 3
        assert watched.counted("connections lost") == 3
        assert len(live(server)) == 2
        age = watched.measured.duration("delta age")
        assert age.count > 100
        assert age.largest < 0.1


@pytest.mark.slow
@virtual
async def test_spectators_watch_quiet_episodes(tmp_path: Path) -> None:
    plan = {"rooms": 0, "spectators": 25, "spectators_per_room": 10}
    async with playing(tmp_path, 40, **plan) as (watched, server):
        watching = sorted(room.spectators for room in live(server))
        assert watching == [5, 10, 10]
        assert watched.reports[-1]["connected"] == 25 + 3 * 2 + 1
        assert watched.measured.counts["deltas to spectators"] == pytest.approx(100, abs=25)


@pytest.mark.slow
@virtual
async def test_bots_open_a_new_episode_when_one_ends(tmp_path: Path) -> None:
    async with playing(tmp_path, 1, rooms=2) as (watched, server):
        first = live(server)
        for room in first:
            room.abort("for a test")
        await asyncio.sleep(3)
        assert watched.counted("episodes ended") == 2
        second = live(server)
        assert len(second) == 2
        assert not {room.id for room in first} & {room.id for room in second}


class Stalling:
    """Server of a lockstep episode that does nothing from `start` to `end`."""

    def __init__(self, start: float, end: float) -> None:
        self._loop = asyncio.get_running_loop()
        self._stall = (start, end)
        self._members: list[ServerConnection] = []
        self._step = 0

    async def handle(self, socket: ServerConnection) -> None:
        async for payload in socket:
            message = msgpack.unpackb(payload)
            begun, over = (self._loop.time() - at for at in self._stall)
            if begun >= 0 > over:
                await asyncio.sleep(-over)
            for answer in self._answers(socket, message):
                await answer

    def _answers(self, socket: ServerConnection, message: dict[str, Any]) -> list[Any]:
        send = [socket]
        messages: list[dict[str, Any]] = []
        match message["type"]:
            case "hello":
                messages = [{"type": "welcome", "resume": "token"}]
            case "create":
                messages = [{"type": "created", "code": "CODE"}]
            case "join":
                self._members.append(socket)
                seat = f"robot{len(self._members)}"
                messages = [{"type": "joined", "episode": "e", "seat": seat}]
                if len(self._members) == 2:
                    seats = [{"player": f"robot{n}", "present": True} for n in (1, 2)]
                    messages.append({"type": "roster", "phase": "running", "seats": seats})
                    return [socket.send(msgpack.packb(messages[0]))] + [
                        member.send(msgpack.packb(messages[1])) for member in self._members
                    ]
            case "act" if message["action"] is not None:
                self._step += 1
                did = [[0, *message["action"]["args"]]]
                messages = [
                    {"type": "delta", "step": self._step, "did": did, "seq": [message["seq"]]}
                ]
                send = self._members
        return [to.send(msgpack.packb(one)) for one in messages for to in send]


@virtual
async def test_stalled_server_is_not_measured_less_often() -> None:
    """Ten actions are due while the server sleeps for a second.

    Each is late from its own due time, although only the first could be sent before.
    """
    now = asyncio.get_running_loop().time()
    stalling = Stalling(now + 10.0, now + 11.0)
    protocols = [Subprotocol(MSGPACK.name)]
    async with serve(stalling.handle, "127.0.0.1", 0, subprotocols=protocols) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        watched = Watched(
            f"ws://127.0.0.1:{port}", rooms=1, mix={Clock.LOCKSTEP: 1}, rate=10.0, ramp=0.0
        )
        await watched.worker.open()
        watched.worker.measure()
        await asyncio.sleep(20)
        watched.worker.stop()
    took = watched.measured.duration("action, lockstep")
    assert took.count == pytest.approx(200, abs=2)
    late = [round((1 - took.share_within(limit)) * took.count) for limit in (0.05, 0.45, 0.85)]
    assert late == [pytest.approx(expected, abs=1) for expected in (10, 6, 2)]
    assert 0.85 < took.largest <= 1.0
