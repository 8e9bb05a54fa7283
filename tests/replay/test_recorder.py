"""What a recorder writes: frames that anybody can read, none larger than readers take."""

from __future__ import annotations

import msgpack
import pytest

from robotouille import World
from robotouille.episode import (
    Absence,
    Clock,
    Episode,
    Paused,
    PauseReason,
    Rejected,
    Restarted,
    Resumed,
    Rules,
    Started,
)
from robotouille.replay.container import magic, read_frames
from robotouille.replay.recorder import (
    HASH_EVERY,
    MAX_NOTES,
    SNAPSHOT_EVERY,
    Recorder,
    iso_time,
)
from robotouille.replay.recording import Recording
from robotouille.world.unmet import only_words
from tests.support.episodes import TWO
from tests.support.games import record, recorded_game

GAME = recorded_game("multi_agent/10@3", seed=5, steps=130)


def test_frames_are_plain_messagepack() -> None:
    """Anybody can read them: four bytes of length, twice four of CRC-32, then MessagePack."""
    length = int.from_bytes(GAME[5:9], "little")
    assert msgpack.unpackb(GAME[17 : 17 + length])["kind"] == "header"


def test_many_long_notes_at_once_take_several_frames() -> None:
    """What waited for a full disk, say: each frame is one that readers take."""

    world = World("synchronous/01")
    rejected = Rejected(
        player="robot1", seq=1, action="a" * 300, unmet=only_words(*["r" * 500] * 4),
        reasoning="\N{ROBOT FACE}" * 8000, time=0.0,
    )  # fmt: skip
    written = Recorder(world).record([rejected] * (3 * MAX_NOTES))
    frames = list(read_frames(magic(2) + written))
    assert [len(frame["notes"]) for frame in frames] == [MAX_NOTES] * 3


def test_hashes_and_keyframes_come_at_their_steps() -> None:
    recording = Recording(GAME)
    hashed = [frame["step"] for frame in recording.steps if "hash" in frame]
    assert hashed == [n for n in range(1, recording.length + 1) if n % HASH_EVERY == 0]
    keyframes = [frame["step"] for frame in recording.frames if frame["kind"] == "state"]
    assert keyframes == [n for n in range(recording.length + 1) if n % SNAPSHOT_EVERY == 0]


def test_the_bytes_depend_on_the_events_alone() -> None:
    assert recorded_game("multi_agent/10@3", seed=5, steps=130) == GAME


@pytest.mark.parametrize("absence", list(Absence))
def test_notes_hold_plain_texts(absence: Absence) -> None:
    """Enumerations are written as their values."""
    episode = Episode(TWO, Rules(clock=Clock.REALTIME, absence=absence), 0.0)
    for player in TWO.players:
        episode.join(player, player.upper(), "human", 0.0)
    episode.set_present("robot2", False, 1.0)
    episode.pause(PauseReason.OPERATOR, 2.0)
    episode.leave("robot2", 3.0)
    stream = record(episode, episode.events())
    for note in Recording(stream).notes():
        assert {type(value) for value in note.values()} <= {str, int, bool, list}
    why = [note.get("why") for note in Recording(stream).notes() if note.get("why")]
    assert why == ["left"]


def test_what_time_it_was_is_written_where_time_begins_to_run() -> None:
    """By the clock that the recorder was given, and by none without one."""
    events = [Started(0.0), Paused((PauseReason.OPERATOR,), 1.0), Resumed(2.0), Restarted(3.0)]
    seconds = iter([1_800_000_000.0, 1_800_000_002.0005, 1_800_000_009.25])
    for wall, expected in (
        (lambda: next(seconds), [1_800_000_000_000, None, 1_800_000_002_000, 1_800_000_009_250]),
        (None, [None] * 4),
    ):
        written = Recorder(TWO, wall=wall).record(events)
        (frame,) = read_frames(magic(2) + written)
        assert [note.get("utc_ms") for note in frame["notes"]] == expected


@pytest.mark.parametrize(
    ("created", "told"),
    [
        ("20261122T191339Z", "2026-11-22T19:13:39Z"),
        ("2026-11-22T19:13:39Z", "2026-11-22T19:13:39Z"),
        ("", ""),
        ("yesterday", "yesterday"),
    ],
)
def test_times_are_told_so_that_they_compare_with_dates(created: str, told: str) -> None:
    assert iso_time(created) == told
