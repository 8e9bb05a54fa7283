"""All metrics of a trajectory at once, as a row holds them."""

from __future__ import annotations

import pytest

from robotouille import World, load_task
from robotouille.planning import Limits, StepsToGo
from robotouille.replay import recording_of
from robotouille_evaluation.metrics import Measures, Trajectory, measure
from robotouille_evaluation.metrics.rows import Category, FailureRow
from tests.evaluation.metrics.courses import SANDWICH, wandering
from tests.support.games import recorded_game


def test_a_wandering_cook() -> None:
    # Half of the way is left; 6 steps, none without an action; out of steps, as no rule is broken.
    found = measure(wandering(), 6, distance=StepsToGo(SANDWICH))
    assert found == Measures(
        to_go_least=0.5,
        to_go_most=0.5,
        waiting_share=0.0,
        idle_share=0.0,
        failure=FailureRow(category=Category.OTHER, subcategory="out of steps"),
    )


def test_a_proven_optimum_needs_no_search() -> None:
    nothing = Limits(expansions=0)
    found = measure(wandering(), 6, distance=StepsToGo(SANDWICH), fewest=8, limits=nothing)
    assert found.to_go_least is not None
    assert found.to_go_least <= 0.5


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("task", ["asynchronous/04", "multi_agent/01"])
def test_shares_are_shares(task: str, seed: int) -> None:
    """Whatever is played: shares are from 0 to 1, and who contributes sums to 1."""
    course = Trajectory.recorded(recording_of(recorded_game(task, seed=seed, steps=80), "test"))
    found = measure(course, 80)
    shares = [found.waiting_share, found.idle_share, found.overlap]
    assert all(0 <= share <= 1 for share in shares if share is not None)
    assert sum(found.contributions.values()) in (0, pytest.approx(1))
    assert found.recovered <= found.stumbles
    assert (found.failure is None) == (course.goal_step is not None and course.goal_step <= 80)


def test_a_walking_team_is_busy() -> None:
    """With people's timing a walk takes several steps: neither waiting nor idle."""
    world = World(load_task("multi_agent/01", timing="people"))
    walk = {
        "robot1": "Move robot1 from table2 to table7",
        "robot2": "Move robot2 from table1 to board1",
    }
    course = Trajectory.played(world, [walk, {}])
    found = measure(course, 10)
    assert (found.waiting_share, found.idle_share, found.overlap) == (0.0, 0.0, 1.0)
