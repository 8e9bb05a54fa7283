"""Plans for play: at once, good, better later, and the same every time."""

from __future__ import annotations

import random

import pytest

from robotouille import State, World, load_task, task_names
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.plan import write_plan
from robotouille.planning.search_result import Limits, SearchResult
from robotouille.planning.validation import replay
from tests.planning.kitchen.exact import explored
from tests.planning.kitchen.random_kitchens import random_kitchen
from tests.support.samples import first_quickly
from tests.world.kitchens import kitchen

OPTIMAL = {
    "synchronous/": (8, 14, 24, 11, 15, 23, 36, 36, 60, 54),
    "asynchronous/": (17, 23, 33, 42, 46, 19, 42, 40, 58, 72),
}
LENGTHS = {
    name: length
    for folder, lengths in OPTIMAL.items()
    for name, length in zip(
        sorted(name for name in task_names() if name.startswith(folder)), lengths, strict=True
    )
}


def wandered(world: World, seed: int, steps: int) -> State:
    """Where a course at random leads."""
    state, rng = world.initial, random.Random(seed)
    for _ in range(steps):
        state = world.successor(state, rng.choice(state.actions("robot1")))
    return state


def last(anytime: AnytimePlanner, state: State, expansions: int) -> SearchResult:
    *_, answer = anytime.search(state, Limits(expansions=expansions))
    return answer


@pytest.mark.parametrize("name", LENGTHS)
def test_the_first_plan_comes_at_once_and_is_good(name: str) -> None:
    world = World(name)
    answer = AnytimePlanner(world).first(world.initial)
    assert answer.plan is not None
    assert replay(answer.plan, world).ok
    assert len(answer.plan) <= 1.2 * LENGTHS[name]
    assert answer.bound <= LENGTHS[name]
    assert answer.expansions <= 60


@pytest.mark.parametrize("name", LENGTHS)
def test_the_last_plan_is_the_shortest(name: str) -> None:
    world = World(name)
    answer = last(AnytimePlanner(world), world.initial, 200)
    assert answer.plan is not None
    assert replay(answer.plan, world).ok
    assert (len(answer.plan), answer.optimal) == (LENGTHS[name], True)


@pytest.mark.parametrize("name", ["synchronous/06", "asynchronous/05", "asynchronous/08"])
@pytest.mark.parametrize("steps", [3, 20, 70])
def test_from_anywhere(name: str, steps: int) -> None:
    world = World(name)
    state = wandered(world, steps, steps)
    answers = list(AnytimePlanner(world).search(state, Limits(expansions=130)))
    for answer in answers:
        assert answer.plan is not None
        assert replay(answer.plan, world, state).ok
        assert answer.bound <= len(answer.plan)
    assert len(answers[-1].plan or ()) <= len(answers[0].plan or ())
    assert answers[-1].bound >= answers[0].bound


@pytest.mark.parametrize("block", first_quickly(range(4)))
def test_never_wrong_in_tiny_kitchens(block: int) -> None:
    checked = 0
    for seed in range(100 + 20 * block, 120 + 20 * block):
        found = explored(World(random_kitchen(seed)), 400)
        if found is None:
            continue
        anytime = AnytimePlanner(found.world)
        for number in random.Random(seed).choices(range(len(found.states)), k=5):
            state, distance = found.states[number], found.distances[number]
            for answer in anytime.search(state, Limits(expansions=500)):
                checked += 1
                assert not (answer.unsolvable and distance is not None)
                if answer.plan is not None:
                    assert distance is not None
                    assert answer.bound <= distance <= len(answer.plan)
                    assert replay(answer.plan, found.world, state).ok
    assert checked > 20


def test_one_question_one_answer() -> None:
    texts = []
    for _ in range(2):
        world = World("asynchronous/09")
        answers = AnytimePlanner(world).search(world.initial, Limits(expansions=100))
        texts.append([write_plan(a.plan, world) for a in answers if a.plan is not None])
    assert texts[0] == texts[1]


def test_with_people_s_timing_the_plan_is_one_of_the_model() -> None:
    world = World(load_task("asynchronous/01", timing="people"))
    anytime = AnytimePlanner(world)
    assert anytime.model.task.timing == "benchmark"
    answer = last(anytime, world.initial, 200)
    assert answer.plan is not None
    assert len(answer.plan) == LENGTHS["asynchronous/01_cheese_chicken_sandwich"]
    assert replay(answer.plan, anytime.model).ok


def test_what_is_left_of_a_delay_is_left_of_it_in_the_model() -> None:
    world = kitchen(
        timing="people",
        items=[{"name": "patty", "x": 3, "y": 0, "predicates": ["iscookable"]}],
        players=[{"name": "robot", "x": 3, "y": 1, "direction": [0, -1]}],
        config={"cook_time": {"default": 3}},
        goal=[{"predicate": "iscooked", "args": ["patty"], "ids": [1]}],
    )
    anytime, state = AnytimePlanner(world), world.initial
    state = state.step(world.action("cook", "robot1", "patty1", "stove1")).state
    lengths = []
    for _ in range(16):
        plan = anytime.first(state).plan
        assert plan is not None
        lengths.append(len(plan))
        state = state.step([]).state
    assert lengths == [3, 3, 3, 3, 3, 2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 0]


def test_two_players_have_a_plan_and_then_perhaps_a_shorter_one() -> None:
    world = World(load_task("multi_agent/01", seats=2))
    first, second = AnytimePlanner(world).search(world.initial, Limits(expansions=500), beam=300)
    for answer in (first, second):
        assert answer.plan is not None
        assert replay(answer.plan, world).ok
    assert len(second.plan or ()) <= len(first.plan or ())


def test_a_part_of_a_team_plans_for_itself() -> None:
    world = World(load_task("multi_agent/01", seats=2))
    (answer,) = AnytimePlanner(world).search(world.initial, team=["robot1"], beam=300)
    assert answer.plan is not None
    assert answer.plan.share("robot2") == 0
    assert not answer.optimal


def test_towards_a_goal_that_is_not_reached() -> None:
    """robot1 stays where something is needed: robot2 comes as near as it can."""
    world = World(load_task("multi_agent/01", seats=2))
    anytime = AnytimePlanner(world)
    (answer,) = anytime.search(world.initial, team=["robot2"], beam=100)
    assert (answer.plan, answer.unsolvable) == (None, False)
    plan = anytime.towards(world.initial, team=["robot2"], beam=100)
    assert plan.share("robot2") > 3


def test_other_domains_have_plans_by_beam_search() -> None:
    world = World("workshop/01")
    (answer,) = AnytimePlanner(world).search(world.initial)
    assert answer.plan is not None
    assert replay(answer.plan, world).ok


def test_what_cannot_be_done_is_said_to_be_so() -> None:
    world = kitchen(
        items=[{"name": "lettuce", "x": 0, "y": 0}],
        goal=[{"predicate": "iscut", "args": ["lettuce"], "ids": [1]}],
    )
    (answer,) = AnytimePlanner(world).search(world.initial)
    assert answer.unsolvable
    assert answer.plan is None


def test_no_work_no_plan_but_a_bound() -> None:
    world = World("synchronous/01")
    *_, answer = AnytimePlanner(world).search(world.initial, Limits(expansions=0), beam=0)
    assert (answer.plan, answer.unsolvable, answer.bound) == (None, False, 8)
