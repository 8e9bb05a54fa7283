"""The heuristic: a worked example, traps, and comparison with brute force on random kitchens."""

from __future__ import annotations

import os
import random
from typing import Any

import pytest

from robotouille import State, World
from robotouille.planning.kitchen.solver import kitchen_search
from robotouille.planning.solvers import solve
from tests.planning.kitchen.kitchens import (
    FACTS,
    check_answer,
    check_heuristic,
    explored,
    placed,
    row,
    term,
)
from tests.planning.kitchen.random_kitchens import random_kitchen
from tests.support.samples import quick_sample
from tests.world.kitchens import act, kitchen, waiting

ORDERED = int(os.environ.get("ROBOTOUILLE_ORACLE_TASKS", "0"))
SAMPLE = 14
BLOCK = 20


SMALL = {
    "sandwich": [13, 15, 17, 25, 32, 33, 34],
    "stack": [7, 13, 15, 18, 21, 36],
    "loose pieces": [35, 37, 40, 52, 55, 59, 64],
    "side dish": [4, 5, 20, 22, 36, 103],
    "two plates": [20, 30, 36, 51],
    "soup": [6, 55, 86, 121, 164, 201],
    "soup with more vessels": [137, 200, 222, 241, 246, 259],
    "two soups": [14, 28, 31, 32, 37, 67],
    "soup and sandwich": [6, 70],
    "meals in turn": [53, 196],
    "patties in turn": [126, 139],
}
"""Seeds of kitchens with some hundreds of states."""


def check_kitchen(seed: int, cap: int, sample: int, dish: str | None = None) -> bool:
    """Check some states of a kitchen. Return False if it has too many states."""
    world = World(random_kitchen(seed, dish=dish))
    found = explored(world, cap)
    if found is None or kitchen_search(world, world.initial) is None:
        return False
    rng = random.Random(seed)
    numbers = {0, *rng.sample(range(len(found.states)), min(sample, len(found.states)))}
    for number in sorted(numbers):
        check_heuristic(found.states[number], found.distances[number])
        check_answer(found.states[number], found.distances[number])
    return True


def small_kitchens() -> list[object]:
    """Return dishes and seeds of `SMALL`, few of them except in nightly runs."""
    firsts = [(dish, seeds[0]) for dish, seeds in SMALL.items()]
    others = [(dish, seed) for dish, seeds in SMALL.items() for seed in seeds[1:]]
    return quick_sample([*firsts, *others], 2, nightly=3 * len(firsts))


@pytest.mark.parametrize("block", quick_sample(range(16), 0, nightly=4))
def test_answers_match_brute_force(block: int) -> None:
    checked = [check_kitchen(1000 * block + n, 1000, SAMPLE) for n in range(BLOCK)]
    assert sum(checked) > 2


@pytest.mark.parametrize(("dish", "seed"), small_kitchens())
def test_heuristic_is_admissible_in_all_states(dish: str, seed: int) -> None:
    found = explored(World(random_kitchen(seed, dish=dish)), 1500)
    assert found is not None
    for state, distance in zip(found.states, found.distances, strict=True):
        assert check_heuristic(state, distance)


@pytest.mark.skipif(not ORDERED, reason="ROBOTOUILLE_ORACLE_TASKS orders no more")
def test_ordered_kitchens_match_brute_force() -> None:
    first = random.randrange(1 << 40)
    for seed in range(first, first + ORDERED):
        check_kitchen(seed, 20_000, 40)
        check_kitchen(seed, 20_000, 40, random.choice(["meals in turn", "patties in turn"]))


def check(state: State, steps: int | None, cap: int = 4000) -> list[str]:
    """Compare all following states with brute force and return the plan's actions."""
    found = explored(state.world, cap, state)
    assert found is not None
    assert found.distances[0] == steps
    for later, distance in zip(found.states, found.distances, strict=True):
        check_heuristic(later, distance)
    every = max(1, len(found.states) // 40)
    for later, distance in list(zip(found.states, found.distances, strict=True))[::every]:
        check_answer(later, distance)
    plan = solve(state.world, state).plan
    return [action.name for joint in plan for action in joint] if plan else []


SANDWICH = [("item_on", "bread+1 table+2"), ("item_at", "lettuce+3 table+2")]
BURGER = [
    ("item_on", "bottombun+1 table+2"),
    ("item_at", "patty+3 table+2"),
    ("item_at", "topbun+4 table+2"),
    ("clear", "topbun+4"),
]
SOUP = [("in", "water+1 bowl+2"), ("isboiling", "water+1")]


def test_cooking_continues_when_the_patty_returns() -> None:
    world = row("stove table", ("iscooked", "patty+1"), things="patty@0", cook_time=2)
    state = waiting(act(world.initial, "cook", "robot1", "patty1", "stove1"), 1)
    state = act(state, "pick-up-item", "robot1", "patty1", "stove1")
    assert check(state, 1) == ["place-item"]


def test_water_boils_in_the_bowl_with_the_pot_on_the_stove() -> None:
    world = row("stove table", *SOUP, things="pot@0 water@0 bowl@1", boil_time=3)
    state = act(world.initial, "boil-water", "robot1", "water1", "pot1", "stove1")
    state = act(state, "pick-up-container", "robot1", "pot1", "stove1")
    state = act(state, "move", "robot1", "stove1", "table1")
    assert check(state, 5)[:3] == ["fill-bowl", "move", "place-container"]


TWO_SOUPS = [*SOUP, ("in", "water+3 bowl+4"), ("isboiling", "water+3")]


@pytest.mark.parametrize(("boil_time", "steps"), [(2, 24), (3, 25)])
def test_poured_water_boils_on_with_the_next_water(boil_time: int, steps: int) -> None:
    world = row("table stove sink table", *TWO_SOUPS, things="pot@1 bowl@0 bowl@3", at=3,
                boil_time=boil_time, fill_time=0)  # fmt: skip
    check_answer(world.initial, steps)


def test_random_kitchen_with_two_soups() -> None:
    check_answer(World(random_kitchen(111)).initial, 24)


def test_interrupted_filling_gives_a_pot_two_meals() -> None:
    check_answer(World(random_kitchen(7700132, dish="meals in turn")).initial, 18)


BOTH_BOIL = [("isboiling", "water+1"), ("isboiling", "water+2")]
TWO_MEALS: dict[str, tuple[str, list[tuple[str, str]], str, int]] = {
    "boiled": ("stove", BOTH_BOIL, "", 4),
    "boiled, and one is poured": ("stove table", [*SOUP, ("isboiling", "water+3")], "bowl@1", 7),
    "boiled and poured": ("stove table table", TWO_SOUPS, "bowl@1 bowl@2", 9),
    "boiled, and one gets an item":
        ("stove table", [*BOTH_BOIL, ("addedto", "onion+3 water+2")], "onion@1", 6),
}  # fmt: skip


@pytest.mark.parametrize(
    ("stations", "goal", "things", "steps"), TWO_MEALS.values(), ids=TWO_MEALS.keys()
)
def test_two_meals_in_one_pot(
    stations: str, goal: list[tuple[str, str]], things: str, steps: int
) -> None:
    things = f"pot@0 water@0 water@0 {things}"
    check_answer(row(stations, *goal, things=things, boil_time=2).initial, steps)


@pytest.mark.slow
def test_poured_water_and_more_water_in_the_same_pot() -> None:
    goal = [*SOUP, ("isboiling", "water+3")]
    world = row("sink stove table", *goal, things="pot@1 water@1 bowl@2", at=1,
                boil_time=3, fill_time=0)  # fmt: skip
    check(world.initial, 14)


def test_patty_goes_back_to_the_stove_on_which_it_was_nearly_done() -> None:
    world = row("stove stove", ("iscooked", "patty+1"), things="patty@0", cook_time=6)
    state = waiting(act(world.initial, "cook", "robot1", "patty1", "stove1"), 5)
    state = act(state, "pick-up-item", "robot1", "patty1", "stove1")
    state = act(state, "move", "robot1", "stove1", "stove2")
    state = act(state, "place-item", "robot1", "patty1", "stove2")
    check_heuristic(state, 3)
    check_answer(state, 3)


def test_pot_goes_back_to_the_stove_on_which_its_water_nearly_boiled() -> None:
    world = row("stove stove", ("isboiling", "water+1"), things="pot@0 water@0", boil_time=6)
    state = waiting(act(world.initial, "boil-water", "robot1", "water1", "pot1", "stove1"), 5)
    state = act(state, "pick-up-container", "robot1", "pot1", "stove1")
    state = act(state, "move", "robot1", "stove1", "stove2")
    state = act(state, "place-container", "robot1", "pot1", "stove2")
    check_heuristic(state, 3)
    check_answer(state, 3)


def test_useless_item_goes_into_a_pot_that_is_in_the_way() -> None:
    goal = [("addedto", "onion+1 water+2"), ("iscut", "onion+1")]
    world = row("board table table", *goal, things="pot@0 water@0 onion@1 bread@1", at=1,
                num_cuts=1)  # fmt: skip
    check(act(world.initial, "unstack", "robot1", "bread1", "onion1", "table1"), 13)


def test_held_item_is_not_clear() -> None:
    world = row("table table", ("clear", "cheese+1"), things="cheese@0")
    state = act(world.initial, "pick-up-item", "robot1", "cheese1", "table1")
    assert check(state, 1) == ["place-item"]


def test_useless_item_goes_into_the_pot() -> None:
    world = row("stove table", ("isboiling", "water+1"), things="pot@0 water@0 bread@1 cheese@1",
                at=1, boil_time=1)  # fmt: skip
    state = act(world.initial, "unstack", "robot1", "cheese1", "bread1", "table1")
    check(state, 4)
    state = act(state, "move", "robot1", "table1", "stove1")
    assert check(state, 3) == ["add-to", "boil-water"]


def test_initially_cut_item_needs_another_cut_before_frying() -> None:
    world = kitchen(
        stations=placed([("board", 0), ("fryer", 1)]),
        items=[{"name": "onion", "x": 0, "y": 0, "predicates": [*FACTS["onion"], "iscut"]}],
        config={"num_cuts": {"default": 2}, "fry_time": {"default": 0}},
        goal=[term("iscut", "onion+1"), term("isfried", "onion+1")],
    )
    assert check(world.initial, 5) == ["cut", "pick-up-item", "move", "place-item", "fry"]


def test_spoiled_soup_is_a_dead_end() -> None:
    goal = [("addedto", "onion+1 water+2"), ("iscut", "onion+1")]
    world = row("stove board", *goal, things="pot@0 water@0 onion@1", at=1)
    state = act(world.initial, "pick-up-item", "robot1", "onion1", "board1")
    state = act(state, "move", "robot1", "board1", "stove1")
    state = act(state, "add-to", "robot1", "onion1", "water1", "pot1", "stove1")
    check(state, None)


COOKED, PILE = (
    ("iscooked", "patty+1"),
    [("atop", "bread+1 cheese+2"), ("item_on", "cheese+2 table+3")],
)
FRIED_ON_BREAD = [
    ("iscooked", "chicken+1"), ("isfried", "chicken+1"),
    ("item_on", "bread+2 table+3"), ("atop", "chicken+1 bread+2"),
]  # fmt: skip
CASES: dict[str, tuple[str, list[tuple[str, str]], dict[str, Any], int | None]] = {
    "goal state": ("table", BURGER[:1], {"things": "bottombun@0"}, 0),
    "no delay": ("table stove", [COOKED], {"things": "patty@0", "cook_time": 0}, 4),
    "a delay of one step": ("table stove", [COOKED], {"things": "patty@0", "cook_time": 1}, 5),
    "a delay of four steps": ("table stove", [COOKED], {"things": "patty@0", "cook_time": 4}, 8),
    "boiling water is poured":
        ("stove table", SOUP, {"things": "pot@0 water@0 bowl@1", "boil_time": 3}, 7),
    "an item without a goal place may stay in hand":
        ("table board", [BURGER[0], ("clear", "bottombun+1"), ("iscut", "lettuce+3")],
         {"things": "bottombun@0 lettuce@0", "num_cuts": 1}, 4),
    "a clear item lies below another goal item":
        ("table stove", [COOKED, ("clear", "cheese+2")],
         {"things": "cheese@0 patty@0", "cook_time": 1}, 5),
    "the top starts below its support":
        ("table table table", [BURGER[0], *BURGER[2:]], {"things": "topbun@0 bottombun@0"}, 7),
    "the top is placed before its support":
        ("table table table", BURGER, {"things": "bottombun@0 topbun@0 patty@1"}, 11),
    "a placed item blocks a needed station":
        ("table board table", [*SANDWICH, ("iscut", "lettuce+3")],
         {"things": "bread@0 cheese@1 lettuce@2", "num_cuts": 1}, 12),
    "cooked and fried in any order":
        ("stove fryer table", FRIED_ON_BREAD,
         {"things": "bread@0 chicken@1", "at": 1, "cook_time": 0, "fry_time": 0}, 13),
    "no room to reverse a pile":
        ("table table", PILE, {"things": "bread@0 cheese@0 lettuce@1"}, None),
    "room to reverse a pile":
        ("table table fryer", PILE, {"things": "bread@0 cheese@0 lettuce@1"}, 12),
}  # fmt: skip


@pytest.mark.parametrize(
    ("stations", "goal", "options", "steps"), quick_sample(CASES.values(), 5), ids=CASES.keys()
)
def test_all_states_match_brute_force(
    stations: str, goal: list[tuple[str, str]], options: dict[str, Any], steps: int | None
) -> None:
    check(row(stations, *goal, **options).initial, steps)


@pytest.mark.parametrize(
    ("stations", "goal", "options", "actions"),
    [
        ("table table", [("item_on", "bread+1 table+2"), ("clear", "bread+1")],
         {"things": "bread@1 lettuce@1"}, ["move", "unstack"]),
        ("sink table", [("in", "water+1 bowl+2")], {"things": "pot@0 bowl@1", "fill_time": 0},
         ["fill-pot", "pick-up-container", "move", "fill-bowl"]),
        ("sink table", [("addedto", "onion+1 water+2")],
         {"things": "pot@0 onion@1", "fill_time": 3},
         ["fill-pot", "move", "pick-up-item", "move", "add-to"]),
        ("board fryer", [("isfried", "onion+1")],
         {"things": "onion@0", "num_cuts": 1, "fry_time": 0},
         ["cut", "pick-up-item", "move", "place-item", "fry"]),
    ],
    ids=["a removed top may stay in hand", "water without delay", "return when the water is made",
         "frying implies cutting"],
)  # fmt: skip
def test_plan_has_these_actions(
    stations: str, goal: list[tuple[str, str]], options: dict[str, Any], actions: list[str]
) -> None:
    assert check(row(stations, *goal, **options).initial, len(actions)) == actions
