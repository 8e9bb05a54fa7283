"""The tables of the life cycles: walked completely, and obeyed by episodes and seats."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from itertools import product
from typing import Any

import pytest

from robotouille import World
from robotouille.episode import (
    Controller,
    Ended,
    Outcome,
    Paused,
    PauseReason,
    Phase,
    Reason,
    RecoveredEpisode,
    Resumed,
    Rules,
    Seat,
    Started,
)
from robotouille.episode.lifecycle import (
    PHASES,
    SEAT_STATES,
    PhaseEvent,
    SeatEvent,
    SeatState,
    next_phase,
    next_seat_state,
)
from robotouille.errors import IllegalEventError

WORLD = World("multi_agent/01")
EVENTS = {
    PhaseEvent.START: Started,
    PhaseEvent.PAUSE: Paused,
    PhaseEvent.RESUME: Resumed,
    PhaseEvent.END: Ended,
}


def rows(table: Mapping[Any, Mapping[Any, Any]]) -> dict[tuple[Enum, Enum], Enum]:
    return {(state, event): then for state, row in table.items() for event, then in row.items()}


def in_phase(phase: Phase) -> RecoveredEpisode:
    """An episode that has come there by what people do."""
    episode = RecoveredEpisode(WORLD, Rules(), 0.0)
    if phase is not Phase.WAITING:
        for player in WORLD.players:
            episode.join(player, player, "human", 0.0)
    if phase is Phase.PAUSED:
        episode.pause(PauseReason.OPERATOR, 1.0)
    if phase is Phase.ENDED:
        episode.abort(1.0, "enough")
    episode.events()
    assert episode.phase is phase
    return episode


def start(episode: RecoveredEpisode) -> None:
    for player in WORLD.players:
        episode.join(player, player, "human", 2.0)


ACTIONS: dict[PhaseEvent, Callable[[RecoveredEpisode], object]] = {
    PhaseEvent.START: start,
    PhaseEvent.PAUSE: lambda episode: episode.pause(PauseReason.STORAGE, 2.0),
    PhaseEvent.RESUME: lambda episode: episode.resume(PauseReason.OPERATOR, 2.0),
    PhaseEvent.END: lambda episode: episode.abort(2.0, "enough"),
}


class TestPhases:
    def test_every_phase_has_a_row_and_only_the_end_is_final(self) -> None:
        assert set(PHASES) == set(Phase)
        assert [phase for phase, row in PHASES.items() if not row] == [Phase.ENDED]

    @pytest.mark.parametrize(("phase", "event"), list(product(Phase, PhaseEvent)))
    def test_every_pair_goes_on_or_raises(self, phase: Phase, event: PhaseEvent) -> None:
        if event in PHASES[phase]:
            assert next_phase(phase, event) is PHASES[phase][event]
            return
        with pytest.raises(IllegalEventError) as error:
            next_phase(phase, event)
        assert (error.value.state, error.value.event) == (phase.name, event.name)

    @pytest.mark.parametrize(("phase", "event"), list(rows(PHASES)))
    def test_an_episode_takes_every_transition_and_reports_it(
        self, phase: Phase, event: PhaseEvent
    ) -> None:
        episode = in_phase(phase)
        ACTIONS[event](episode)
        assert episode.phase is PHASES[phase][event]
        reported = [type(e) for e in episode.events() if type(e) in EVENTS.values()]
        assert reported == [EVENTS[event]]

    @pytest.mark.parametrize("phase", [p for p in Phase if PhaseEvent.START not in PHASES[p]])
    def test_what_is_illegal_raises_and_changes_nothing(self, phase: Phase) -> None:
        episode = in_phase(phase)
        with pytest.raises(IllegalEventError):
            episode.replay_start()
        assert (episode.phase, episode.events()) == (phase, [])

    def test_an_end_that_is_not_the_first_changes_nothing(self) -> None:
        episode = in_phase(Phase.ENDED)
        outcome = episode.outcome
        with pytest.raises(IllegalEventError):
            episode.restore_ended(Outcome(Reason.GOAL, 1, 1.0, ()))
        assert episode.outcome is outcome

    @pytest.mark.parametrize("event", [PhaseEvent.PAUSE, PhaseEvent.RESUME, PhaseEvent.END])
    def test_after_the_end_nothing_happens(self, event: PhaseEvent) -> None:
        episode = in_phase(Phase.ENDED)
        ACTIONS[event](episode)
        assert (episode.phase, episode.events()) == (Phase.ENDED, [])

    def test_the_phase_says_what_the_properties_say(self) -> None:
        found = {
            phase: (e.in_progress, e.running, e.paused, e.ended)
            for phase in Phase
            for e in [in_phase(phase)]
        }
        assert found == {
            Phase.WAITING: (False, False, False, False),
            Phase.RUNNING: (True, True, False, False),
            Phase.PAUSED: (True, False, True, False),
            Phase.ENDED: (False, False, False, True),
        }


def sit(seat: Seat) -> None:
    seat.take("ada", "human", "s", "p", 0.0)


SEAT_ACTIONS: dict[SeatEvent, Callable[[Seat], None]] = {
    SeatEvent.TAKE: sit,
    SeatEvent.LOSE: lambda seat: seat.lose_connection(1.0),
    SeatEvent.RETURN: lambda seat: seat.come_back(2.0),
    SeatEvent.VACATE: lambda seat: seat.vacate(3.0),
}
WAYS: dict[SeatState, tuple[SeatEvent, ...]] = {
    SeatState.FREE: (),
    SeatState.PRESENT: (SeatEvent.TAKE,),
    SeatState.ABSENT: (SeatEvent.TAKE, SeatEvent.LOSE),
}


class TestSeats:
    def test_every_state_has_a_row(self) -> None:
        assert set(SEAT_STATES) == set(SeatState) == set(WAYS)

    @pytest.mark.parametrize(("state", "event"), list(product(SeatState, SeatEvent)))
    def test_every_pair_goes_on_or_raises_and_changes_nothing(
        self, state: SeatState, event: SeatEvent
    ) -> None:
        seat = Seat("robot1")
        for earlier in WAYS[state]:
            SEAT_ACTIONS[earlier](seat)
        assert seat.state is state
        before = (seat.name, seat.session, seat.controller, seat.quota.limit)
        if event in SEAT_STATES[state]:
            SEAT_ACTIONS[event](seat)
            assert seat.state is SEAT_STATES[state][event] is next_seat_state(state, event)
            return
        with pytest.raises(IllegalEventError):
            SEAT_ACTIONS[event](seat)
        assert seat.state is state
        assert (seat.name, seat.session, seat.controller, seat.quota.limit) == before

    def test_the_state_says_who_is_there(self) -> None:
        found = {}
        for state in SeatState:
            seat = Seat("robot1", state=state, controller=Controller.ABSENT)
            found[state] = (seat.taken, seat.present, seat.active)
        assert found == {
            SeatState.FREE: (False, False, False),
            SeatState.PRESENT: (True, True, True),
            SeatState.ABSENT: (True, False, False),
        }
