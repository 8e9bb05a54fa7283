"""Things that are served or thrown away: created ones, and parts that only their kind describes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from robotouille import State, World
from robotouille.domain.loading import load_task
from robotouille.protocol.states import StateReader, StateWriter
from tests.support.shifts import BISTRO, term

ME = "robot1"


def diner(griddles: int, **serve: Any) -> dict[str, Any]:
    """Return a shift in which each batter becomes a pancake, an object that is created."""
    across = range(griddles)
    stations = [{"name": "griddle", "x": x, "y": 3} for x in across]
    stations += [{"name": "table", "x": x, "y": 0} for x in across]
    stations += [{"name": "board", "x": 7, "y": 3}, {"name": "sink", "x": 7, "y": 0}]
    pancake = [term("item_on", "pancake", 1, "board", 2)]
    return {
        "version": "2.0",
        "domain": "diner",
        "width": 8,
        "height": 4,
        "config": {"bake_time": {"default": 1}},
        "objects": {
            "station": stations,
            "item": [{"name": "batter", "x": x, "y": 3} for x in across],
            "player": [{"name": "robot", "x": 2, "y": 1, "direction": [0, -1]}],
        },
        "shift": {
            "steps": 200,
            "menu": {"pancake": {"points": 10, "patience": 100, "goal": pancake}},
            "arrivals": [{"at": 0, "dish": "pancake"}] * griddles,
            "most_open": griddles,
            "serve": {"station": "board", "predicates": ["item_at"], "soils": [], **serve},
            "discard": "sink",
        },
    }


def world_of(problem: dict[str, Any], folder: Path) -> World:
    path = folder / "kitchen.json"
    path.write_text(json.dumps(problem))
    return World(load_task(str(path)))


def do(state: State, name: str, *about: str) -> State:
    """Take the first valid action with a name that is about some objects."""
    found = (a for a in state.actions(ME) if a.name == name and {*about} <= {*a.arguments})
    return state.step(next(found)).state


def go(state: State, station: str) -> State:
    walk = next((a for a in state.actions(ME) if a.destination == station), None)
    return state if walk is None else state.step(walk).state


def baked(world: World, griddles: int) -> State:
    """Return a state in which each griddle has a pancake."""
    state = world.initial
    for number in range(1, griddles + 1):
        state = go(state, f"griddle{number}")
        state = next(
            state.step(a).state for a in state.actions(ME) if a.destination is None
            and "pick" not in a.name and f"batter{number}" in a.arguments
        )  # fmt: skip
    for _ in range(6):
        state = state.step([]).state
    return state


@pytest.mark.parametrize("station", ["board1", "sink1"])
def test_each_created_thing_is_seen_where_it_is_put(station: str, tmp_path: Path) -> None:
    world = world_of(diner(3), tmp_path)
    state = baked(world, 3)
    for griddle in (3, 2, 1):
        here = go(state, f"griddle{griddle}")
        pancake = next(
            a.arguments[1] for a in here.actions(ME) if a.name == "pick-up-item"
            and f"griddle{griddle}" in a.arguments
        )  # fmt: skip
        state = do(go(do(here, "pick-up-item", pancake), station), "place-item", pancake)
        assert pancake not in {thing.name for thing in state.objects}
    assert state.orders is not None
    assert state.orders.served == (3 if station == "board1" else 0)


def test_things_that_ceased_to_exist_keep_no_facts(tmp_path: Path) -> None:
    """Facts that hold unless others do are not about a thing that is gone."""
    (tmp_path / "cafe.json").write_text(json.dumps({
        "name": "cafe",
        "version": "2.0",
        "extends": "diner",
        "predicate_defs": [{
            "name": "loose",
            "param_types": ["item"],
            "language_descriptors": {"0": "{0} is loose"},
        }],
        "layout": [{"predicate": "loose", "unless": ["atop"]}],
        "action_defs": [{
            "name": "glue",
            "language_description": "Glue {i1} at {s1} with {p1}",
            "precons": [
                {"predicate": "loc", "params": ["p1", "s1"]},
                {"predicate": "item_on", "params": ["i1", "s1"]},
            ],
            "immediate_fx": [{"predicate": "loose", "params": ["i1"], "is_true": False}],
            "sfx": [],
        }],
    }))  # fmt: skip
    world = world_of({**diner(3), "domain": "cafe"}, tmp_path)
    state = go(baked(world, 3), "griddle3")
    state = do(go(do(state, "pick-up-item"), "board1"), "place-item")
    assert state.orders is not None
    assert state.orders.served == 1
    writer = StateWriter(world)
    assert StateReader(World(world.task), writer.tables(state), writer.values(state)).state == state
    assert world.unpack(world.pack(state)) == state


def test_a_dish_depends_on_its_things_also_if_only_their_kind_counts(tmp_path: Path) -> None:
    problem = json.loads(json.dumps(BISTRO))
    problem["objects"]["item"] = [
        {"name": "plate", "x": 0, "y": 0, "predicates": ["isclean"]},
        {"name": "bread", "x": 2, "y": 0},
        {"name": "cheese", "x": 7, "y": 0},
        {"name": "onion", "x": 3, "y": 3},
    ]
    toast = [term("item_on", "plate", 1, "hatch", 2), term("isbread", "bread", 3)]
    dish = {"goal": toast, "points": 10, "tip": 0, "patience": 190}
    orders = [{"at": 0, "dish": "toast"}]
    problem["shift"] |= {"menu": {"toast": dish}, "arrivals": orders}
    world = world_of(problem, tmp_path)

    def served(thing: str) -> int:
        state = world.initial
        for each in ("plate1", thing):
            home = next(a[2] for a in state.atoms() if a[0] == "item_at" and a[1] == each)
            state = do(go(state, home), "pick-up-item", each)
            state = do(go(state, "hatch1"), "place-item" if each == "plate1" else "stack", each)
        assert state.orders is not None
        return state.orders.served

    # All games of a world share what it knows about dishes.
    assert [served(thing) for thing in ("cheese1", "bread1", "cheese1")] == [0, 1, 0]
