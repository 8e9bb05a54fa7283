"""Cost of thinking."""

from __future__ import annotations

import pytest

from robotouille.errors import WrongArgumentError
from robotouille_evaluation.agents import Exchange, ExchangeVerdict
from robotouille_evaluation.models import Completion, ModelRequest, Usage
from robotouille_evaluation.realtime import Charge


def exchange(text: str = "", tokens: int = 0, seconds: float = 0.0) -> Exchange:
    answer = Completion(text, Usage(1000, tokens), seconds)
    return Exchange(ModelRequest(()), answer, ExchangeVerdict.ACTION)


UNANSWERED = Exchange(ModelRequest(()), None, ExchangeVerdict.OVERFLOW)


@pytest.mark.parametrize(
    ("charge", "ms"),
    [("wall", 3500), ("tokens:20", 2100), ("tokens:0.1", 11), ("declared:1500", 3000)],
)  # fmt: skip
def test_all_calls_of_a_proposal_are_charged(charge: str, ms: int) -> None:
    """100 tokens in 3 s, and 18 characters without a count in half a second."""
    calls = [exchange("x", 100, 3.0), UNANSWERED, exchange("a text of 18 signs", 0, 0.5)]
    assert Charge.parse(charge).milliseconds(calls) == ms
    assert str(Charge.parse(charge)) == charge


def test_charge_is_at_most_a_day() -> None:
    assert Charge.parse("tokens:86400000").milliseconds([exchange("x", 10)]) == 86_400_000


@pytest.mark.parametrize(
    "text", ["", "tokens", "tokens:", "tokens:-1", "tokens:nan", "declared:inf", "wall:3", "x:1"]
)
def test_invalid_charges_are_refused(text: str) -> None:
    with pytest.raises(WrongArgumentError, match="tokens:MILLISECONDS"):
        Charge.parse(text)
