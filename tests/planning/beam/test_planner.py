"""The planner solves tasks from the start and from the middle of play, always the same way."""

from __future__ import annotations

import random

import pytest

from robotouille import World, load_task
from robotouille.planning.beam.planner import BeamPlanner
from robotouille.planning.validation import replay
from tests.support.samples import first_quickly

# Plans no longer than this: what the planner found when this was written, and a tenth more.
LENGTHS = {
    "synchronous/01": 8, "synchronous/02": 14, "synchronous/04": 11, "synchronous/05": 15,
    "synchronous/06": 26, "asynchronous/01": 18, "asynchronous/03": 37, "asynchronous/06": 20,
    "asynchronous/07": 47, "asynchronous/08": 45, "workshop/01": 20,
}  # fmt: skip


@pytest.mark.parametrize("name", first_quickly(LENGTHS, 3))
def test_from_the_start(name: str) -> None:
    world = World(name)
    solution = BeamPlanner(world).solve(world.initial)
    assert solution.reached
    assert replay(solution.plan, world).ok
    assert len(solution.plan) <= LENGTHS[name]


@pytest.mark.parametrize("name", ["synchronous/03", "asynchronous/01", "asynchronous/02"])
@pytest.mark.parametrize("seed", first_quickly([1, 2, 3]))
def test_from_the_middle_of_play(name: str, seed: int) -> None:
    world, generator = World(name), random.Random(seed)
    state = world.initial
    for _ in range(25):
        state = world.successor(state, generator.choice(state.actions("robot1")))
    solution = BeamPlanner(world).solve(state)
    assert solution.reached
    assert replay(solution.plan, world, state).ok


def test_nothing_left_to_do() -> None:
    world = World("synchronous/01")
    end = replay(BeamPlanner(world).solve(world.initial).plan, world).final
    solution = BeamPlanner(world).solve(end)
    assert (solution.reached, len(solution.plan)) == (True, 0)


@pytest.mark.slow
def test_spoiled_beyond_repair_is_not_claimed_to_be_solved() -> None:
    """An onion that has to be cut goes into the pot whole: there is no way back."""
    world = World("asynchronous/07")
    plan = BeamPlanner(world).solve(world.initial).plan
    state = world.initial
    for (action,) in (joint for joint in plan if joint):
        if action.name == "cut":
            continue
        if world.applicable(state, action):
            state = world.successor(state, action)
        if action.name == "add-to":
            break
    onions = [o.name for o in state.objects if o.kind == "onion"]
    spoiled = [
        o for o in onions if state.holds("addedto", o, "water1") and not state.holds("iscut", o)
    ]
    assert spoiled
    assert not BeamPlanner(world).solve(state, expansions=200).reached


@pytest.mark.slow
@pytest.mark.parametrize("name", ["asynchronous/05", "multi_agent/02"])
def test_one_seed_one_plan(name: str) -> None:
    plans = []
    for _ in range(2):
        world = World(load_task(name))
        plans.append(
            [tuple(map(str, joint)) for joint in BeamPlanner(world).solve(world.initial).plan]
        )
    assert plans[0] == plans[1]
