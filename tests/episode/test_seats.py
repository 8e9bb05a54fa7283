"""A seat's decisions: what becomes of them, in which order, and how they are counted."""

from __future__ import annotations

from robotouille.episode import ActionAnswer, Controller, Departure, SeatTally
from robotouille.episode.lifecycle import SeatState
from robotouille.episode.seats import PendingAction, Seat, joint_action
from tests.support.episodes import TWO

ADA, BOB = TWO.players
STATE = TWO.initial


def seat(player: str, pending: PendingAction | None = None) -> Seat:
    sat = Seat(player, tally=SeatTally(player))
    sat.take(player.upper(), "human", f"s-{player}", f"p-{player}", 0.0)
    sat.pending = pending
    return sat


def pending(player: str, seq: int, order: int, due_step: int = 0) -> PendingAction:
    return PendingAction(STATE.actions(player)[0], seq, 0.5, order, due_step)


def test_moves_come_in_seat_order_or_in_that_of_their_arrival() -> None:
    for by_arrival, players in ((False, [ADA, BOB]), (True, [BOB, ADA])):
        seats = [seat(ADA, pending(ADA, 1, order=2)), seat(BOB, pending(BOB, 4, order=1))]
        moves, idle = joint_action(seats, STATE, 0, by_arrival=by_arrival)
        assert [move.player for move in moves] == players
        assert idle == ()
        assert [one.pending for one in seats] == [None, None]
        assert [one.answer for one in seats] == [ActionAnswer(1, 1), ActionAnswer(4, 1)]


def test_a_decision_for_later_waits() -> None:
    sat = seat(ADA, pending(ADA, 1, order=1, due_step=2))
    assert joint_action([sat], STATE, 1, by_arrival=False) == ((), ())
    assert sat.pending is not None
    moves, _ = joint_action([sat], STATE, 2, by_arrival=False)
    assert (len(moves), sat.answer) == (1, ActionAnswer(1, 3))


def test_nothing_is_a_decision_of_a_participant_and_none_of_a_stand_in() -> None:
    seats = [
        seat(ADA, PendingAction(None, 3, 0.0, 1, 0)),
        seat(BOB, PendingAction(None, 0, 0.0, 2, 0)),
    ]
    assert joint_action(seats, STATE, 5, by_arrival=False) == ((), ((ADA, 3),))
    assert [one.answer for one in seats] == [ActionAnswer(3, 6), ActionAnswer(0, 0)]


def test_a_step_waits_only_for_those_who_decide() -> None:
    sat = seat(ADA)
    assert not sat.decided(STATE)
    sat.pending = pending(ADA, 1, 1)
    assert sat.decided(STATE)
    sat.pending = None
    sat.lose_connection(1.0)
    assert sat.decided(STATE)
    sat.controller = Controller.STAND_IN
    assert not sat.decided(STATE)


def test_the_next_participant_finds_nothing_of_the_last_one() -> None:
    sat = seat(ADA, pending(ADA, 7, 1))
    sat.seq, sat.generation, sat.answer = 7, 3, ActionAnswer(6, 2)
    sat.vacate(1.0)
    assert (sat.name, sat.session, sat.generation, sat.pending) == ("", "", 0, None)
    change = sat.roster_change(1.5, Departure.LOST)
    assert (change.taken, change.present, change.why) == (False, False, Departure.LOST)
    sat.take("eve", "bot", "s", "p", 2.0)
    assert (sat.seq, sat.answer, sat.asked_at) == (0, ActionAnswer(0, 0), 2.0)
    assert sat.state is SeatState.PRESENT
