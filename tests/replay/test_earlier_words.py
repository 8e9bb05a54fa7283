"""Recordings in which reasons are told as earlier versions did are read, and go on."""

from __future__ import annotations

import pytest

from robotouille.episode import Clock, Episode, Rules
from robotouille.replay.recorder import Recorder, header
from robotouille.replay.recording import Recording
from robotouille.replay.restore import restore
from robotouille.world.unmet import Attempt, Unmet, UnmetKind, earlier_words, need
from tests.support.episodes import TWO

RULES = Rules(clock=Clock.REALTIME, step_rate=10.0)


def recorded(said: str) -> Recording:
    """A game in which both walk to one station in one step; `said` is what the loser is told."""
    episode = Episode(TWO, RULES)
    for player in TWO.players:
        episode.join(player, player, "bot", 0.0)
    free = {a.arguments[-1] for a in episode.state.actions("robot1") if a.name == "move"}
    free &= {a.arguments[-1] for a in episode.state.actions("robot2") if a.name == "move"}
    where = min(free)
    for player in TWO.players:
        (walk,) = [
            a for a in episode.state.actions(player)
            if a.name == "move" and a.arguments[-1] == where
        ]  # fmt: skip
        episode.submit(player, 1, walk, 0.0)
    episode.tick(0.1)
    events = []
    for event in episode.events():
        if hasattr(event, "attempts"):
            lost = event.attempts[1]._replace(
                unmet=(Unmet(UnmetKind.CONDITION, said.format(where), "vacant", (where,)),)
            )
            events.append(event._replace(attempts=(event.attempts[0], Attempt(*lost))))
        else:
            events.append(event)
    recorder = Recorder(TWO)
    content = recorder.begin(header(TWO.task, RULES, episode="e")) + recorder.record(events)
    return Recording(content, "test")


@pytest.mark.parametrize(
    "said", ["needs: {} has nobody standing at it", "{} has nobody standing at it"]
)
def test_both_ways_are_the_same_game(said: str) -> None:
    recording = recorded(said)
    verified = recording.verify()
    assert (verified.fault, verified.identical) == ("", True)
    assert restore(recording, 0.0, 1.0).episode.step == 1


def test_no_other_words_will_do() -> None:
    recording = recorded("{} is on fire")
    assert not recording.verify().identical


def test_a_need_cannot_be_read_as_what_is_so() -> None:
    assert need("robot1 stands at table1", True) == "needs: robot1 stands at table1"
    assert need("patty1 is cooking now", False) == "must not be: patty1 is cooking now"
    assert earlier_words(need("x", True)) == "x"
    assert earlier_words(need("x", False)) == "not: x"
    assert earlier_words("robot1 is busy for 2 more steps") == "robot1 is busy for 2 more steps"
