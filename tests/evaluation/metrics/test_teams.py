"""Measures of cooks and teams, against hand-computed values."""

from __future__ import annotations

import pytest

from robotouille import World, load_task
from robotouille.certification.step_limit import plan_beside
from robotouille.planning import StepsToGo
from robotouille.replay import recording_of
from robotouille_evaluation.metrics import EpisodeMeasures, Trajectory, measure
from robotouille_evaluation.metrics.asynchrony import TimeShares, time_shares
from robotouille_evaluation.metrics.measuring import blocking, contributions, overlap
from robotouille_evaluation.metrics.rows import Category, FailureRow
from robotouille_evaluation.metrics.trajectory import rejected_answer
from tests.evaluation.metrics.courses import SANDWICH, wandering
from tests.support.games import recorded_game
from tests.support.samples import quick_sample

TWO = World(load_task("multi_agent/01"))


def planned() -> Trajectory:
    """Return the trajectory of the shipped plan for two players, with 14 steps."""
    plan = plan_beside(TWO)
    assert plan is not None
    return Trajectory.played(TWO, [{a.player or "": a for a in joint} for joint in plan])


def test_contributions() -> None:
    # robot1 takes the patty, lays it down, cooks it, takes it, stacks it: 5. robot2 takes the
    # lettuce, lays it down, cuts it three times, takes it, stacks it, takes the bun, stacks it: 9.
    assert contributions(planned()) == {"robot1": 5 / 14, "robot2": 9 / 14}


def test_walking_is_not_a_contribution() -> None:
    course = Trajectory.played(TWO, [{"robot1": "Move robot1 from table2 to table4"}])
    assert contributions(course) == {"robot1": 0.0, "robot2": 0.0}


def test_overlap() -> None:
    # In 14 steps both act, but in steps 6, 7, 8 and 10: 10 of 14.
    assert overlap(planned()) == 10 / 14
    assert overlap(wandering()) is None


def test_shares_of_time() -> None:
    # robot1 stands by in 6, 7 and 8 while the patty cooks, and idles in 10: of 28 player's steps.
    assert time_shares(planned()) == TimeShares(waiting=3 / 28, idle=1 / 28, busy=0.0)


def test_two_players_at_one_station() -> None:
    joint = {"robot1": "Move robot1 from table2 to table4",
             "robot2": "Move robot2 from table1 to table4"}  # fmt: skip
    course = Trajectory.played(TWO, [joint])
    assert [move.applied for move in course.moves[0]] == [True, False]
    assert blocking(course) == 1


def test_occupied_station() -> None:
    empty = Trajectory.played(TWO, [])
    taken = rejected_answer(0, "robot1", "Move robot1 from table2 to table1", TWO.initial)
    assert [unmet.predicate for unmet in taken.unmet] == ["vacant"]
    far = rejected_answer(0, "robot1", "Move robot1 from table5 to table1", TWO.initial)
    course = Trajectory(TWO, empty.states, empty.moves, (taken, far))
    # The second is wrong about its own place as well: that is not the partner's doing.
    assert blocking(course) == 1
    assert blocking(planned()) == 0


def test_measures_of_a_wandering_cook() -> None:
    # Half of the way is left; 6 steps, none without an action; out of steps, as no rule is broken.
    found = measure(wandering(), 6, distance=StepsToGo(SANDWICH))
    assert found == EpisodeMeasures(
        to_go_least=0.5,
        to_go_most=0.5,
        waiting_share=0.0,
        idle_share=0.0,
        failure=FailureRow(category=Category.OTHER, subcategory="Out of Steps"),
    )


@pytest.mark.parametrize("seed", quick_sample(range(3)))
@pytest.mark.parametrize("task", ["asynchronous/04", "multi_agent/01"])
def test_shares_are_between_0_and_1(task: str, seed: int) -> None:
    """Contributions sum to 1."""
    course = Trajectory.recorded(recording_of(recorded_game(task, seed=seed, steps=80), "test"))
    found = measure(course, 80)
    shares = [found.waiting_share, found.idle_share, found.overlap]
    assert all(0 <= share <= 1 for share in shares if share is not None)
    assert sum(found.contributions.values()) in (0, pytest.approx(1))
    assert found.recovered <= found.stumbles
    assert (found.failure is None) == (course.goal_step is not None and course.goal_step <= 80)


def test_walking_players_are_busy() -> None:
    """With the timing for people, a walk takes several steps."""
    world = World(load_task("multi_agent/01", timing="people"))
    walk = {
        "robot1": "Move robot1 from table2 to table7",
        "robot2": "Move robot2 from table1 to board1",
    }
    course = Trajectory.played(world, [walk, {}])
    found = measure(course, 10)
    assert (found.waiting_share, found.idle_share, found.overlap) == (0.0, 0.0, 1.0)
