"""All metrics of a trajectory at once."""

from __future__ import annotations

import pytest

from robotouille import World, load_task
from robotouille.planning import StepsToGo
from robotouille.replay import recording_of
from robotouille_evaluation.metrics import EpisodeMeasures, Trajectory, measure
from robotouille_evaluation.metrics.rows import Category, FailureRow
from tests.evaluation.metrics.courses import SANDWICH, wandering
from tests.support.games import recorded_game


def test_measures_of_a_wandering_cook() -> None:
    # Half of the way is left; 6 steps, none without an action; out of steps, as no rule is broken.
    found = measure(wandering(), 6, distance=StepsToGo(SANDWICH))
    assert found == EpisodeMeasures(
        to_go_least=0.5,
        to_go_most=0.5,
        waiting_share=0.0,
        idle_share=0.0,
        failure=FailureRow(category=Category.OTHER, subcategory="out of steps"),
    )


@pytest.mark.parametrize("seed", range(3))
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
