"""A game begins when everybody is there and ready."""

from __future__ import annotations

import pytest

from robotouille.episode import (
    Absence,
    Clock,
    CountdownChanged,
    Episode,
    ReadinessChanged,
    Started,
)
from robotouille.errors import ProtocolError
from tests.support.episodes import first, opened


def both(episode: Episode) -> Episode:
    """Ada will say when she is ready; Bob is a bot."""
    episode.join("robot1", "ada", "human", 0.0, ready=False)
    episode.join("robot2", "bob", "bot", 1.0)
    return episode


@pytest.mark.parametrize("clock", list(Clock))
def test_it_waits_for_who_has_not_said_so(clock: Clock) -> None:
    episode = both(opened(clock=clock))
    episode.tick(500.0)
    assert (episode.in_progress, episode.starts_at, episode.due()) == (False, None, None)
    with pytest.raises(ProtocolError, match="waits until ada can begin") as refused:
        episode.submit("robot2", 1, first(episode, "robot2"), 500.0)
    assert refused.value.code == "episode/waiting"
    episode.set_ready("robot1", True, 501.0)
    episode.tick(504.0)
    assert episode.running


def test_it_is_counted_down_to_from_then_on() -> None:
    episode = both(opened())
    assert [e for e in episode.events() if isinstance(e, ReadinessChanged)] == [
        ReadinessChanged("robot1", False)
    ]
    episode.set_ready("robot1", True, 10.0)
    assert episode.starts_at == 13.0
    assert episode.events() == [ReadinessChanged("robot1", True), CountdownChanged(3.0)]


def test_to_take_it_back_stops_the_countdown() -> None:
    episode = both(opened())
    episode.set_ready("robot1", True, 10.0)
    episode.events()
    episode.set_ready("robot1", False, 12.0)
    assert episode.events() == [ReadinessChanged("robot1", False), CountdownChanged(None)]
    episode.tick(14.0)
    assert episode.starts_at is None
    assert not episode.in_progress


def test_the_same_again_is_no_news() -> None:
    episode = both(opened())
    episode.events()
    episode.set_ready("robot1", False, 5.0)
    episode.set_ready("robot2", True, 5.0)
    assert not episode.events()


def test_it_means_nothing_once_the_game_has_begun() -> None:
    episode = both(opened(countdown=0))
    episode.set_ready("robot1", True, 5.0)
    assert episode.running
    episode.events()
    episode.set_ready("robot1", False, 6.0)
    assert not episode.events()
    assert episode.seats["robot1"].ready
    episode.leave("robot1", 7.0)
    episode.join("robot1", "carol", "human", 8.0, ready=False)
    assert episode.seats["robot1"].ready


def test_of_several_seats_all_are_ready_together() -> None:
    episode = opened()
    episode.join_several(["robot1", "robot2"], "ada", "human", 0.0, ready=False)
    assert not any(seat.ready for seat in episode.seats.values())
    episode.set_ready(["robot1", "robot2"], True, 1.0)
    assert episode.starts_at == 4.0


class TestSomebodyGoes:
    def test_who_comes_back_is_as_ready_as_before(self) -> None:
        episode = both(opened())
        episode.set_ready("robot1", True, 2.0)
        episode.set_present("robot1", False, 3.0)
        assert episode.starts_at is None
        episode.set_present("robot1", True, 9.0)
        assert episode.starts_at == 12.0

    @pytest.mark.parametrize("absence", list(Absence))
    def test_who_is_not_ready_and_stays_away_loses_the_seat(self, absence: Absence) -> None:
        """Nobody is waited for longer than before there was readiness."""
        episode = both(opened(absence=absence))
        episode.set_present("robot1", False, 3.0)
        assert episode.due() == 33.0
        episode.tick(33.0)
        assert not episode.seats["robot1"].taken
        episode.join(None, "carol", "bot", 40.0)
        assert any(isinstance(event, Started) for event in episode.events())

    def test_the_next_one_in_a_seat_is_asked_anew(self) -> None:
        episode = both(opened())
        episode.leave("robot1", 2.0)
        assert episode.seats["robot1"].ready
        episode.join("robot1", "carol", "human", 3.0)
        assert episode.starts_at == 6.0
