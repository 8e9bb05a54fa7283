"""Start of a game: all participants present, and a countdown for people."""

from __future__ import annotations

import pytest

from robotouille.episode import (
    ActionRequest,
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
    def test_start_waits_for_an_absent_participant(self, clock: Clock) -> None:
        episode = opened(clock=clock, countdown=0)
        episode.join("robot1", "ada", "bot", 0.0)
        episode.set_present("robot1", False, 1.0)
        episode.join("robot2", "bob", "bot", 5.0)
        episode.tick(30.0)
        assert not episode.in_progress
        assert not any(isinstance(event, Started | Stepped) for event in episode.events())
        with pytest.raises(ProtocolError, match="waits for 1 more player"):
            episode.submit("robot2", ActionRequest(1, first(episode, "robot2")), 30.0)

    def test_game_starts_when_the_absent_participant_is_back(self) -> None:
        episode = opened(countdown=0)
        episode.join("robot1", "ada", "bot", 0.0)
        episode.set_present("robot1", False, 1.0)
        episode.join("robot2", "bob", "bot", 5.0)
        episode.set_present("robot1", True, 9.0)
        assert episode.running


class TestCountdown:
    def test_countdown_before_a_game_with_a_person(self) -> None:
        episode = opened()
        episode.join("robot1", "ada", "human", 0.0)
        episode.join("robot2", "bob", "bot", 5.0)
        assert countdowns(episode) == [3.0]
        assert (episode.starts_at, episode.due()) == (8.0, 8.0)
        episode.tick(7.9)
        assert not episode.in_progress
        with pytest.raises(ProtocolError, match="starts in a moment"):
            episode.submit("robot1", ActionRequest(1, first(episode, "robot1")), 7.9)
        episode.tick(8.0)
        assert episode.running
        assert episode.starts_at is None
        assert episode.due() == pytest.approx(8.1)

    def test_lost_connection_restarts_the_countdown(self) -> None:
        episode = opened()
        episode.join("robot1", "ada", "human", 0.0)
        episode.join("robot2", "bob", "human", 0.0)
        episode.set_present("robot2", False, 2.0)
        episode.tick(10.0)
        assert not episode.in_progress
        episode.set_present("robot2", True, 11.0)
        assert countdowns(episode) == [3.0, None, 3.0]
        assert episode.starts_at == 14.0

    def test_departure_stops_the_countdown(self) -> None:
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
    def test_other_games_start_without_countdown(self, kind: str, rules: dict[str, object]) -> None:
        episode = opened(**rules)
        episode.join("robot1", "ada", kind, 0.0)
        episode.join("robot2", "bob", kind, 0.0)
        assert episode.running
        assert not countdowns(episode)
