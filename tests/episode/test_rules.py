"""Rules as data: their limits, and what follows from them."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from robotouille.episode import Clock, Rules
from robotouille.episode.rules import MOVE_BUDGET


def test_only_wall_time_is_a_schedule() -> None:
    assert Rules(clock=Clock.REALTIME).scheduled
    assert not Rules(clock=Clock.REALTIME, thinking="declared").scheduled
    assert not any(Rules(clock=clock).scheduled for clock in (Clock.TURN, Clock.LOCKSTEP))


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
def test_one_silent_participant_cannot_hold_up_the_others(
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
def test_what_no_game_is_played_by_is_refused(rules: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Rules(**rules)  # type: ignore[arg-type]


def test_a_period_is_the_time_between_two_steps() -> None:
    assert Rules(step_rate=4.0).period == 0.25
