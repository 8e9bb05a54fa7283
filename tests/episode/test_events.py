"""Events and outcomes as data."""

from __future__ import annotations

import json

import pytest

from robotouille.episode import Outcome, Reason, SeatTally

OUTCOME = Outcome(Reason.ABANDONED, 7, 1.2345, (SeatTally("robot1", 3, 1, 2, 4),), "why")


def test_outcome_round_trips_through_json() -> None:
    row = OUTCOME.to_json()
    assert json.loads(json.dumps(row)) == row
    assert row["seconds"] == 1.234
    assert Outcome.from_json(row).to_json() == row


@pytest.mark.parametrize("reason", Reason)
def test_only_the_goal_is_a_success(reason: Reason) -> None:
    assert Outcome(reason, 1, 1.0, ()).success == (reason is Reason.GOAL)
