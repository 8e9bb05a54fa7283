"""Repaired plans reach the goal, and bounds of steps to go are valid under any timing."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from robotouille import State, World, load_task
from robotouille.certification.step_limit import plan_beside
from robotouille.domain.task import Timing
from robotouille.planning import Limits, Plan, StepsToGo, replay, solve
from robotouille.planning.errands import PlanTrace, errands
from robotouille.planning.plan_repair import PlanRepair
from robotouille.planning.steps_to_go import StepsLeft
from tests.planning.kitchen.kitchens import explored
from tests.planning.kitchen.random_kitchens import random_kitchen
from tests.support.samples import quick_sample

NOTHING = Limits(expansions=0)
TASKS = ["synchronous/03", "synchronous/10", "asynchronous/05", "asynchronous/06"]
"""Tasks with stacks, cutting, frying, cooking and soups."""


def wandering(world: World, seed: int, steps: int) -> list[State]:
    """Yield states of players who act at random."""
    states, dice = [world.initial], random.Random(seed)
    for _ in range(steps):
        joint = [dice.choice([None, *states[-1].actions(p)]) for p in world.players]
        states.append(states[-1].step(joint).state)
    return states


def shortest(world: World) -> PlanTrace:
    plan = solve(world).plan
    assert plan is not None
    return PlanTrace.of(plan, world.initial)


@pytest.mark.parametrize("timing", Timing)
@pytest.mark.parametrize("name", quick_sample(TASKS, 2))
def test_repaired_plans_reach_the_goal(name: str, timing: Timing) -> None:
    plain, world = World(name), World(load_task(name, timing=timing))
    kit, plan, found = PlanRepair(world), errands(shortest(plain)), 0
    for state in wandering(world, 3, 25):
        course = kit.repair(plan, state)
        if course is None:
            continue
        found += 1
        assert course.states[0] == state
        assert replay(Plan(course.joints), world, state).ok
        assert list(course.states) == list(PlanTrace.of(Plan(course.joints), state).states)
        plan = errands(course)
    assert found > 20


def test_finished_actions_are_left_out() -> None:
    world = World("synchronous/03")
    course = shortest(world)
    for number, state in enumerate(course.states):
        again = PlanRepair(world).repair(errands(course), state)
        assert again is not None
        assert len(again.joints) <= len(course.joints) - number


def test_held_object_is_put_down() -> None:
    world = World("synchronous/01")
    course = shortest(world)
    useless = next(
        after
        for walk in world.initial.actions("robot1")
        for after in [world.initial.step(walk).state]
        for take in after.actions("robot1")
        if take.name == "pick-up-item" and take.arguments[1] not in str(course.joints[1])
        for after in [after.step(take).state]
    )
    found = PlanRepair(world).repair(errands(course), useless)
    assert found is not None
    done = [action for joint in found.joints for action in joint if action.name != "move"]
    assert done[0].name == "place-item"


def test_domain_without_walks_is_not_repaired() -> None:
    world = World("synchronous/01")
    plan = errands(shortest(world))
    domain = world.task.domain
    actions = tuple(a.model_copy(update={"travel": None}) for a in domain.action_defs)
    other = World(replace(world.task, domain=domain.model_copy(update={"action_defs": actions})))
    assert PlanRepair(other).repair(plan, other.initial) is None


@pytest.mark.slow
@pytest.mark.parametrize("block", quick_sample(range(2)))
def test_bounds_with_timing_for_people_are_valid(block: int) -> None:
    for seed in range(700 + 10 * block, 710 + 10 * block):
        task = replace(random_kitchen(seed, 1), timing=Timing.PEOPLE)
        found = explored(World(task), 3000)
        if found is None:
            continue
        distance = StepsToGo(found.world)
        for state, steps in list(zip(found.states, found.distances, strict=True))[::7]:
            left = distance(state, Limits(expansions=500))
            if steps is None:
                assert left.steps is None
            else:
                assert not left.dead
                assert left.bound <= steps
                assert left.steps is None or left.steps >= steps


@pytest.mark.parametrize("task", ["multi_agent/01", "multi_agent/01@3"])
def test_known_plan_replaces_a_search(task: str) -> None:
    world = World(task)
    plan = plan_beside(world)
    assert plan is not None
    distance, before = StepsToGo(world), None
    assert distance.learn(world.initial, plan).steps == len(plan)
    for state in wandering(world, 2, 15):
        left = distance(state, NOTHING, after=before)
        assert left.steps is not None
        assert 0 < left.bound <= left.steps <= 3 * len(plan)
        before = state


def test_learned_plan_is_used() -> None:
    world = World("synchronous/03")
    plan = Plan(shortest(world).joints)
    distance = StepsToGo(world)
    assert distance.learn(world.initial, plan, len(plan)) == StepsLeft(len(plan), len(plan))
    assert distance(world.initial.step(plan.steps[0]).state, NOTHING).exact
    people = StepsToGo(World(load_task("synchronous/03", timing="people")))
    longer = people.learn(world.initial, plan, len(plan))
    assert longer.steps is not None
    assert longer.steps > len(plan)
    with pytest.raises(ValueError, match="the goal is not reached"):
        distance.learn(world.initial, Plan(plan.steps[:-1]))
