"""Repaired plans are plans; bounds of steps to go hold, whatever a step's length."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from robotouille import State, World, load_task
from robotouille.certification.shipped_plan import plan_beside
from robotouille.domain.task import Timing
from robotouille.planning import Limits, Plan, StepsToGo, replay, solve
from robotouille.planning.repair.errands import Course, errands
from robotouille.planning.repair.plan_repair import PlanRepair
from robotouille.planning.steps_to_go import StepsLeft
from tests.planning.kitchen.exact import explored
from tests.planning.kitchen.random_kitchens import random_kitchen
from tests.support.samples import first_quickly

NOTHING = Limits(expansions=0)
TASKS = ["synchronous/03", "synchronous/10", "asynchronous/05", "asynchronous/06"]
"""With what goes on a stack, what is cut, fried and cooked, and soups."""


def wandering(world: World, seed: int, steps: int) -> list[State]:
    """States of players who act at random, one in three times not at all."""
    states, dice = [world.initial], random.Random(seed)
    for _ in range(steps):
        joint = [dice.choice([None, *states[-1].actions(p)]) for p in world.players]
        states.append(states[-1].step(joint).state)
    return states


def shortest(world: World) -> Course:
    plan = solve(world).plan
    assert plan is not None
    return Course.of(plan, world.initial)


@pytest.mark.parametrize("name", TASKS)
def test_a_plan_is_carried_out_as_it_is(name: str) -> None:
    world = World(name)
    course = shortest(world)
    again = PlanRepair(world).repair(errands(course), world.initial)
    assert again is not None
    assert len(again.joints) == len(course.joints)


@pytest.mark.parametrize("timing", Timing)
@pytest.mark.parametrize("name", TASKS)
def test_a_repaired_plan_is_a_plan(name: str, timing: Timing) -> None:
    """From wherever somebody has wandered to, and of whatever length steps are."""
    plain, world = World(name), World(load_task(name, timing=timing))
    kit, plan, found = PlanRepair(world), errands(shortest(plain)), 0
    for state in wandering(world, 3, 25):
        course = kit.repair(plan, state)
        if course is None:
            continue
        found += 1
        assert course.states[0] == state
        assert replay(Plan(course.joints), world, state).ok
        assert list(course.states) == list(Course.of(Plan(course.joints), state).states)
        plan = errands(course)
    assert found > 20


def test_what_is_done_is_left_out() -> None:
    world = World("synchronous/03")
    course = shortest(world)
    for number, state in enumerate(course.states):
        again = PlanRepair(world).repair(errands(course), state)
        assert again is not None
        assert len(again.joints) <= len(course.joints) - number


def test_who_holds_something_puts_it_down() -> None:
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


def test_where_nobody_walks_nothing_is_repaired() -> None:
    world = World("synchronous/01")
    plan = errands(shortest(world))
    domain = world.task.domain
    actions = tuple(a.model_copy(update={"travel": None}) for a in domain.action_defs)
    other = World(replace(world.task, domain=domain.model_copy(update={"action_defs": actions})))
    assert PlanRepair(other).repair(plan, other.initial) is None


def check_bounds(world: World, exact: dict[State, int | None], states: list[State]) -> None:
    """Ask of some states in turn."""
    distance, before = StepsToGo(world), None
    for state in states:
        left, steps = distance(state, NOTHING, after=before), exact[state]
        if left.dead:
            assert steps is None
        elif steps is not None:
            assert left.bound <= steps
            assert left.steps is None or left.steps >= steps
        else:
            assert left.steps is None
        before = state


@pytest.mark.slow
@pytest.mark.parametrize("timing", Timing)
@pytest.mark.parametrize("block", first_quickly(range(4)))
def test_bounds_without_a_search_hold(block: int, timing: Timing) -> None:
    """Exhaustive search in tiny kitchens, by one player and by two."""
    checked = 0
    for seed in range(500 + 15 * block, 515 + 15 * block):
        task = replace(random_kitchen(seed, 1 + seed % 2), timing=timing)
        found = explored(World(task), 600 if timing is Timing.BENCHMARK else 3000)
        if found is None:
            continue
        exact = dict(zip(found.states, found.distances, strict=True))
        check_bounds(found.world, exact, wandering(found.world, seed, 12))
        checked += 1
    assert checked > 1


@pytest.mark.slow
@pytest.mark.parametrize("block", first_quickly(range(2)))
def test_bounds_of_longer_steps_hold(block: int) -> None:
    """With people's timing the searches that are allowed are made without walks."""
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
def test_a_team_that_knows_a_plan_needs_no_search(task: str) -> None:
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


def test_a_plan_is_learnt() -> None:
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


def test_the_same_questions_have_the_same_answers() -> None:
    task = load_task("asynchronous/05", timing="people")
    answers = []
    for _ in range(2):
        world = World(task)
        distance, before, found = StepsToGo(world), None, []
        for state in wandering(world, 1, 12):
            found.append(distance(state, Limits(expansions=200), after=before))
            before = state
        answers.append(found)
    assert answers[0] == answers[1]
