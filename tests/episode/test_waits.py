"""Who waits for a place or for somebody says so, and is not counted as idle."""

from __future__ import annotations

from dataclasses import asdict

from robotouille.episode import Clock, Episode, Rules, Stepped
from robotouille.replay.analysis.activities import activities
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore
from tests.support.episodes import TWO, first

RULES = Rules(clock=Clock.LOCKSTEP, max_steps=3)


def played() -> tuple[Episode, bytes]:
    """The first seat waits, idles, acts; the second one idles, waits, idles."""
    recorder = Recorder(TWO)
    episode = Episode(TWO, RULES)
    content = recorder.begin(header(TWO.task, RULES, episode="e"))
    for player in ("robot1", "robot2"):
        episode.join(player, player, "bot", 0.0, session=player)
    for seq, waits in enumerate(((True, False), (False, True), (True, False)), 1):
        action = first(episode, "robot1") if seq == 3 else None
        episode.submit("robot1", seq, action, float(seq), waits=waits[0])
        episode.submit("robot2", seq, None, float(seq), waits=waits[1])
    return episode, content + recorder.record(episode.events())


def test_it_is_counted_as_waiting() -> None:
    episode, _ = played()
    assert episode.outcome is not None
    one, two = (asdict(tally) for tally in episode.outcome.seats)
    assert (one["waiting"], one["idle"], one["acted"], one["rejected"]) == (1, 1, 1, 0)
    assert (two["waiting"], two["idle"], two["acted"], two["rejected"]) == (1, 2, 0, 0)


def test_it_is_recorded_and_counted_from_the_frames() -> None:
    recording = Recording(played()[1], "test")
    assert [frame.get("waits") for frame in recording.steps] == [["robot1"], ["robot2"], None]
    told = [tuple(seats.did.values()) for _, seats in activities(recording)]
    assert told == [("waiting", "idle"), ("idle", "waiting"), ("acted", "idle")]
    assert recording.verify().ok


def test_a_restart_counts_it_again() -> None:
    episode, content = played()
    again = restore(Recording(content, "test"), now=50.0, patience=1.0).episode
    before = [asdict(seat.tally) for seat in episode.seats.values()]
    assert [asdict(seat.tally) for seat in again.seats.values()] == before


def test_recordings_in_which_nobody_says_so_are_as_before() -> None:
    episode = Episode(TWO, RULES)
    for player in ("robot1", "robot2"):
        episode.join(player, player, "bot", 0.0)
    for player in ("robot1", "robot2"):
        episode.submit(player, 1, None, 1.0)
    (step,) = [event for event in episode.events() if isinstance(event, Stepped)]
    assert step.waits == ()
    assert episode.seats["robot1"].tally.idle == 1
