"""Plans for play: quick, then better, and deterministic."""

from __future__ import annotations

import random

import pytest

from robotouille import State, World, load_task
from robotouille.planning.plan import Limits, SearchResult, replay, write_plan
from robotouille.planning.solvers import AnytimePlanner
from tests.planning.kitchen.kitchens import explored
from tests.planning.kitchen.random_kitchens import random_kitchen
from tests.support.samples import quick_sample
from tests.support.solvers import SHIPPED as LENGTHS
from tests.world.kitchens import kitchen


def last(anytime: AnytimePlanner, state: State, expansions: int) -> SearchResult:
    *_, answer = anytime.search(state, Limits(expansions=expansions))
    return answer


@pytest.mark.parametrize("name", quick_sample(LENGTHS, 8))
def test_first_plan_is_quick_and_good(name: str) -> None:
    world = World(name)
    answer = AnytimePlanner(world).first(world.initial)
    assert answer.plan is not None
    assert replay(answer.plan, world).ok
    assert len(answer.plan) <= 1.2 * LENGTHS[name]
    assert answer.bound <= LENGTHS[name]
    assert answer.expansions <= 60


@pytest.mark.parametrize("name", quick_sample(LENGTHS, 8))
def test_last_plan_is_shortest(name: str) -> None:
    world = World(name)
    answer = last(AnytimePlanner(world), world.initial, 200)
    assert answer.plan is not None
    assert replay(answer.plan, world).ok
    assert (len(answer.plan), answer.optimal) == (LENGTHS[name], True)


@pytest.mark.parametrize("block", quick_sample(range(4)))
def test_results_are_right_in_tiny_kitchens(block: int) -> None:
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


@pytest.mark.slow
def test_equal_queries_give_equal_answers() -> None:
    texts = []
    for _ in range(2):
        world = World("asynchronous/09")
        answers = AnytimePlanner(world).search(world.initial, Limits(expansions=100))
        texts.append([write_plan(a.plan, world) for a in answers if a.plan is not None])
    assert texts[0] == texts[1]


def test_timing_for_people_gives_plans_of_the_model() -> None:
    world = World(load_task("asynchronous/01", timing="people"))
    anytime = AnytimePlanner(world)
    assert anytime.model.task.timing == "benchmark"
    answer = last(anytime, world.initial, 200)
    assert answer.plan is not None
    assert len(answer.plan) == LENGTHS["asynchronous/01_cheese_chicken_sandwich"]
    assert replay(answer.plan, anytime.model).ok


def test_rest_of_a_delay_is_kept_in_the_model() -> None:
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


@pytest.mark.slow
def test_second_plan_of_two_players_is_not_longer() -> None:
    world = World(load_task("multi_agent/01", seats=2))
    first, second = AnytimePlanner(world).search(world.initial, Limits(expansions=500), beam=300)
    for answer in (first, second):
        assert answer.plan is not None
        assert replay(answer.plan, world).ok
    assert len(second.plan or ()) <= len(first.plan or ())


def test_towards_an_unreachable_goal() -> None:
    world = World(load_task("multi_agent/01", seats=2))
    anytime = AnytimePlanner(world)
    (answer,) = anytime.search(world.initial, team=["robot2"], beam=100)
    assert (answer.plan, answer.unsolvable) == (None, False)
    plan = anytime.towards(world.initial, team=["robot2"], beam=100)
    assert plan.share("robot2") > 3


def test_unsolvable_states_are_reported() -> None:
    world = kitchen(
        items=[{"name": "lettuce", "x": 0, "y": 0}],
        goal=[{"predicate": "iscut", "args": ["lettuce"], "ids": [1]}],
    )
    (answer,) = AnytimePlanner(world).search(world.initial)
    assert answer.unsolvable
    assert answer.plan is None


def test_no_expansions_give_only_a_bound() -> None:
    world = World("synchronous/01")
    *_, answer = AnytimePlanner(world).search(world.initial, Limits(expansions=0), beam=0)
    assert (answer.plan, answer.unsolvable, answer.bound) == (None, False, 8)


def test_general_search_stops_when_asked_and_forgets_what_it_had_not_found() -> None:
    # In a kitchen with a hundred equal objects, this search takes half a minute.
    world = World("multi_agent/01@2")
    anytime, asked = AnytimePlanner(world), 0

    def stop() -> bool:
        nonlocal asked
        asked += 1
        return asked > 20

    stopped = anytime.first(world.initial, Limits(stop=stop), team=["robot1"])
    assert (stopped.plan, asked) == (None, 22)
    assert anytime.first(world.initial, team=["robot1"]).plan is not None
