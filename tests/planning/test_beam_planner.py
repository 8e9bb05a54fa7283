"""Beam planner: plans from initial and later states, and determinism."""

from __future__ import annotations

import random

import pytest

from robotouille import World, load_task
from robotouille.planning.beam.planner import BeamPlanner
from robotouille.planning.plan import replay
from tests.support.samples import quick_sample

# Plans no longer than this: what the planner found when this was written, and a tenth more.
LENGTHS = {
    "synchronous/01": 8, "synchronous/02": 14, "synchronous/04": 11, "synchronous/05": 15,
    "synchronous/06": 26, "asynchronous/01": 18, "asynchronous/03": 37, "asynchronous/06": 20,
    "asynchronous/07": 47, "asynchronous/08": 45, "workshop/01": 20,
}  # fmt: skip


@pytest.mark.parametrize("name", quick_sample(LENGTHS, 3, nightly=10))
def test_solves_initial_states(name: str) -> None:
    world = World(name)
    solution = BeamPlanner(world).solve(world.initial)
    assert solution.reached
    assert replay(solution.plan, world).ok
    assert len(solution.plan) <= LENGTHS[name]


@pytest.mark.parametrize("name", ["synchronous/05", "asynchronous/01"])
def test_solves_without_comparing_choices(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # So it is with hundreds of objects, for which comparisons would take hours.
    monkeypatch.setattr("robotouille.planning.beam.planner.MAX_WORK", 0)
    world = World(name)
    solution = BeamPlanner(world).solve(world.initial)
    assert solution.reached
    assert replay(solution.plan, world).ok


@pytest.mark.slow
@pytest.mark.parametrize("name", ["synchronous/03", "asynchronous/01", "asynchronous/02"])
@pytest.mark.parametrize("seed", quick_sample([1, 2, 3], nightly=1))
def test_solves_later_states(name: str, seed: int) -> None:
    world, generator = World(name), random.Random(seed)
    state = world.initial
    for _ in range(25):
        state = world.successor(state, generator.choice(state.actions("robot1")))
    solution = BeamPlanner(world).solve(state)
    assert solution.reached
    assert replay(solution.plan, world, state).ok


@pytest.mark.slow
@pytest.mark.parametrize("name", ["asynchronous/05", "multi_agent/02"])
def test_equal_seeds_give_equal_plans(name: str) -> None:
    plans = []
    for _ in range(2):
        world = World(load_task(name))
        plans.append(
            [tuple(map(str, joint)) for joint in BeamPlanner(world).solve(world.initial).plan]
        )
    assert plans[0] == plans[1]
