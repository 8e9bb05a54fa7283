"""Kitchens that a row of stations divides."""

from __future__ import annotations

from dataclasses import replace

import pytest

from robotouille import World, load_task
from robotouille.world.scene import scene

LEFT = {"crate1", "crate2", "crate3", "table1"}
RIGHT = {"board1", "hatch1", "bin1", "table7"}
COUNTER = {f"table{i}" for i in range(2, 7)}


@pytest.fixture(scope="module")
def counter() -> World:
    return World(load_task("shifts/04_counter", seats=2))


def test_players_walk_only_to_the_stations_of_their_side(counter: World) -> None:
    assert counter.reached_by("robot1") == LEFT | COUNTER
    assert counter.reached_by("robot2") == RIGHT | COUNTER
    walks = {a.destination for a in counter.initial.actions("robot1") if a.destination}
    assert walks <= LEFT | COUNTER
    assert not counter.is_undivided


def test_a_kitchen_is_divided_even_if_all_players_are_on_one_side(counter: World) -> None:
    alone = World(replace(counter.task, seats=1))
    assert alone.reached_by("robot1") == LEFT | COUNTER
    assert not alone.is_undivided


def test_players_stand_on_their_own_side_of_the_counter(counter: World) -> None:
    state = counter.initial
    for player, station, side in (("robot1", "table4", 3), ("robot2", "table5", 5)):
        walk = next(a for a in state.actions(player) if a.destination == station)
        state = state.step([walk]).state
        tile = scene(state)[player].tile
        assert tile is not None
        assert tile[0] == side


def test_walks_to_the_counter_are_as_long_as_on_the_floor(counter: World) -> None:
    floor = counter.floor
    assert floor.stations["table6"] == (4, 4)
    assert floor.distance("hatch1", "table6") == 4
    assert floor.distance("table1", "table2") == 4


def test_other_kitchens_are_not_divided() -> None:
    assert World(load_task("shifts/01_sandwich_bar", seats=2)).is_undivided
    assert World(load_task("multi_agent/01_lettuce_burger", seats=2)).is_undivided
