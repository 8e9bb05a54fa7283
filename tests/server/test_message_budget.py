"""What one connection may send, what is refused of it, and when that is too much."""

from __future__ import annotations

import pytest

from robotouille.errors import ProtocolError
from robotouille_server.conversation.message_budget import (
    KIB,
    MAX_HELLO_BYTES,
    FloodError,
    MessageBudget,
)

RATE = 10.0
BURST = 2 * RATE


@pytest.fixture
def budget() -> MessageBudget:
    return MessageBudget(RATE, 0.0)


def affordable(budget: MessageBudget, now: float, size: int = 0, answered: int = 0) -> bool:
    return budget.charge(now, size, answered, greeted=True)


def test_so_many_messages_come_at_once_and_so_many_a_second(budget: MessageBudget) -> None:
    assert sum(affordable(budget, 0.0) for _ in range(50)) == BURST
    assert sum(affordable(budget, 1.0) for _ in range(50)) == RATE
    assert budget.exceeded == "more than 10 messages a second"


def test_a_long_message_and_a_long_answer_cost_more(budget: MessageBudget) -> None:
    assert affordable(budget, 0.0, size=4 * KIB)
    assert not budget.take(0.0, BURST - 4)
    assert budget.take(0.0, BURST - 5)
    later = BURST / RATE
    assert affordable(budget, later, answered=round(BURST - 1) * KIB)
    assert not affordable(budget, later)


def test_before_hello_nothing_long_is_read(budget: MessageBudget) -> None:
    assert budget.charge(0.0, MAX_HELLO_BYTES, 0, greeted=False)
    with pytest.raises(ProtocolError, match="before hello") as refused:
        budget.charge(0.0, MAX_HELLO_BYTES + 1, 0, greeted=False)
    assert refused.value.code == "message/too-large"


def test_of_what_is_refused_only_what_is_short_is_read(budget: MessageBudget) -> None:
    budget.take(0.0, BURST)
    assert not affordable(budget, 0.0, size=MAX_HELLO_BYTES)
    with pytest.raises(ProtocolError, match="more than 10 messages"):
        affordable(budget, 0.0, size=MAX_HELLO_BYTES + 1)


def test_far_too_many_are_a_flood_and_sooner_if_they_are_long() -> None:
    def refused_until_flood(size: int) -> int:
        budget, count = MessageBudget(RATE, 0.0), 0
        budget.take(0.0, BURST)
        with pytest.raises(FloodError):
            while not affordable(budget, 0.0, size=size):
                count += 1
        return count

    assert refused_until_flood(size=1) > refused_until_flood(size=MAX_HELLO_BYTES) == 100


def test_who_has_used_up_a_reserve_is_read_on_when_it_is_there_again(
    budget: MessageBudget,
) -> None:
    assert budget.pause(0.0) == 0
    budget.take(0.0, BURST)
    assert budget.pause(0.0) == pytest.approx(0.25)
    assert budget.pause(0.25) == pytest.approx(0.0)
