"""Rules: limits and derived values."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from robotouille.episode import Clock, Rules
from robotouille.episode.rules import MOVE_BUDGET


@pytest.mark.parametrize(
    ("clock", "asked", "seats", "budget"),
    [
        (Clock.LOCKSTEP, None, 2, MOVE_BUDGET),
        (Clock.LOCKSTEP, None, 1, None),
        (Clock.REALTIME, None, 2, None),
        (Clock.TURN, 0, 2, None),
        (Clock.TURN, 7.5, 2, 7.5),
    ],
)
def test_default_move_budget_needs_several_seats(
    clock: Clock, asked: float | None, seats: int, budget: float | None
) -> None:
    assert Rules(clock=clock).with_budget(asked, seats).move_budget == budget


@pytest.mark.parametrize(
    "rules",
    [
        {"step_rate": 0.0},
        {"step_rate": 61},
        {"move_budget": 0.001},
        {"max_steps": 0},
        {"grace": -1},
        {"clock": "sundial"},
        {"weather": "rain"},
    ],
)
def test_rules_out_of_range_are_refused(rules: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Rules(**rules)  # type: ignore[arg-type]
