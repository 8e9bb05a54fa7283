"""Round trips and the wall clock in recordings."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotouille.replay import read_recording
from robotouille_server.rooms.seats.round_trips import LOOK_SECONDS, RoundTrips, told_latency
from tests.support.servers import raw, serving
from tests.support.virtual_time import run


@pytest.mark.parametrize(
    ("course", "recorded"),
    [
        ([0.1, 0.1, 0.11, 0.12, 0.121], [0.1, 0.121]),
        ([0.04, 0.049, 0.051, 0.04, 0.03], [0.04, 0.051, 0.03]),
        ([0.0004, 0.0009, 0.0013, 0.0015], [0.0004, 0.0015]),
        ([0.2, 0.17], [0.2, 0.17]),
    ],
)
def test_what_has_changed_enough_is_recorded(course: list[float], recorded: list[float]) -> None:
    trips = RoundTrips()
    assert [seconds for seconds in course if trips.changed("robot1", seconds)] == recorded
    assert trips.changed("robot2", course[-1])


@pytest.mark.parametrize(
    ("course", "told"),
    [
        ([0.02, 0.05, 0.03], [0, 0, 0]),
        ([0.06, 0.09, 0.11, 0.14], [50, 50, 100, 100]),
        ([0.42, 0.33, 0.29, 0.02], [400, 400, 300, 0]),
    ],
)
def test_others_are_told_of_a_round_trip_that_has_changed_much(
    course: list[float], told: list[int]
) -> None:
    said = [0]
    for seconds in course:
        said.append(told_latency(seconds, said[-1]))
    assert said[1:] == told


def test_everybody_is_told_who_is_far_away_until_they_are_gone(tmp_path: Path) -> None:
    async def main() -> list[list[int]]:
        async with serving(tmp_path) as server, raw(server) as ada, raw(server) as ben:
            options = {"task": "multi_agent/01", "clock": "realtime", "step_rate": 1}
            created = await ada.ask({"type": "create", **options}, "created")
            for person in (ada, ben):
                await person.ask({"type": "join", "episode": created["code"]}, "joined")
            room = server.lobby.find(created["code"])
            (peer,) = (session.peer for session in room.members if session.player == "robot1")
            assert peer is not None
            peer.socket.latency = 0.38
            await asyncio.sleep(LOOK_SECONDS + 2)
            await ada.socket.close()
            told = []
            while not told or told[-1] != [0, 0] or [400, 0] not in told:
                roster = await ben.expect("roster")
                told.append([seat.get("latency_ms", 0) for seat in roster["seats"]])
            return told

    told = run(main())
    assert told.count([400, 0]) == 1 and told[-1] == [0, 0]


def test_a_recording_says_what_time_it_was_and_how_far_away_the_players_were(
    tmp_path: Path,
) -> None:
    def wall() -> float:
        return 1_800_000_000.25 + asyncio.get_running_loop().time()

    async def main() -> float:
        async with serving(tmp_path, wall=wall) as server, raw(server) as ada:
            options = {"task": "synchronous/01", "clock": "realtime", "step_rate": 1}
            created = await ada.ask({"type": "create", **options}, "created")
            await ada.ask({"type": "join", "episode": created["code"]}, "joined")
            began = asyncio.get_running_loop().time()
            room = server.lobby.find(created["code"])
            for session in room.members:
                assert session.peer is not None
                session.peer.socket.latency = 0.0421
            await asyncio.sleep(11.0)
            room.pause()
            await asyncio.sleep(3.0)
            room.resume()
            await asyncio.sleep(15.0)
            room.abort("seen")
            return began

    began = run(main())
    (file,) = tmp_path.glob("*.rbt")
    recording = read_recording(file)
    assert recording.verify().ok
    notes = list(recording.notes())
    assert [(n["player"], n["ms"]) for n in notes if n["note"] == "round_trip"] == [
        ("robot1", 42.1)
    ]
    started, resumed = (n for n in notes if "utc_ms" in n)
    assert (started["note"], resumed["note"]) == ("started", "resumed")
    assert started["utc_ms"] == pytest.approx((1_800_000_000.25 + began) * 1000, abs=50)
    assert resumed["utc_ms"] - started["utc_ms"] == pytest.approx(resumed["t"], abs=1)
