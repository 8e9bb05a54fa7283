"""The shipped shifts: bots of every number of seats serve orders in time."""

from __future__ import annotations

from dataclasses import replace

import pytest

from robotouille import load_task, task_names
from robotouille.domain.task import Task
from tests.support.samples import quick_sample
from tests.support.team_games import play_team

STEPS = 90
SHIFTS = [
    (name, seats)
    for name in task_names()
    if name.startswith("shifts/")
    for seats in load_task(name).problem.seats or ()
]


def test_there_are_six_for_one_to_four_seats() -> None:
    assert len({name for name, _ in SHIFTS}) == 6
    assert {seats for _, seats in SHIFTS} == {1, 2, 3, 4}


def begun(name: str, seats: int) -> Task:
    """Return the beginning of a shift as a shift of its own."""
    task = load_task(name, seats=seats)
    assert task.problem.shift is not None
    shift = task.problem.shift.model_copy(update={"steps": STEPS})
    return replace(task, problem=task.problem.model_copy(update={"shift": shift}))


# The counter for two players comes first: it needs hand-overs.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seats"), quick_sample(sorted(SHIFTS, key=lambda s: "counter" not in s[0]), 0, 2)
)
def test_bots_serve_most_orders(name: str, seats: int) -> None:
    outcome = play_team(begun(name, seats), limit=STEPS).outcome
    assert outcome is not None
    assert outcome.score is not None
    assert outcome.score.served >= 3
    assert outcome.score.expired <= 1
