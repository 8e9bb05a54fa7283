"""What an episode reports is data."""

from __future__ import annotations

import json
from dataclasses import FrozenInstanceError

import pytest

from robotouille.episode import Outcome, Reason, SeatTally, Started

OUTCOME = Outcome(Reason.ABANDONED, 7, 1.2345, (SeatTally("robot1", 3, 1, 2, 4),), "why")


def test_an_outcome_comes_back_from_json() -> None:
    row = OUTCOME.to_json()
    assert json.loads(json.dumps(row)) == row
    assert row["seconds"] == 1.234
    assert Outcome.from_json(row).to_json() == row


@pytest.mark.parametrize("reason", Reason)
def test_only_the_goal_is_a_success(reason: Reason) -> None:
    assert Outcome(reason, 1, 1.0, ()).success == (reason is Reason.GOAL)


def test_an_unknown_reason_is_refused() -> None:
    with pytest.raises(ValueError, match="bored"):
        Outcome.from_json({**OUTCOME.to_json(), "reason": "bored"})


def test_events_do_not_change() -> None:
    with pytest.raises(FrozenInstanceError):
        Started(0.0).time = 1.0  # type: ignore[misc]
