"""The bucket that meters messages."""

from __future__ import annotations

from robotouille_server.runtime.token_bucket import TokenBucket


def test_a_budget_allows_bursts_and_then_its_rate() -> None:
    budget = TokenBucket(10, 0.0)
    assert sum(budget.take(0.0) for _ in range(100)) == 20
    assert not budget.take(0.09)
    assert budget.take(0.11)
    taken = sum(budget.take(0.11 + tick / 1000) for tick in range(10_000))
    assert 99 <= taken <= 101


def test_a_budget_fills_no_higher_than_its_burst() -> None:
    budget = TokenBucket(10, 0.0, burst=3)
    assert budget.left(1e6) == 3
    assert not budget.take(1e6, cost=4)
    assert budget.take(1e6, cost=3)
    assert not budget.take(1e6)
