"""Rows of recordings, compared with the recordings and the benchmark's measures."""

from __future__ import annotations

import json
import re
from collections import Counter
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille import World
from robotouille.episode import ActionRequest, Chat, Clock, Episode, PauseReason, Rules
from robotouille.errors import RecordingError
from robotouille.planning.beam.opportunities import Opportunities
from robotouille.replay import Recording
from robotouille.replay.compression import compress
from robotouille.replay.container import MAGIC, pack_frame, read_frames
from robotouille.replay.measures import activities
from robotouille.replay.recorder import Recorder, header
from robotouille_data import recording_rows as reading
from robotouille_data.recording_rows import (
    NO_SEARCHES,
    Searches,
    content_digest,
    episode_id,
    recorded_rows,
)
from robotouille_data.schema import EVENTS
from robotouille_evaluation.metrics.measuring import blocking, contributions
from robotouille_evaluation.metrics.outcomes import repeated_transitions
from robotouille_evaluation.metrics.trajectory import Trajectory
from tests.support.games import TWO, record
from tests.support.random_play import random_stream
from tests.support.shifts import example

SEEDS = range(6)
Rows = dict[str, list[dict[str, Any]]]


def rows_of(content: bytes, searches: Searches = NO_SEARCHES) -> Rows:
    found: Rows = {}
    for part in recorded_rows(content, episode_id(content_digest(content)), searches):
        for table, rows in part.tables:
            names = [column.name for column in table.columns]
            named = [dict(zip(names, row, strict=True)) for row in rows]
            found.setdefault(table.name, []).extend(named)
    return found


@pytest.mark.parametrize("seed", SEEDS)
def test_activities_equal_those_of_the_recording(seed: int) -> None:
    stream = random_stream(seed)
    recording, rows = Recording(stream), rows_of(stream)
    players = recording.world.players
    did = [(row["step"], players[row["seat"]], row["activity"]) for row in rows["steps"]]
    steps = activities(recording)
    assert did == [(step, *each) for step, seats in steps for each in seats.did.items()]
    for seat in rows["seats"]:
        counts = Counter(what for _, player, what in did if player == seat["player"])
        names = ("acted", "busy", "waiting", "idle", "away", "substituted")
        assert {name: seat[name] for name in names} == {name: counts[name] for name in names}
        assert sum(counts.values()) == recording.length == rows["episodes"][0]["steps"]


@pytest.mark.parametrize("seed", SEEDS)
def test_measures_equal_those_of_the_benchmark(seed: int) -> None:
    stream = random_stream(seed)
    rows, trajectory = rows_of(stream), Trajectory.recorded(Recording(stream))
    (measures,) = rows["measures"]
    assert measures["repeated_transitions"] == repeated_transitions(trajectory)
    assert measures["blocking"] == blocking(trajectory)
    shares = {row["player"]: row["contribution"] for row in rows["seats"]}
    assert shares == pytest.approx(contributions(trajectory))


@pytest.mark.parametrize("seed", SEEDS)
def test_rows_contain_the_recorded_moves_events_and_seats(seed: int) -> None:
    stream = random_stream(seed)
    recording, rows = Recording(stream), rows_of(stream)
    players = recording.world.players
    moves = [
        (frame["step"], move["player"], [*move["action"]], str(i) not in frame.get("unmet", {}))
        for frame in recording.steps
        for i, move in enumerate(frame["moves"])
    ]
    in_rows = [
        (row["step"], players[row["seat"]], [row["action"], *row["arguments"].split()],
         row["applied"])
        for row in rows["steps"]
        if row["action"] is not None
    ]  # fmt: skip
    assert sorted(in_rows) == sorted(moves)
    notes = [(note["step"], note["t"], note["note"]) for note in recording.notes()]
    assert [(row["step"], row["t"], row["kind"]) for row in rows.get("events", [])] == notes
    tallies = {seat["player"]: seat for seat in (recording.outcome or {})["seats"]}
    for seat in rows["seats"]:
        assert (seat["name"], seat["kind"]) == recording.participants[seat["player"]]
        tally = tallies[seat["player"]]
        assert {name: seat[name] for name in tally} == tally


def test_episode_has_its_times_without_pauses_and_its_rules() -> None:
    phrases = ("Hello", "Thank you")
    rules = Rules(
        clock=Clock.REALTIME, step_rate=5, max_steps=4, countdown=0,
        grace=12.5, chat=Chat.PHRASES, phrases=phrases,
    )  # fmt: skip
    now = 50.0
    episode = Episode(TWO, rules)
    recorder = Recorder(TWO, wall=lambda: 1_800_000_000 + now, clock=lambda: now)
    stream = recorder.begin(header(TWO.task, rules, episode="e", created="20270115T080000Z"))
    for player in TWO.players:
        episode.join(player, player, "bot", now)
    stream += recorder.record(episode.events())
    for now, what in ((50.25, "tick"), (50.3, "pause"), (54.3, "resume"), (54.6, "tick"),
                      (54.7, "tick"), (55.0, "tick")):  # fmt: skip
        arguments = () if what == "tick" else (PauseReason.OPERATOR,)
        getattr(episode, what)(*arguments, now)
        stream += recorder.record(episode.events())
    rows = rows_of(stream)
    (found,) = rows["episodes"]
    assert found["started"] == "2027-01-15T08:00:50.000Z"
    assert found["ended"] == "2027-01-15T08:00:55.000Z"
    assert found["seconds"] == pytest.approx(found["active_seconds"] + 4)
    assert (found["grace"], found["chat"]) == (12.5, "phrases")
    assert json.loads(found["phrases"]) == list(phrases)
    steps = [(row["t"], row["late_ms"]) for row in rows["steps"] if row["seat"] == 0]
    assert steps == [(frame["t"], frame.get("late", 0)) for frame in Recording(stream).steps]
    assert steps[0] == (200, 50)


@pytest.mark.slow
def test_declared_waits_and_useful_steps_are_counted_for_all_kinds_alike() -> None:
    """A bot waits, a person does nothing: the state decides alike for both."""
    stream = random_stream(1)
    recording, rows = Recording(stream), rows_of(stream, Searches(useful=True))
    players, judge = recording.world.players, Opportunities(recording.world)
    states = dict(recording.states())
    waits = {frame["step"]: frame.get("waits", ()) for frame in recording.steps}
    for row in rows["steps"]:
        player = players[row["seat"]]
        inactive = row["activity"] in ("idle", "waiting")
        could = judge.useful(states[row["step"] - 1], player) if inactive else None
        if inactive and recording.header["rules"]["clock"] == "turn":
            could = could and (row["step"] - 1) % len(players) == row["seat"]
        assert row["useful"] == could
        assert row["waits"] == (player in waits[row["step"]])
    for seat in rows["seats"]:
        own = [row for row in rows["steps"] if row["seat"] == seat["seat"]]
        assert seat["unused"] == sum(row["useful"] is True for row in own)
        assert seat["hindered"] == sum(row["useful"] is False for row in own)
        assert seat["unused"] + seat["hindered"] == seat["idle"] + seat["waiting"]
        assert seat["waits"] == sum(row["waits"] for row in own)
    for seat in rows_of(stream)["seats"]:
        assert (seat["unused"], seat["hindered"]) == (None, None)


def test_optimal_episode_has_optimality_rate_1() -> None:
    from robotouille import load_task
    from robotouille.certification.certificate import load_certificate
    from robotouille.planning.plan import read_plan

    world = World(load_task("training/01_synchronous"))
    certificate = load_certificate(world.task)
    assert certificate.plan is not None
    assert certificate.optimal
    episode = Episode(world, Rules(clock=Clock.LOCKSTEP))
    episode.join("robot1", "ada", "bot", now=0.0)
    for seq, joint in enumerate(read_plan("\n".join(certificate.plan), world, "plan"), 1):
        episode.submit("robot1", ActionRequest(seq, joint[0]), float(seq))
    stream = record(episode, episode.events())
    (measures,) = rows_of(stream)["measures"]
    assert measures["success"] is True
    assert measures["fewest_steps"] == certificate.length
    assert measures["optimality_rate"] == 1.0


def test_shift_has_a_score_instead_of_a_success() -> None:
    world = World(example(seats=1, seed=3))
    assert world.shift is not None
    episode = Episode(world, Rules(clock=Clock.LOCKSTEP))
    episode.join("robot1", "ada", "bot", now=0.0)
    for seq in range(1, world.shift.steps + 1):
        episode.submit("robot1", ActionRequest(seq, None), float(seq))
    stream = record(episode, episode.events())
    (measures,) = rows_of(stream)["measures"]
    score = Recording(stream).outcome["score"]
    assert measures["success"] is None
    assert measures["score"] == score["points"] < 0
    assert (measures["served"], measures["expired"]) == (0, score["expired"])
    assert measures["score_bound"] == world.shift.bound > 0


def test_abandoned_shift_has_no_success() -> None:
    episode = Episode(World(example(seats=1)), Rules(clock=Clock.LOCKSTEP))
    episode.join("robot1", "ada", "bot", now=0.0)
    episode.abort(1.0, "no more time")
    (measures,) = rows_of(record(episode, episode.events()))["measures"]
    assert (measures["success"], measures["score"]) == (None, 0)


def test_other_tasks_have_no_score() -> None:
    (measures,) = rows_of(random_stream(1))["measures"]
    assert {measures[name] for name in ("score", "served", "expired", "score_bound")} == {None}


def test_recording_without_footer_is_unfinished() -> None:
    stream = random_stream(1)
    whole = Recording(stream)
    cut = stream[: whole.whole - 40]  # Within the footer.
    rows = rows_of(cut)
    assert rows["episodes"][0]["state"] == "unfinished"
    assert rows["episodes"][0]["reason"] is None
    assert rows["measures"][0]["success"] is None
    assert len(rows["steps"]) == 2 * whole.length


@pytest.mark.parametrize(("limit", "most"), [("MAX_ROWS", 10), ("MAX_TEXT", 100)])
def test_long_recording_gives_several_parts(
    limit: str, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = random_stream(2)
    at_once = rows_of(stream)
    monkeypatch.setattr(reading, limit, most)
    assert len(list(recorded_rows(stream, 1))) > 2
    assert rows_of(stream) == at_once


def test_parts_of_texts_are_bounded_in_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    emoji = "\N{GRINNING FACE}" * 50_000
    noted = {"note": "noted", "t": 0, "player": "robot1", "topic": "x", "text": emoji}
    frames = list(map(pack_frame, read_frames(random_stream(0))))
    notes = pack_frame({"kind": "notes", "notes": [noted]})
    stream = MAGIC + b"".join([*frames[:-1], *[notes] * 8, frames[-1]])
    whole = rows_of(stream)
    monkeypatch.setattr(reading, "MAX_TEXT", 1_000_000)
    text = [column.name for column in EVENTS.columns].index("text")
    for part in recorded_rows(stream, 1):
        events = [row for table, rows in part.tables if table is EVENTS for row in rows]
        assert sum(len(row[text].encode()) for row in events) < 1_000_000
    assert rows_of(stream) == whole


@pytest.mark.parametrize(
    ("frame", "fault"),
    [
        ({"kind": "step", "step": 9, "t": 1, "moves": []}, "step 1 is missing"),
        ({"kind": "step", "step": 1, "t": 2**63, "moves": []}, "frame 2: step.t"),
        ({"kind": "step", "step": 1, "t": 1, "moves": [], "add": [10**9]}, "inconsistent frames"),
        ({"kind": "step", "step": 1, "t": 1, "nonsense": 1}, "frame 2"),
        (
            {
                "kind": "step",
                "step": 1,
                "t": 1,
                "moves": [{"player": "x", "action": ["a"], "seq": 1, "ms": 1}],
            },
            "inconsistent frames",
        ),
    ],
)
def test_inconsistent_frames_are_an_error(frame: dict[str, Any], fault: str) -> None:
    from robotouille.replay.container import frame_ends

    stream = random_stream(0)
    ends = list(frame_ends(stream))
    with pytest.raises(RecordingError, match=fault):
        rows_of(stream[: ends[1]] + pack_frame(frame))


def test_move_of_another_seat_is_an_error_as_in_verification() -> None:
    frames = list(read_frames(random_stream(1)))
    step = next(frame for frame in frames if frame["kind"] == "step" and frame["moves"])
    move = step["moves"][0]
    other = {"robot1": "robot2", "robot2": "robot1"}[move["player"]]
    step["moves"] = [{**move, "player": other}]
    stream = MAGIC + b"".join(map(pack_frame, frames))
    fault = rf"step {step['step']}: .* is not an action of '{other}'"
    with pytest.raises(RecordingError, match=fault):
        rows_of(stream)
    assert re.search(fault, Recording(stream).verify().fault)


def test_damaged_recordings_are_an_error() -> None:
    stream = random_stream(0)
    with pytest.raises(RecordingError):
        rows_of(compress(stream)[:-1])
    with pytest.raises(RecordingError, match="no footer"):
        rows_of(compress(stream[:-1]))
    with pytest.raises(RecordingError, match="not a recording"):
        rows_of(b"something else")
    with pytest.raises(RecordingError, match="version 9"):
        rows_of(stream[:4] + b"\x09" + stream[5:])


def test_recording_of_more_rows_than_any_study_has_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A few kilobytes of recording could fill the disk: each step has a row for each seat."""
    stream = random_stream(0)
    head, *others = read_frames(stream)
    players = [[f"cook{number}", "robot", "player"] for number in range(reading.MAX_SEATS)]
    tables = {**head["tables"], "objects": head["tables"]["objects"] + players}
    crowd = MAGIC + b"".join(map(pack_frame, [{**head, "tables": tables}, *others]))
    with pytest.raises(RecordingError, match=r"seats; a catalogue has at most 64"):
        rows_of(crowd)
    steps = len(rows_of(stream)["steps"])
    monkeypatch.setattr(reading, "MAX_STEP_ROWS", steps - 1)
    with pytest.raises(RecordingError, match="rows of steps"):
        rows_of(stream)
