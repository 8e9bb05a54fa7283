"""Two cooks: brute force over all joint actions, in both orders, agrees."""

from __future__ import annotations

import os
import random
from typing import Any

import pytest

from robotouille import State, World
from robotouille.planners.kitchen.solver import PLANNER, kitchen_search
from robotouille.planning.solvers import solve
from tests.planning.kitchen.exact import Explored, check_answer, check_heuristic, explored
from tests.planning.kitchen.random_kitchens import random_kitchen
from tests.support.samples import first_quickly
from tests.world.kitchens import kitchen

ORDERED = int(os.environ.get("ROBOTOUILLE_ORACLE_TASKS", "0"))
SMALL = {
    "sandwich": [0, 15, 23, 33, 43],
    "stack": [5, 10, 18, 43],
    "loose pieces": [1, 19, 28, 35],
    "side dish": [22],
    "two plates": [13, 92],
}
"""Seeds of kitchens with a few hundred states for two cooks."""


def check(found: Explored, sample: int) -> None:
    """The heuristics of all states and the answers from some."""
    for state, distance in zip(found.states, found.distances, strict=True):
        check_heuristic(state, distance)
    numbers = random.Random(1).sample(range(len(found.states)), min(sample, len(found.states)))
    for number in {0, *numbers}:
        check_answer(found.states[number], found.distances[number])


@pytest.mark.parametrize(
    ("dish", "seed"), first_quickly([(d, s) for d, seeds in SMALL.items() for s in seeds], 4)
)
def test_random_kitchens(dish: str, seed: int) -> None:
    found = explored(World(random_kitchen(seed, players=2, dish=dish)), 1000)
    assert found is not None
    assert kitchen_search(found.world, found.world.initial) is not None
    check(found, 12)


@pytest.mark.skipif(not ORDERED, reason="ROBOTOUILLE_ORACLE_TASKS orders no more")
def test_many_more() -> None:
    first = random.randrange(1 << 40)
    for seed in range(first, first + ORDERED):
        found = explored(World(random_kitchen(seed, players=2)), 2500)
        if found is not None and kitchen_search(found.world, found.world.initial) is not None:
            check(found, 20)


Json = dict[str, Any]


def pair(stations: str, goal: list[Json], things: dict[str, int], **fields: Any) -> World:
    """Two cooks at the first two of some stations in a row."""
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
    check(found, 20)
    assert solve(world).planner == PLANNER


def test_both_cut_and_one_serves() -> None:
    cut = [term("iscut", ("lettuce", 1)), term("iscut", ("onion", 2))]
    world = pair("board board", cut, {"lettuce": 0, "onion": 1}, config=delays(num_cuts=2))
    agrees(world, 2)


def test_one_makes_room_for_another() -> None:
    """Two of three places are taken; the board has to be left for whoever brings the lettuce."""
    goal = [term("iscut", ("lettuce", 1))]
    config = delays(num_cuts=1)
    agrees(pair("table board table", goal, {"lettuce": 0}, config=config), 4)


def test_one_comes_in_the_step_in_which_another_leaves() -> None:
    """First the bread has to be put down, then its place to be left for the cheese."""
    goal = [term("atop", ("cheese", 1), ("bread", 2)), term("item_on", ("bread", 2), ("table", 3))]
    agrees(pair("table table board", goal, {"cheese": 0, "bread": 2}), 6)


def test_nobody_can_move_where_there_are_no_more_places_than_cooks() -> None:
    goal = [term("iscooked", ("patty", 1))]
    agrees(pair("stove table", goal, {"patty": 1}, config=delays(cook_time=0)), None)


@pytest.mark.slow
@pytest.mark.slow
def test_water_for_two() -> None:
    goal = [term("in", ("water", 1), ("bowl", 2))]
    config = delays(fill_time=1)
    agrees(pair("sink table table", goal, {"pot": 0, "bowl": 1}, config=config), 5)


@pytest.mark.slow
@pytest.mark.slow
def test_one_boils_while_another_fetches() -> None:
    goal = [term("isboiling", ("water", 1)), term("addedto", ("onion", 2), ("water", 1))]
    config = delays(boil_time=2)
    agrees(
        pair("stove table table", goal, {"pot": 0, "onion": 1}, config=config, meals=WATER), 3, 6000
    )


WATER = [{"name": "water", "x": 0, "y": 0}]


def test_states_in_which_both_hold_something() -> None:
    goal = [term("atop", ("cheese", 1), ("bread", 2)), term("item_on", ("bread", 2), ("table", 3))]
    world = pair("table table table", goal, {"cheese": 0, "bread": 1})
    state: State = world.initial
    for player, item, table in (("robot1", "cheese1", "table1"), ("robot2", "bread1", "table2")):
        state = state.step(world.action("pick-up-item", player, item, table)).state
    found = explored(world, 3000, state)
    assert found is not None
    assert found.distances[0] == 3
    check(found, 20)
