"""Readiness: the start waits for every participant."""

from __future__ import annotations

import pytest

from robotouille.episode import (
    Absence,
    ActionRequest,
    Clock,
    CountdownChanged,
    Departure,
    Episode,
    ReadinessChanged,
    Started,
    Stepped,
)
from robotouille.errors import ProtocolError
from tests.support.episodes import first, opened


def both(episode: Episode) -> Episode:
    """Seat a person who is not ready, and a bot."""
    episode.join("robot1", "ada", "human", 0.0, ready=False)
    episode.join("robot2", "bob", "bot", 1.0)
    return episode


@pytest.mark.parametrize("clock", list(Clock))
def test_start_waits_for_the_unready_participant(clock: Clock) -> None:
    episode = both(opened(clock=clock))
    episode.tick(500.0)
    assert (episode.in_progress, episode.starts_at, episode.due()) == (False, None, None)
    with pytest.raises(ProtocolError, match="waits until ada can begin") as refused:
        episode.submit("robot2", ActionRequest(1, first(episode, "robot2")), 500.0)
    assert refused.value.code == "episode/waiting"
    episode.set_ready("robot1", True, 501.0)
    episode.tick(504.0)
    assert episode.running


def test_countdown_starts_when_all_are_ready() -> None:
    episode = both(opened())
    assert [e for e in episode.events() if isinstance(e, ReadinessChanged)] == [
        ReadinessChanged("robot1", False)
    ]
    episode.set_ready("robot1", True, 10.0)
    assert episode.starts_at == 13.0
    assert episode.events() == [ReadinessChanged("robot1", True), CountdownChanged(3.0)]


def test_withdrawing_readiness_stops_the_countdown() -> None:
    episode = both(opened())
    episode.set_ready("robot1", True, 10.0)
    episode.events()
    episode.set_ready("robot1", False, 12.0)
    assert episode.events() == [ReadinessChanged("robot1", False), CountdownChanged(None)]
    episode.tick(14.0)
    assert episode.starts_at is None
    assert not episode.in_progress


def test_unchanged_readiness_is_not_reported() -> None:
    episode = both(opened())
    episode.events()
    episode.set_ready("robot1", False, 5.0)
    episode.set_ready("robot2", True, 5.0)
    assert not episode.events()


def test_readiness_has_no_effect_after_the_start() -> None:
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


def test_all_seats_of_a_participant_are_ready_together() -> None:
    episode = opened()
    episode.join_several(["robot1", "robot2"], "ada", "human", 0.0, ready=False)
    assert not any(seat.ready for seat in episode.seats.values())
    episode.set_ready(["robot1", "robot2"], True, 1.0)
    assert episode.starts_at == 4.0


class TestSomebodyGoes:
    def test_returning_participant_keeps_readiness(self) -> None:
        episode = both(opened())
        episode.set_ready("robot1", True, 2.0)
        episode.set_present("robot1", False, 3.0)
        assert episode.starts_at is None
        episode.set_present("robot1", True, 9.0)
        assert episode.starts_at == 12.0

    @pytest.mark.parametrize("absence", list(Absence))
    def test_absent_unready_participant_loses_the_seat(self, absence: Absence) -> None:
        episode = both(opened(absence=absence))
        episode.set_present("robot1", False, 3.0)
        assert episode.due() == 33.0
        episode.tick(33.0)
        assert not episode.seats["robot1"].taken
        episode.join(None, "carol", "bot", 40.0)
        assert any(isinstance(event, Started) for event in episode.events())

    def test_next_participant_of_a_seat_is_asked_again(self) -> None:
        episode = both(opened())
        episode.leave("robot1", 2.0)
        assert episode.seats["robot1"].ready
        episode.join("robot1", "carol", "human", 3.0)
        assert episode.starts_at == 6.0


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
