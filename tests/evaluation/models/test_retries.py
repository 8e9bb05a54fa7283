"""When a request is sent again."""

from __future__ import annotations

import random

import pytest

from robotouille.errors import WrongArgumentError
from robotouille_evaluation.models import ModelError, ModelErrorKind, Prices, RetryPolicy


def error(retry_may_help: bool = True, retry_after: float | None = None) -> ModelError:
    return ModelError(
        ModelErrorKind.SERVER, "", retry_may_help=retry_may_help, retry_after=retry_after
    )


def test_pauses_double_up_to_a_limit_and_are_drawn() -> None:
    policy, rng = RetryPolicy(attempts=9, first_delay=1, max_delay=10), random.Random(1)
    for attempt, longest in enumerate([1, 2, 4, 8, 10, 10, 10, 10], 1):
        pauses = {policy.pause(attempt, error(), rng) for _ in range(20)}
        assert len(pauses) == 20
        assert all(pause and longest / 2 <= pause <= longest for pause in pauses)
    assert policy.pause(9, error(), rng) is None


def test_what_cannot_help_is_not_tried() -> None:
    policy, rng = RetryPolicy(max_retry_after=60), random.Random(1)
    assert policy.pause(1, error(retry_may_help=False), rng) is None
    assert policy.pause(1, error(retry_after=61), rng) is None
    pause = policy.pause(1, error(retry_after=60), rng)
    assert pause is not None and pause > 60


def test_prices() -> None:
    assert Prices.parse("2.50/10") == Prices(2.5, 10)
    assert Prices(2.5, 10).cost(1_000_000, 100_000) == 3.5


@pytest.mark.parametrize("text", ["", "1", "1/2/3", "a/b", "-1/2", "nan/1", "1/inf"])
def test_prices_that_are_none(text: str) -> None:
    with pytest.raises(WrongArgumentError, match=r"2\.50/10"):
        Prices.parse(text)
