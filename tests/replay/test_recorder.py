"""Recorder: notes, hashes, keyframes and times of day."""

from __future__ import annotations

from robotouille import World
from robotouille.episode import (
    ActionRejected,
    Clock,
    Episode,
    Paused,
    PauseReason,
    Restarted,
    Resumed,
    Rules,
    Started,
)
from robotouille.replay.container import MAGIC, read_frames
from robotouille.replay.file_names import file_name, is_recording_name, recording_stem
from robotouille.replay.recorder import (
    HASH_EVERY,
    MAX_NOTES,
    SNAPSHOT_EVERY,
    Recorder,
    header,
)
from robotouille.replay.recording import Recording
from robotouille.world.unmet import only_words
from tests.support.episodes import TWO
from tests.support.games import recorded_game

GAME = recorded_game("multi_agent/10@3", seed=5, steps=130)


def test_many_long_notes_take_several_frames() -> None:
    """Such as the notes that waited while the disk was full."""
    world = World("synchronous/01")
    rejected = ActionRejected(
        player="robot1", seq=1, action="a" * 300, unmet=only_words(*["r" * 500] * 4),
        reasoning="\N{ROBOT FACE}" * 8000, time=0.0,
    )  # fmt: skip
    written = Recorder(world).record([rejected] * (3 * MAX_NOTES))
    frames = list(read_frames(MAGIC + written))
    assert [len(frame["notes"]) for frame in frames] == [MAX_NOTES] * 3


def test_hashes_and_keyframes_are_written_at_regular_steps() -> None:
    recording = Recording(GAME)
    hashed = [frame["step"] for frame in recording.steps if "hash" in frame]
    assert hashed == [n for n in range(1, recording.length + 1) if n % HASH_EVERY == 0]
    keyframes = [frame["step"] for frame in recording.frames if frame["kind"] == "state"]
    assert keyframes == [n for n in range(recording.length + 1) if n % SNAPSHOT_EVERY == 0]


def test_times_of_day_are_recorded_where_the_game_starts_and_stops() -> None:
    events = [Started(0.0), Paused((PauseReason.OPERATOR,), 1.0), Resumed(2.0), Restarted(3.0)]
    seconds = iter([1_800_000_000.0, 1_800_000_001, 1_800_000_002.0005, 1_800_000_009.25])
    for wall, expected in (
        (lambda: next(seconds), [1_800_000_000_000, 1_800_000_001_000, 1_800_000_002_000,
                                 1_800_000_009_250]),
        (None, [None] * 4),
    ):  # fmt: skip
        written = Recorder(TWO, wall=wall).record(events)
        (frame,) = read_frames(MAGIC + written)
        assert [note.get("utc_ms") for note in frame["notes"]] == expected


def test_arrivals_before_the_start_and_the_end_have_both_times() -> None:
    now = 100.0
    episode = Episode(TWO, Rules())
    recorder = Recorder(TWO, wall=lambda: 1_800_000_000 + now, clock=lambda: now)
    stream = recorder.begin(header(TWO.task, episode.rules, episode="e"))

    def at(time: float) -> float:
        nonlocal stream, now
        stream += recorder.record(episode.events())
        now = time
        return time

    episode.join("robot1", "ada", "human", at(103.0), ready=False)
    episode.join("robot2", "bob", "human", at(110.5))
    episode.set_present("robot2", False, at(111.0))
    episode.set_present("robot2", True, at(112.0))
    episode.leave("robot2", at(113.0))
    episode.set_ready("robot1", True, at(114.0))
    episode.abort(at(120.25), "enough")
    at(0.0)
    recording = Recording(stream)
    moments = [103_000, 103_000, 110_500, 111_000, 112_000, 113_000, 114_000]
    notes = list(recording.notes())
    assert [note["note"] for note in notes] == ["roster", "ready", *["roster"] * 4, "ready"]
    assert [note["clock_ms"] for note in notes] == moments
    assert [note["utc_ms"] for note in notes] == [1_800_000_000_000 + each for each in moments]
    footer = recording.frames[-1]
    assert (footer["utc_ms"], footer["clock_ms"]) == (1_800_000_120_250, 120_250)
    assert recording.verify().ok


def test_late_step_is_recorded_with_both_times() -> None:
    episode = Episode(TWO, Rules(clock=Clock.REALTIME, step_rate=5, max_steps=2, countdown=0))
    recorder = Recorder(TWO)
    stream = recorder.begin(header(TWO.task, episode.rules, episode="e"))
    for player in TWO.players:
        episode.join(player, player, "bot", 10.0)
    for time in (10.363, 10.4):
        episode.tick(time)
    recording = Recording(stream + recorder.record(episode.events()))
    assert [(frame["t"], frame.get("late", 0)) for frame in recording.steps] == [
        (200, 163),
        (400, 0),
    ]
    assert recording.verify().ok


def test_file_names() -> None:
    name = file_name("20261122T191339Z", "multi agent/01", "0123")
    assert name == "20261122T191339Z_multi-agent-01_0123.rbt.part"
    assert recording_stem(name) == recording_stem("20261122T191339Z_multi-agent-01_0123.rbt")
    assert is_recording_name(name)
    assert not is_recording_name("../secret.rbt")
