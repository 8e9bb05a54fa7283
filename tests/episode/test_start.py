"""When a game begins: everybody is there, and has been counted down to where people play."""

from __future__ import annotations

import pytest

from robotouille.episode import (
    Clock,
    CountdownChanged,
    Departure,
    Episode,
    Started,
    Stepped,
)
from robotouille.errors import ProtocolError
from tests.support.episodes import first, opened


def countdowns(episode: Episode) -> list[float | None]:
    return [event.seconds for event in episode.events() if isinstance(event, CountdownChanged)]


class TestEverybodyIsThere:
    @pytest.mark.parametrize("clock", list(Clock))
    def test_no_game_begins_without_somebody_who_joined_and_is_gone(self, clock: Clock) -> None:
        episode = opened(clock=clock, countdown=0)
        episode.join("robot1", "ada", "bot", 0.0)
        episode.set_present("robot1", False, 1.0)
        episode.join("robot2", "bob", "bot", 5.0)
        episode.tick(30.0)
        assert not episode.in_progress
        assert not any(isinstance(event, Started | Stepped) for event in episode.events())
        with pytest.raises(ProtocolError, match="waits for 1 more player"):
            episode.submit("robot2", 1, first(episode, "robot2"), 30.0)

    def test_it_begins_when_the_absent_one_is_back(self) -> None:
        episode = opened(countdown=0)
        episode.join("robot1", "ada", "bot", 0.0)
        episode.set_present("robot1", False, 1.0)
        episode.join("robot2", "bob", "bot", 5.0)
        episode.set_present("robot1", True, 9.0)
        assert episode.running

    def test_it_begins_when_somebody_else_takes_the_seat_that_was_given_up(self) -> None:
        episode = opened(countdown=0)
        episode.join("robot1", "ada", "bot", 0.0)
        episode.set_present("robot1", False, 1.0)
        episode.join("robot2", "bob", "bot", 5.0)
        episode.tick(31.0)
        episode.join(None, "carol", "bot", 32.0)
        assert episode.running


class TestCountdown:
    def test_a_game_with_a_person_is_counted_down_to(self) -> None:
        episode = opened()
        episode.join("robot1", "ada", "human", 0.0)
        episode.join("robot2", "bob", "bot", 5.0)
        assert countdowns(episode) == [3.0]
        assert (episode.starts_at, episode.due()) == (8.0, 8.0)
        episode.tick(7.9)
        assert not episode.in_progress
        with pytest.raises(ProtocolError, match="begins in a moment"):
            episode.submit("robot1", 1, first(episode, "robot1"), 7.9)
        episode.tick(8.0)
        assert episode.running
        assert episode.starts_at is None
        assert episode.due() == pytest.approx(8.1)

    def test_who_is_lost_meanwhile_calls_it_off_and_it_begins_anew(self) -> None:
        episode = opened()
        episode.join("robot1", "ada", "human", 0.0)
        episode.join("robot2", "bob", "human", 0.0)
        episode.set_present("robot2", False, 2.0)
        episode.tick(10.0)
        assert not episode.in_progress
        episode.set_present("robot2", True, 11.0)
        assert countdowns(episode) == [3.0, None, 3.0]
        assert episode.starts_at == 14.0

    def test_who_leaves_meanwhile_calls_it_off(self) -> None:
        episode = opened()
        episode.join("robot1", "ada", "human", 0.0)
        episode.join("robot2", "bob", "human", 0.0)
        episode.leave("robot2", 1.0, Departure.LEFT)
        assert countdowns(episode) == [3.0, None]
        episode.abort(2.0, "stopped")
        assert episode.starts_at is None

    @pytest.mark.parametrize(
        ("kind", "rules"),
        [
            ("bot", {}),
            ("model", {}),
            ("human", {"countdown": 0.0}),
            ("human", {"clock": Clock.LOCKSTEP}),
            ("human", {"clock": Clock.TURN}),
            ("human", {"thinking": "declared"}),
        ],
    )
    def test_others_begin_at_once(self, kind: str, rules: dict[str, object]) -> None:
        episode = opened(**rules)
        episode.join("robot1", "ada", kind, 0.0)
        episode.join("robot2", "bob", kind, 0.0)
        assert episode.running
        assert not countdowns(episode)
