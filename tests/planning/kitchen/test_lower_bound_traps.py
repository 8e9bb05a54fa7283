"""Situations in which the heuristic is easily too high, or a shortest plan easily missed."""

from __future__ import annotations

import pytest

from robotouille import State
from robotouille.planning.solvers import solve
from tests.planning.kitchen.exact import check_answer, check_heuristic, explored
from tests.planning.kitchen.rows import FACTS, placed, row, term
from tests.world.kitchens import act, kitchen, waiting


def check(state: State, steps: int | None, cap: int = 4000) -> list[str]:
    """Everything that can follow agrees with brute force; the actions of the plan from here."""
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


def test_cooking_goes_on_in_the_step_in_which_the_patty_is_put_back() -> None:
    world = row("stove table", ("iscooked", "patty+1"), things="patty@0", cook_time=2)
    state = waiting(act(world.initial, "cook", "robot1", "patty1", "stove1"), 1)
    state = act(state, "pick-up-item", "robot1", "patty1", "stove1")
    assert check(state, 1) == ["place-item"]


def test_water_boils_in_the_bowl_while_the_empty_pot_is_on_the_stove() -> None:
    world = row("stove table", *SOUP, things="pot@0 water@0 bowl@1", boil_time=3)
    state = act(world.initial, "boil-water", "robot1", "water1", "pot1", "stove1")
    state = act(state, "pick-up-container", "robot1", "pot1", "stove1")
    state = act(state, "move", "robot1", "stove1", "table1")
    assert check(state, 5)[:3] == ["fill-bowl", "move", "place-container"]


def test_water_is_poured_once_it_boils() -> None:
    world = row("stove table", *SOUP, things="pot@0 water@0 bowl@1", boil_time=3)
    check(world.initial, 7)


def test_what_is_taken_off_the_top_may_stay_in_the_hand() -> None:
    goal = [("item_on", "bread+1 table+2"), ("clear", "bread+1")]
    world = row("table table", *goal, things="bread@1 lettuce@1")
    assert check(world.initial, 2) == ["move", "unstack"]


def test_a_piece_that_needs_no_place_may_stay_in_the_hand() -> None:
    world = row("table board", *BURGER[:1], ("clear", "bottombun+1"), ("iscut", "lettuce+3"),
                things="bottombun@0 lettuce@0", num_cuts=1)  # fmt: skip
    check(world.initial, 4)


def test_a_piece_in_the_hand_is_not_clear() -> None:
    world = row("table table", ("clear", "cheese+1"), things="cheese@0")
    state = act(world.initial, "pick-up-item", "robot1", "cheese1", "table1")
    assert check(state, 1) == ["place-item"]


def test_a_clear_piece_below_another_of_the_goal() -> None:
    goal = [("iscooked", "patty+1"), ("clear", "cheese+2")]
    world = row("table stove", *goal, things="cheese@0 patty@0", cook_time=1)
    check(world.initial, 5)


def test_what_is_of_no_use_goes_into_the_pot() -> None:
    world = row("stove table", ("isboiling", "water+1"), things="pot@0 water@0 bread@1 cheese@1",
                at=1, boil_time=1)  # fmt: skip
    state = act(world.initial, "unstack", "robot1", "cheese1", "bread1", "table1")
    check(state, 4)
    state = act(state, "move", "robot1", "table1", "stove1")
    assert check(state, 3) == ["add-to", "boil-water"]


def test_the_top_lies_below_what_goes_under_it() -> None:
    world = row("table table table", *BURGER[:1], *BURGER[2:], things="topbun@0 bottombun@0")
    check(world.initial, 7)


def test_the_top_is_in_place_before_something_that_goes_below_it() -> None:
    world = row("table table table", *BURGER, things="bottombun@0 topbun@0 patty@1")
    check(world.initial, 11)


def test_the_station_is_taken_by_what_could_stay_there() -> None:
    world = row("table board table", *SANDWICH, ("iscut", "lettuce+3"), num_cuts=1,
                things="bread@0 cheese@1 lettuce@2")  # fmt: skip
    check(world.initial, 12)


@pytest.mark.parametrize(("cook_time", "steps"), [(0, 4), (1, 5), (4, 8)])
def test_a_delay(cook_time: int, steps: int) -> None:
    world = row("table stove", ("iscooked", "patty+1"), things="patty@0", cook_time=cook_time)
    check(world.initial, steps)


def test_no_delay_for_water() -> None:
    world = row("sink table", ("in", "water+1 bowl+2"), things="pot@0 bowl@1", fill_time=0)
    assert check(world.initial, 4) == ["fill-pot", "pick-up-container", "move", "fill-bowl"]


def test_back_in_the_very_step_in_which_the_water_is_made() -> None:
    world = row("sink table", ("addedto", "onion+1 water+2"), things="pot@0 onion@1", fill_time=3)
    assert check(world.initial, 5) == ["fill-pot", "move", "pick-up-item", "move", "add-to"]


def test_cooked_and_fried_in_any_order() -> None:
    goal = [("iscooked", "chicken+1"), ("isfried", "chicken+1")]
    world = row("stove fryer table", *goal, ("item_on", "bread+2 table+3"),
                ("atop", "chicken+1 bread+2"), things="bread@0 chicken@1", at=1,
                cook_time=0, fry_time=0)  # fmt: skip
    check(world.initial, 13)


def test_fried_without_a_word_of_cutting() -> None:
    world = row("board fryer", ("isfried", "onion+1"), things="onion@0", num_cuts=1, fry_time=0)
    assert check(world.initial, 5) == ["cut", "pick-up-item", "move", "place-item", "fry"]


def test_cut_from_the_start_but_not_yet_fit_for_frying() -> None:
    """What a cut brings about besides needs another cut."""
    world = kitchen(
        stations=placed([("board", 0), ("fryer", 1)]),
        items=[{"name": "onion", "x": 0, "y": 0, "predicates": [*FACTS["onion"], "iscut"]}],
        config={"num_cuts": {"default": 2}, "fry_time": {"default": 0}},
        goal=[term("iscut", "onion+1"), term("isfried", "onion+1")],
    )
    assert check(world.initial, 5) == ["cut", "pick-up-item", "move", "place-item", "fry"]


def test_spoiled() -> None:
    """The onion went into the water uncut."""
    goal = [("addedto", "onion+1 water+2"), ("iscut", "onion+1")]
    world = row("stove board", *goal, things="pot@0 water@0 onion@1", at=1)
    state = act(world.initial, "pick-up-item", "robot1", "onion1", "board1")
    state = act(state, "move", "robot1", "board1", "stove1")
    state = act(state, "add-to", "robot1", "onion1", "water1", "pot1", "stove1")
    check(state, None)


@pytest.mark.parametrize(("stations", "steps"), [("table table", None), ("table table fryer", 12)])
def test_piles_are_turned_over_only_with_room(stations: str, steps: int | None) -> None:
    goal = [("atop", "bread+1 cheese+2"), ("item_on", "cheese+2 table+3")]
    world = row(stations, *goal, things="bread@0 cheese@0 lettuce@1")
    check(world.initial, steps)


def test_nothing_left_to_do() -> None:
    assert check(row("table", BURGER[0], things="bottombun@0").initial, 0) == []
