"""Steps to go, repeated transitions and recovery, against numbers worked out by hand."""

from __future__ import annotations

import pytest

from robotouille import World, load_task
from robotouille.planning import UNLIMITED, StepsToGo
from robotouille.planning.steps_to_go import Range
from robotouille.replay import recording_of
from robotouille_evaluation.metrics import Answer, Trajectory, repeated_transitions, steps_to_go
from robotouille_evaluation.metrics.progress import recovery, steps_to_go_at_the_end
from tests.evaluation.metrics.courses import SANDWICH, refused, solo, wandering
from tests.support.games import recorded_game


def test_steps_to_go_along_the_run() -> None:
    # 8 steps from the start. One step to the cheese: 7 left. Back again: 8. Then 7, 6, 5, 4.
    found = steps_to_go(wandering(), StepsToGo(SANDWICH), UNLIMITED)
    expected = [8, 7, 8, 7, 6, 5, 4]
    assert found == tuple(Range(steps / 8, steps / 8) for steps in expected)


def test_steps_to_go_at_the_end() -> None:
    # To bread2, take it, back, stack it: 4 of 8.
    found = steps_to_go_at_the_end(wandering(), StepsToGo(SANDWICH), UNLIMITED)
    assert found == Range(0.5, 0.5)


def test_farther_away_than_at_first() -> None:
    # bread1 is taken from table2 and laid on cheese1 at table1. Now bread1 has to lie on a table
    # again, then cheese1, then bread2: lift bread1 (1), to a free table and down (2), back for
    # the cheese and take it (2), to bread1 and stack (2), to bread2, take, back, stack (4): 11.
    course = solo(
        SANDWICH,
        "Move robot1 from table3 to table2",
        "Pick up bread1 at table2 with robot1",
        "Move robot1 from table2 to table1",
        "Stack bread1 onto cheese1 at table1 with robot1",
    )
    # Shorter: bread2 is the one below. Take bread1 off (1), to bread2 … needs both breads and
    # the cheese on one table: lift bread1 (1), put it down at table2 (2), fetch the cheese (2) to
    # bread2 (1), stack (1), fetch bread1 (2), back and stack (2): 11 as well.
    found = steps_to_go_at_the_end(course, StepsToGo(SANDWICH), UNLIMITED)
    assert found == Range(11 / 8, 11 / 8)


def test_repeated_transitions() -> None:
    # Of six steps the third is the first again: one.
    assert repeated_transitions(wandering()) == 1


def test_waiting_for_something_repeats_nothing() -> None:
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


@pytest.mark.parametrize("task", ["synchronous/01", "multi_agent/01"])
def test_repeated_transitions_equal_a_naive_count(task: str) -> None:
    """Each step is compared with every earlier one, by the digests of states."""
    course = Trajectory.recorded(recording_of(recorded_game(task, steps=120, seed=3), "test"))
    steps = [
        (before.digest, [(m.player, str(m.action)) for m in joint if m.applied])
        for before, joint, _ in course.each_step()
    ]
    naive = sum(any(step == other for other in steps[:i]) for i, step in enumerate(steps))
    assert repeated_transitions(course) == naive


def test_recovery() -> None:
    course = wandering()
    far = refused(course, 0, "Pick up cheese1 at table1 with robot1", "Fetch the cheese")
    again = refused(course, 4, "Pick up bread1 at table2 with robot1")  # loc, and hands are full
    other = refused(course, 2, "Pick up cheese1 at table1 with robot1")  # loc alone, as at first
    last = refused(course, 6, "Done!")
    answers: list[Answer] = []
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


def test_no_errors_no_rate() -> None:
    assert recovery(wandering()).rate is None
