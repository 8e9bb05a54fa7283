"""Rows of a recording are what other code says of it: re-simulation, notes, the benchmark."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille.episode import Clock
from robotouille.errors import RecordingError
from robotouille.replay import Recording, rejection_kind
from robotouille.replay.container import compress, magic, pack_frame
from robotouille.replay.controllers import controllers
from robotouille_data.recordings import reading
from robotouille_data.recordings.reading import content_digest, episode_id, recorded_rows
from robotouille_evaluation.metrics.progress import repeated_transitions
from robotouille_evaluation.metrics.teams import blocking, contributions
from robotouille_evaluation.metrics.trajectory import Trajectory
from tests.support.random_play import random_stream

SEEDS = range(12)
Rows = dict[str, list[dict[str, Any]]]


def rows_of(content: bytes) -> Rows:
    found: Rows = {}
    for part in recorded_rows(content, episode_id(content_digest(content))):
        for table, rows in part:
            names = [column.name for column in table.columns]
            named = [dict(zip(names, row, strict=True)) for row in rows]
            found.setdefault(table.name, []).extend(named)
    return found


def plain_activities(recording: Recording) -> list[tuple[int, str, str]]:
    """Step, player and activity, by re-simulation and by the notes."""
    players = recording.world.players
    states = dict(recording.states())
    in_control = controllers(recording)
    refused: set[tuple[int, str]] = set()
    for note in recording.notes():
        if note["note"] == "rejected" and rejection_kind(note) != "superseded":
            refused.add((note["step"] + 1, note["player"]))
    found = []
    for frame in recording.steps:
        step = frame["step"]
        for seat, player in enumerate(players):
            mine = [i for i, move in enumerate(frame["moves"]) if move["player"] == player]
            turn = recording.header["rules"]["clock"] == "turn" and (step - 1) % 2 != seat
            if in_control[step][player] == "stand-in":
                did = "substituted"
            elif in_control[step][player] in ("absent", ""):
                did = "away"
            elif mine and str(mine[0]) not in frame.get("unmet", {}):
                did = "acted"
            elif states[step - 1].busy_steps(player):
                did = "busy"
            elif mine or (step, player) in refused or turn:
                did = "waiting"
            else:
                did = "idle"
            found.append((step, player, did))
    return found


@pytest.mark.parametrize("seed", SEEDS)
def test_each_step_of_each_seat_is_what_re_simulation_says(seed: int) -> None:
    stream = random_stream(seed)
    recording, rows = Recording(stream), rows_of(stream)
    players = recording.world.players
    did = [(row["step"], players[row["seat"]], row["activity"]) for row in rows["steps"]]
    assert did == plain_activities(recording)
    for seat in rows["seats"]:
        counts = Counter(what for _, player, what in did if player == seat["player"])
        names = ("acted", "busy", "waiting", "idle", "away", "substituted")
        assert {name: seat[name] for name in names} == {name: counts[name] for name in names}
        assert sum(counts.values()) == recording.length == rows["episodes"][0]["steps"]


def test_everything_happens_in_random_play() -> None:
    did = Counter(
        row["activity"] for seed in SEEDS for row in rows_of(random_stream(seed))["steps"]
    )
    assert set(did) == {"acted", "busy", "waiting", "idle", "away", "substituted"}


@pytest.mark.parametrize("seed", SEEDS)
def test_measures_are_those_of_the_benchmark(seed: int) -> None:
    stream = random_stream(seed)
    rows, trajectory = rows_of(stream), Trajectory.recorded(Recording(stream))
    (measures,) = rows["measures"]
    assert measures["repeated_transitions"] == repeated_transitions(trajectory)
    assert measures["blocking"] == blocking(trajectory)
    shares = {row["player"]: row["contribution"] for row in rows["seats"]}
    assert shares == pytest.approx(contributions(trajectory))


@pytest.mark.parametrize("seed", SEEDS)
def test_seats_events_and_moves_are_the_recorded_ones(seed: int) -> None:
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


def test_an_optimal_run_has_an_optimality_rate_of_one() -> None:
    from robotouille import World, load_task
    from robotouille.certification.certificate import load_certificate
    from robotouille.episode import Episode, Rules
    from robotouille.planning.plan import read_plan
    from robotouille.replay.recorder import Recorder, header

    world = World(load_task("training/01_synchronous"))
    certificate = load_certificate(world.task)
    assert certificate.plan is not None
    assert certificate.optimal
    episode, recorder = Episode(world, Rules(clock=Clock.LOCKSTEP)), Recorder(world)
    stream = recorder.begin(header(world.task, episode.rules, episode="optimal"))
    episode.join("robot1", "ada", "bot", now=0.0)
    for seq, joint in enumerate(read_plan("\n".join(certificate.plan), world, "plan"), 1):
        episode.submit("robot1", seq, joint[0], now=float(seq))
    stream += recorder.record(episode.events())
    (measures,) = rows_of(stream)["measures"]
    assert measures["success"] is True
    assert measures["fewest_steps"] == certificate.length
    assert measures["optimality_rate"] == 1.0


def test_an_open_recording_is_unfinished() -> None:
    stream = random_stream(1)
    whole = Recording(stream)
    cut = stream[: whole.whole - 40]  # Within the footer.
    rows = rows_of(cut)
    assert rows["episodes"][0]["state"] == "unfinished"
    assert rows["episodes"][0]["reason"] is None
    assert rows["measures"][0]["success"] is None
    assert len(rows["steps"]) == 2 * whole.length


def test_the_first_format_version_is_read() -> None:
    frames = list(Recording(random_stream(3)).each_frame())
    first = magic(1) + b"".join(pack_frame(frame, 1) for frame in frames)
    second = magic(2) + b"".join(pack_frame(frame) for frame in frames)
    for (_, rows), (_, others) in zip(rows_of(first).items(), rows_of(second).items(), strict=True):
        for row, other in zip(rows, others, strict=True):
            key = "id" if "id" in row else "episode_id"
            assert {**row, key: 0} == {**other, key: 0}


def test_a_long_recording_comes_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = random_stream(2)
    at_once = rows_of(stream)
    monkeypatch.setattr(reading, "MAX_ROWS", 10)
    assert len(list(recorded_rows(stream, 1))) > 2
    assert rows_of(stream) == at_once


def test_labels_are_those_of_the_header() -> None:
    from robotouille_data.recordings.row_builder import RowBuilder

    head = Recording(random_stream(0)).header
    labels = {"study": "pilot", "note": "a\x00b\x1b[2J", "a": "1"}
    assert RowBuilder({**head, "labels": labels}, 7).labels() == [
        (7, "a", "1"),
        (7, "note", "a\ufffdb\x1b[2J"),
        (7, "study", "pilot"),
    ]


@pytest.mark.parametrize(
    ("frame", "fault"),
    [
        ({"kind": "step", "step": 9, "t": 1, "moves": []}, "step 1 is missing"),
        ({"kind": "step", "step": 1, "t": 2**63, "moves": []}, "beyond all bounds"),
        ({"kind": "step", "step": 1, "t": 1, "moves": [], "add": [10**9]}, "fit together"),
        ({"kind": "step", "step": 1, "t": 1, "nonsense": 1}, "frame 2"),
        (
            {
                "kind": "step",
                "step": 1,
                "t": 1,
                "moves": [{"player": "x", "action": ["a"], "seq": 1, "ms": 1}],
            },
            "fit together",
        ),
    ],
)
def test_edited_recordings_are_told(frame: dict[str, Any], fault: str) -> None:
    from robotouille.replay.container import frame_ends

    stream = random_stream(0)
    ends = list(frame_ends(stream))
    with pytest.raises(RecordingError, match=fault):
        rows_of(stream[: ends[1]] + pack_frame(frame))


def test_damage_is_told() -> None:
    stream = random_stream(0)
    with pytest.raises(RecordingError):
        rows_of(compress(stream)[:-1])
    with pytest.raises(RecordingError, match="without an end"):
        rows_of(compress(stream[:-1]))
    with pytest.raises(RecordingError, match="not a recording"):
        rows_of(b"something else")
    with pytest.raises(RecordingError, match="version 9"):
        rows_of(stream[:4] + b"\x09" + stream[5:])
