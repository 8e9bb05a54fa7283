"""Success, optimality, wrong answers and cost, also computed independently from JSON."""

from __future__ import annotations

from robotouille_evaluation.metrics import (
    Counts,
    Optimum,
    Result,
    TotalUsage,
    optimality_rate,
    succeeded,
    success_rate,
)
from robotouille_evaluation.metrics.outcomes import (
    cost,
    cost_per_success,
    invalid_rate,
    is_optimal,
    malformed_rate,
    mean_steps,
    seconds_per_call,
    success_within,
    tokens,
)
from tests.evaluation.metrics.courses import SANDWICH, solo
from tests.support.episode_rows import row

FAILED = Result(success=False, steps=12, ended_by="step-limit")

PLAN = (
    "Move robot1 from table3 to table1",
    "Pick up cheese1 at table1 with robot1",
    "Move robot1 from table1 to table2",
    "Stack cheese1 onto bread1 at table2 with robot1",
    "Move robot1 from table2 to table5",
    "Pick up bread2 at table5 with robot1",
    "Move robot1 from table5 to table2",
    "Stack bread2 onto cheese1 at table2 with robot1",
)


def test_success_within_a_budget() -> None:
    course = solo(SANDWICH, *PLAN)
    assert course.goal_step == 8
    assert success_within(course, 8)
    assert not success_within(course, 7)
    assert not success_within(solo(SANDWICH, *PLAN[:-1]), 100)


def test_success_of_a_row() -> None:
    late = Result(success=True, steps=13, ended_by="goal")
    assert succeeded(row())
    assert not succeeded(row(outcome=late))
    assert not succeeded(row(outcome=FAILED))
    # Two of four.
    assert success_rate([row(), row(), row(outcome=late), row(outcome=FAILED)]) == 0.5
    assert success_rate([]) is None


def test_optimality_rate() -> None:
    # 10 steps where 8 are enough.
    ten = Result(success=True, steps=10, ended_by="goal")
    assert optimality_rate(row(outcome=ten)) == 1.25
    assert (is_optimal(row()), is_optimal(row(outcome=ten))) == (True, False)
    assert optimality_rate(row(outcome=FAILED)) is None
    assert optimality_rate(row(optimum=Optimum(steps=9, bound=7))) is None
    assert is_optimal(row(optimum=Optimum())) is None


def test_rates_of_wrong_answers() -> None:
    rows = [row(counts=Counts(invalid=3, malformed=1, calls=20)), row(counts=Counts(calls=20))]
    assert (invalid_rate(rows), malformed_rate(rows)) == (3 / 40, 1 / 40)
    assert invalid_rate([row()]) is None


def test_tokens_cost_and_latency() -> None:
    spent = TotalUsage(prompt_tokens=1000, completion_tokens=50, cost=0.25)
    rows = [
        row(usage=spent, seconds=30.0, counts=Counts(calls=10)),
        row(usage=spent, seconds=10.0, counts=Counts(calls=10), outcome=FAILED),
        row(usage=spent, seconds=20.0, counts=Counts(calls=10), outcome=FAILED),
    ]
    assert tokens(rows) == (3000, 150)
    assert cost(rows) == 0.75
    assert cost_per_success(rows) == 0.75  # one success
    assert seconds_per_call(rows) == 2.0  # the median of 3, 1 and 2
    assert mean_steps(rows) == (8 + 12 + 12) / 3
    assert cost([*rows, row()]) is None
    assert cost_per_success(rows[1:]) is None
    assert seconds_per_call([row()]) is None
