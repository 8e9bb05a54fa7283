"""Actions without an answer: each seat has its own, the numbers are of all together."""

from __future__ import annotations

import pytest

from robotouille.protocol import messages
from robotouille.world.unmet import Unmet, UnmetKind
from robotouille_client.sansio.game_events import ActResult
from robotouille_client.sansio.sent_actions import REPEAT_SECONDS, SLOW_DOWN_SECONDS, SentActions

ADA, BOB = "robot1", "robot2"


def send(sent: SentActions, seat: str, now: float = 0.0, action: str | None = "Wait") -> int:
    act = messages.Act(seq=sent.next_seq(), action=action, seat=seat)
    sent.add(seat, act, now)
    return act.seq


@pytest.fixture
def sent() -> SentActions:
    return SentActions(4)


def test_one_counter_numbers_the_actions_of_all_seats(sent: SentActions) -> None:
    assert [send(sent, seat) for seat in (ADA, BOB, ADA)] == [5, 6, 7]
    assert [act.seq for act in sent.unanswered] == [7, 6]


def test_what_a_seat_does_replaces_its_own_actions_only(sent: SentActions) -> None:
    first, other, second = send(sent, ADA), send(sent, BOB), send(sent, ADA)
    sent.settle(ADA, second, ActResult(True, 1))
    superseded = Unmet(UnmetKind.SUPERSEDED, f"superseded by action {second}")
    assert sent.results() == [
        (first, ActResult(False, 1, (superseded,), "action/invalid")),
        (second, ActResult(True, 1)),
    ]
    assert [act.seq for act in sent.unanswered] == [other]
    sent.settle(BOB, other, ActResult(True, 1))
    assert sent.results() == [(other, ActResult(True, 1))]
    assert sent.get_timer() is None


def test_a_later_answer_of_one_seat_says_nothing_of_another(sent: SentActions) -> None:
    other, mine = send(sent, BOB), send(sent, ADA)
    sent.settle(ADA, mine, ActResult(True, 1))
    sent.settle(None, 0, ActResult(True, 1))
    assert sent.results() == [(mine, ActResult(True, 1))]
    assert [act.seq for act in sent.unanswered] == [other]


def test_each_seat_is_asked_for_again_in_its_own_time(sent: SentActions) -> None:
    first, second = send(sent, ADA, 1.0), send(sent, BOB, 2.0)
    assert sent.get_timer() == 1.0 + REPEAT_SECONDS
    assert [act.seq for act in sent.repeat(1.0 + REPEAT_SECONDS)] == [first]
    assert sent.get_timer() == 2.0 + REPEAT_SECONDS
    assert sent.slow_down(second, 3.0)
    assert not sent.slow_down(99, 3.0)
    assert sent.get_timer() == 3.0 + SLOW_DOWN_SECONDS
    assert [act.seq for act in sent.repeat(3.0, all_of_them=True)] == [first, second]


def test_doing_nothing_is_answered_in_ones_own_turn(sent: SentActions) -> None:
    first, second, third = send(sent, ADA, action=None), send(sent, BOB, action=None), 0
    sent.settle_idle(1, ADA)
    assert sent.results() == [(first, ActResult(True, 1))]
    third = send(sent, ADA, action=None)
    sent.settle_idle(2, None)
    assert [seq for seq, _ in sent.results()] == [second, third]


def test_a_rejection_leaves_what_still_waits(sent: SentActions) -> None:
    first, second = send(sent, ADA), send(sent, ADA)
    refused = ActResult(False, 0, (), "action/invalid")
    sent.resolve(second, refused)
    sent.resolve(second, refused)
    assert sent.results() == [(second, refused)]
    assert sent.unanswered == ()
    sent.settle(ADA, first, ActResult(True, 1))
    assert sent.results() == [(first, ActResult(True, 1))]


def test_the_end_answers_all(sent: SentActions) -> None:
    numbers = [send(sent, seat) for seat in (BOB, ADA)]
    sent.resolve_all(7, "it is over", "episode/over")
    sent.refuse(9, 7, "it is over", "episode/over")
    results = sent.results()
    assert [seq for seq, _ in results] == [*numbers, 9]
    assert {(result.step, result.code) for _, result in results} == {(7, "episode/over")}
