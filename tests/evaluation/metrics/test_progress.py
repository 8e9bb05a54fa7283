"""Steps to go, repeated transitions and recovery, against hand-computed values."""

from __future__ import annotations

from robotouille import World, load_task
from robotouille.planning import UNLIMITED, StepsToGo
from robotouille.planning.steps_to_go import Range
from robotouille_evaluation.metrics import StepAnswer, Trajectory, repeated_transitions, steps_to_go
from robotouille_evaluation.metrics.outcomes import recovery, steps_to_go_at_the_end
from tests.evaluation.metrics.courses import SANDWICH, refused, solo, wandering


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
