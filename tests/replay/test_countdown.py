"""The seconds before a game: recorded, told in words, and no obstacle to a restart."""

from __future__ import annotations

from robotouille.episode import Clock, Episode, Rules
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore
from robotouille.replay.timeline import note_lines
from tests.support.episodes import TWO

RULES = Rules(clock=Clock.REALTIME, step_rate=10.0, countdown=3.0)


def counted_down(until: float) -> Recording:
    """Two people came at 5 s, one was away from 6 s to 7 s, and time has passed `until` then."""
    recorder = Recorder(TWO, wall=lambda: 1000.0)
    episode = Episode(TWO, RULES)
    content = recorder.begin(header(TWO.task, RULES, episode="e"))
    episode.join("robot1", "ada", "human", 5.0, session="s1")
    episode.join("robot2", "bob", "human", 5.0, session="s2")
    episode.set_present("robot2", False, 6.0)
    episode.set_present("robot2", True, 7.0)
    episode.tick(until)
    return Recording(content + recorder.record(episode.events()), "test")


def test_it_is_recorded_with_the_time_by_the_wall() -> None:
    notes = [note for note in counted_down(10.5).notes() if note["note"] == "countdown"]
    told = [(note.get("ms"), note["t"], note["utc_ms"]) for note in notes]
    assert told == [(3000, 0, 1_000_000), (None, 0, 1_000_000), (3000, 0, 1_000_000)]


def test_it_is_told_in_words() -> None:
    told = "\n".join(note_lines(counted_down(10.5)))
    assert "everybody is there: the game begins in 3 s" in told
    assert "somebody is missing: the game does not begin yet" in told
    assert told.index("does not begin yet") < told.index("  the game begins")


def test_the_rules_say_how_long_it_is() -> None:
    assert counted_down(8.0).header["rules"]["countdown"] == 3.0
    assert "countdown" not in Rules().model_dump(mode="json")


def test_after_a_restart_it_is_counted_down_anew_once_all_are_back() -> None:
    episode = restore(counted_down(8.0), now=100.0, patience=10.0).episode
    assert not episode.in_progress
    assert episode.starts_at is None
    episode.set_present("robot1", True, 101.0)
    assert episode.starts_at is None
    episode.set_present("robot2", True, 102.0)
    assert episode.starts_at == 105.0
    episode.tick(105.0)
    assert episode.running
