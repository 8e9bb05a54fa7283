"""Results of the kitchen planner for one and two cooks, limits and callbacks."""

from __future__ import annotations

import os
import random
from pathlib import Path
from typing import Any

import pytest

from robotouille import State, World, load_task
from robotouille.domain.json_files import read_model
from robotouille.domain.schema import DomainFile
from robotouille.planning.kitchen.solver import PLANNER, kitchen_search
from robotouille.planning.plan import Limits, Proof, SearchResult, replay
from robotouille.planning.solvers import solve
from tests.planning.kitchen.kitchens import (
    Explored,
    check_answer,
    check_heuristic,
    check_turns,
    explored,
)
from tests.planning.kitchen.random_kitchens import random_kitchen
from tests.support.samples import quick_sample
from tests.support.solvers import SHIPPED
from tests.world.kitchens import kitchen

UPSTREAM = Path(__file__).resolve().parents[4] / "shared/compat/upstream"
PUBLISHED = {
    "synchronous/0_cheese_sandwich": 8,
    "synchronous/2_lettuce_tomato_sandwich": 24,
    "synchronous/4_cheeseburger": 15,
    "synchronous/6_lettuce_tomato_cheeseburger": None,
    "synchronous/8_two_lettuce_tomato_burger": None,
    "asynchronous/0_cheese_chicken_sandwich": 21,
    "asynchronous/2_lettuce_tomato_fried_chicken_sandwich": None,
    "asynchronous/4_onion_cheese_burger_and_fried_onion": None,
    "asynchronous/6_onion_soup": None,
    "asynchronous/8_onion_tomato_soup_and_two_chicken_sandwich": None,
}
"""Lengths that an independent planner proves; None where it finds no proof in good time."""

LARGE = "asynchronous/10"
"""A kitchen that takes more than a hundred expansions."""


def check(world: World, answer: SearchResult, length: int | None) -> None:
    assert answer.optimal
    assert answer.plan is not None
    assert answer.planner == PLANNER
    assert answer.proof is Proof.HEURISTIC
    assert len(answer.plan) == answer.bound == (length or answer.bound)
    assert replay(answer.plan, world).ok


@pytest.mark.parametrize("name", quick_sample(SHIPPED, 8))
def test_shipped_kitchens_are_proven(name: str) -> None:
    world = World(name)
    answer = solve(world)
    check(world, answer, SHIPPED[name])
    assert answer.expansions < 1000


@pytest.mark.skipif(not UPSTREAM.is_dir(), reason="no published files next to the project")
@pytest.mark.parametrize("name", quick_sample(PUBLISHED, 3, nightly=9))
def test_published_kitchens_are_proven(name: str) -> None:
    domain = read_model(UPSTREAM / "domain/robotouille.json", DomainFile)
    path = UPSTREAM / f"problems/{name}.json"
    world = World(load_task(str(path), domain=domain))
    check(world, solve(world), PUBLISHED[name])


@pytest.mark.parametrize("most", [0, 1, 7, 50, 120])
def test_expansion_limit_gives_plan_and_bound(most: int) -> None:
    world = World(LARGE)
    answer = solve(world, limits=Limits(expansions=most))
    assert answer.expansions <= most
    check_within_limits(world, answer)


@pytest.mark.slow
@pytest.mark.parametrize("most", quick_sample([100, 1, 10_000]))
def test_state_limit_ends_the_search(most: int) -> None:
    world = World(LARGE)
    check_within_limits(world, solve(world, limits=Limits(states=most)))


def check_within_limits(world: World, answer: SearchResult) -> None:
    length = SHIPPED[world.task.name]
    assert answer.bound <= length
    assert not answer.unsolvable
    assert answer.optimal == (answer.plan is not None and answer.bound == len(answer.plan))
    if answer.plan is not None:
        assert len(answer.plan) >= length
        assert replay(answer.plan, world).ok


def test_stop_before_the_start() -> None:
    asked: list[bool] = []

    def stop() -> bool:
        asked.append(True)
        return True

    world = World(LARGE)
    answer = solve(world, limits=Limits(stop=stop))
    assert asked
    assert answer.expansions == 0
    assert answer.plan is None
    check_within_limits(world, answer)


def test_watch_receives_progress() -> None:
    received: list[tuple[int, int, int | None]] = []
    world = World(LARGE)
    answer = solve(world, watch=lambda *news: received.append(news))
    assert received
    bounds = [bound for _, bound, _ in received]
    assert bounds == sorted(bounds)
    assert bounds[-1] <= answer.bound
    expansions = [done for done, _, _ in received]
    assert expansions == sorted(expansions)
    assert expansions[-1] <= answer.expansions


def test_solves_later_states() -> None:
    world = World("asynchronous/07")
    answer = solve(world)
    assert answer.plan is not None
    state = world.initial
    for number, joint in enumerate(answer.plan):
        if number % 3 == 0:
            rest = solve(world, state)
            assert rest.plan is not None
            assert rest.bound == len(rest.plan) == len(answer.plan) - number
            assert replay(rest.plan, world, state).ok
        state = state.step(joint).state


def test_other_goals_are_left_to_another_planner() -> None:
    world = kitchen(goal=[{"predicate": "loc", "args": ["robot", "table"], "ids": [1, 2]}])
    assert kitchen_search(world, world.initial) is None
    answer = solve(world)
    assert answer.optimal
    assert answer.planner != PLANNER


ORDERED = int(os.environ.get("ROBOTOUILLE_ORACLE_TASKS", "0"))
SMALL = {
    "sandwich": [0, 15, 23, 33, 43],
    "stack": [5, 10, 18, 43],
    "loose pieces": [1, 19, 28, 35],
    "side dish": [22],
    "two plates": [13, 92],
}
"""Seeds of kitchens with a few hundred states for two cooks."""


def check_pair(found: Explored, sample: int) -> None:
    """Check the heuristics of all states and the results from some."""
    for state, distance in zip(found.states, found.distances, strict=True):
        check_heuristic(state, distance)
    numbers = random.Random(1).sample(range(len(found.states)), min(sample, len(found.states)))
    for number in {0, *numbers}:
        check_answer(found.states[number], found.distances[number])


@pytest.mark.parametrize(
    ("dish", "seed"), quick_sample([(d, s) for d, seeds in SMALL.items() for s in seeds], 2)
)
def test_random_kitchens_match_brute_force(dish: str, seed: int) -> None:
    found = explored(World(random_kitchen(seed, players=2, dish=dish)), 1000)
    assert found is not None
    assert kitchen_search(found.world, found.world.initial) is not None
    check_pair(found, 12)


@pytest.mark.skipif(not ORDERED, reason="ROBOTOUILLE_ORACLE_TASKS orders no more")
def test_ordered_kitchens_match_brute_force() -> None:
    first = random.randrange(1 << 40)
    for seed in range(first, first + ORDERED):
        found = explored(World(random_kitchen(seed, players=2)), 2500)
        if found is not None and kitchen_search(found.world, found.world.initial) is not None:
            check_pair(found, 20)


Json = dict[str, Any]


def pair(stations: str, goal: list[Json], things: dict[str, int], **fields: Any) -> World:
    """Return a world with two cooks at the first two of some stations in a row."""
    kinds = stations.split()
    facts = {"lettuce": ["iscuttable"], "patty": ["iscookable"], "onion": ["iscuttable"]}
    return kitchen(
        width=len(kinds),
        stations=[{"name": kind, "x": x, "y": 0} for x, kind in enumerate(kinds)],
        items=[
            {"name": kind, "x": x, "y": 0, "predicates": facts.get(kind, [])}
            for kind, x in things.items()
            if kind not in ("pot", "bowl")
        ],
        containers=[
            {"name": kind, "x": x, "y": 0} for kind, x in things.items() if kind in ("pot", "bowl")
        ],
        players=[{"name": "robot", "x": x, "y": 1, "direction": [0, -1]} for x in range(2)],
        goal=goal,
        **fields,
    )


def term(predicate: str, *variables: tuple[str, int]) -> Json:
    kinds, ids = zip(*variables, strict=True)
    return {"predicate": predicate, "args": kinds, "ids": ids}


def delays(**steps: int) -> Json:
    return {name: {"default": number} for name, number in steps.items()}


def agrees(world: World, steps: int | None, cap: int = 3000) -> None:
    found = explored(world, cap)
    assert found is not None
    assert found.distances[0] == steps
    check_pair(found, 20)
    assert solve(world).planner == PLANNER


def test_two_cut_and_one_serves() -> None:
    cut = [term("iscut", ("lettuce", 1)), term("iscut", ("onion", 2))]
    world = pair("board board", cut, {"lettuce": 0, "onion": 1}, config=delays(num_cuts=2))
    agrees(world, 2)


def test_cook_leaves_the_board_for_another() -> None:
    goal = [term("iscut", ("lettuce", 1))]
    config = delays(num_cuts=1)
    agrees(pair("table board table", goal, {"lettuce": 0}, config=config), 4)


def test_cook_enters_a_station_as_another_leaves() -> None:
    goal = [term("atop", ("cheese", 1), ("bread", 2)), term("item_on", ("bread", 2), ("table", 3))]
    agrees(pair("table table board", goal, {"cheese": 0, "bread": 2}), 6)


def test_no_free_station_blocks_all_cooks() -> None:
    goal = [term("iscooked", ("patty", 1))]
    agrees(pair("stove table", goal, {"patty": 1}, config=delays(cook_time=0)), None)


@pytest.mark.slow
def test_delay_that_ends_with_a_step_needs_no_waiting() -> None:
    goal = [
        term("iscooked", ("patty", 1)),
        term("item_on", ("patty", 1), ("table", 3)),
        term("item_on", ("cheese", 2), ("table", 4)),
    ]
    things = {"patty": 0, "cheese": 3}
    world = pair("stove table table sink", goal, things, config=delays(cook_time=1))
    found = explored(world, 3000)
    assert found is not None
    check_turns(found)


@pytest.mark.slow
def test_two_cooks_prepare_water() -> None:
    goal = [term("in", ("water", 1), ("bowl", 2))]
    config = delays(fill_time=1)
    agrees(pair("sink table table", goal, {"pot": 0, "bowl": 1}, config=config), 5)


@pytest.mark.slow
def test_boiling_and_fetching_in_parallel() -> None:
    goal = [term("isboiling", ("water", 1)), term("addedto", ("onion", 2), ("water", 1))]
    config = delays(boil_time=2)
    agrees(
        pair("stove table table", goal, {"pot": 0, "onion": 1}, config=config, meals=WATER), 3, 6000
    )


WATER = [{"name": "water", "x": 0, "y": 0}]


def test_both_cooks_hold_objects() -> None:
    goal = [term("atop", ("cheese", 1), ("bread", 2)), term("item_on", ("bread", 2), ("table", 3))]
    world = pair("table table table", goal, {"cheese": 0, "bread": 1})
    state: State = world.initial
    for player, item, table in (("robot1", "cheese1", "table1"), ("robot2", "bread1", "table2")):
        state = state.step(world.action("pick-up-item", player, item, table)).state
    found = explored(world, 3000, state)
    assert found is not None
    assert found.distances[0] == 3
    check_pair(found, 20)
