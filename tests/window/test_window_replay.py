"""A recording in a window shows who played when, and what stopped the game."""

from __future__ import annotations

import pytest
from robotouille_client.window.sources.replay import ReplaySource, notices_at, seats_at
from tests.support.games import record

from robotouille import World
from robotouille.episode import Absence, Clock, Episode, PauseReason, Rules
from robotouille.replay.recording import Recording

WORLD = World("multi_agent/01")


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Two steps a second: bob is away in the steps 3 and 4, the operator pauses after step 6."""
    rules = Rules(
        clock=Clock.REALTIME, step_rate=2.0, absence=Absence.BOT, stand_in="random", max_steps=8
    )
    episode = Episode(WORLD, rules)
    episode.join("robot1", "ada", "human", 0.0)
    episode.join("robot2", "bob", "human", 0.0)
    episode.tick(1.0)
    episode.set_present("robot2", False, 1.0)
    episode.tick(2.0)
    episode.set_present("robot2", True, 2.0)
    episode.tick(3.0)
    episode.pause(PauseReason.OPERATOR, 3.0)
    episode.announce("lunch", 4.0)
    episode.resume(PauseReason.OPERATOR, 10.0)
    episode.tick(12.0)
    return Recording(record(episode, episode.events()))


def test_seats_are_those_of_each_step(recording: Recording) -> None:
    course = [seats[1].moved_by for seats in seats_at(recording)]
    assert len(course) == len(recording.steps) + 1 == 9
    assert course == ["human"] * 3 + ["random plays for bob"] * 2 + ["human"] * 4
    assert {seats[0].moved_by for seats in seats_at(recording)} == {"human"}


def test_pauses_and_announcements_are_told_at_their_step_for_a_while(recording: Recording) -> None:
    told = notices_at(recording, 2)
    assert set(told) == {6, 7}
    assert told[6] == "Paused for 7 s: by the operator · The operator: lunch"
    assert notices_at(recording, 0).keys() == {6}


def test_the_source_shows_both(recording: Recording) -> None:
    source = ReplaySource(recording, 0.25, lambda: 0.0)
    source.seek(3)
    view = source.view()
    assert (view.step, view.seats[1].stand_in, view.notice) == (3, "random", "")
    source.seek(3)
    view = source.view()
    assert (view.step, view.seats[1].stand_in) == (6, "")
    assert "lunch" in view.notice
