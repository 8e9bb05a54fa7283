"""Progress, recovery, success, optimality and cost, against hand-computed values."""

from __future__ import annotations

from robotouille import World, load_task
from robotouille.planning import UNLIMITED, StepsToGo
from robotouille.planning.steps_to_go import Range
from robotouille_evaluation.metrics import (
    Counts,
    Optimum,
    Result,
    StepAnswer,
    TotalUsage,
    Trajectory,
    optimality_rate,
    repeated_transitions,
    steps_to_go,
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
    recovery,
    seconds_per_call,
    steps_to_go_at_the_end,
    success_within,
    tokens,
)
from tests.evaluation.metrics.courses import SANDWICH, refused, solo, wandering
from tests.support.episode_rows import row


def test_steps_to_go_along_the_run() -> None:
    # 8 steps from the start. One step to the cheese: 7 left. Back again: 8. Then 7, 6, 5, 4.
    found = steps_to_go(wandering(), StepsToGo(SANDWICH), UNLIMITED)
    expected = [8, 7, 8, 7, 6, 5, 4]
    assert found == tuple(Range(steps / 8, steps / 8) for steps in expected)


def test_steps_to_go_at_the_end() -> None:
    # To bread2, take it, back, stack it: 4 of 8.
    found = steps_to_go_at_the_end(wandering(), StepsToGo(SANDWICH), UNLIMITED)
    assert found == Range(0.5, 0.5)


def test_repeated_transitions() -> None:
    # Of six steps the third is the first again: one.
    assert repeated_transitions(wandering()) == 1


def test_waiting_is_not_a_repetition() -> None:
    # Idle in a kitchen where nothing runs: the second and third step are the first again.
    assert repeated_transitions(solo(SANDWICH, None, None, None)) == 2
    soup = World(load_task("asynchronous/06"))
    filling = solo(
        soup,
        "Move robot1 from table3 to table2",
        "Pick up pot1 at table2 with robot1",
        "Move robot1 from table2 to sink1",
        "Put down pot1 at sink1 with robot1",
        "Start filling pot1 with water at sink1 with robot1",
        None,
        None,
        None,
    )
    # The tap runs for 3 more steps, and each has another timer.
    assert repeated_transitions(filling) == 0


def test_steps_of_a_shift_can_repeat_although_time_passes() -> None:
    assert repeated_transitions(solo(World("shifts/01@1"), None, None, None)) == 2


def test_recovery() -> None:
    course = wandering()
    far = refused(course, 0, "Pick up cheese1 at table1 with robot1", "Fetch the cheese")
    again = refused(course, 4, "Pick up bread1 at table2 with robot1")  # loc, and hands are full
    other = refused(course, 2, "Pick up cheese1 at table1 with robot1")  # loc alone, as at first
    last = refused(course, 6, "Done!")
    answers: list[StepAnswer] = []
    for step, answer in enumerate(course.answers):
        answers += [w for w in (*far, *again, *other) if w.step == step]
        answers.append(answer)
    course = Trajectory(course.world, course.states, course.moves, (*answers, *last))
    found = recovery(course)
    # Four stumbles: two wrong answers at step 0, one at 2, one at 4, and the last one, after which
    # nothing came. That at step 2 is the same mistake as one at step 0; "Done!" is malformed as
    # "Fetch the cheese" was, so it is a repeated one too.
    assert (found.stumbles, found.recovered, found.repeated, found.answers) == (4, 3, 2, 5)
    assert found.rate == 0.75


def test_no_recovery_rate_without_errors() -> None:
    assert recovery(wandering()).rate is None


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
    assert cost([*rows, row()]) == 0.75, "a planner calls no model"
    assert cost([*rows, row(counts=Counts(calls=1))]) is None, "one price is unknown"
    assert cost_per_success(rows[1:]) is None
    assert seconds_per_call([row()]) is None
