"""Growth of worlds in which play creates objects: bounded, for players and for strangers."""

from __future__ import annotations

from typing import Any

import pytest

from robotouille import World, load_task
from robotouille.domain.task import Task
from robotouille.errors import ProtocolError, TooManyObjectsError
from robotouille.protocol.states import StateReader
from robotouille.world.grounding.ground_objects import MAX_GROWTH


def related(arity: int) -> Task:
    """Return a kitchen of a kilobyte in which created objects relate to each other."""
    domain: dict[str, Any] = {
        "version": "2.0.0",
        "name": "related",
        "object_types": ["station", "item", "player"],
        "predicate_defs": [
            {"name": "near", "param_types": ["item"] * arity},
            {"name": "at", "param_types": ["player", "station"]},
        ],
        "action_defs": [
            {
                "name": "make",
                "language_description": "make at {b} by {a}",
                "precons": [{"predicate": "at", "params": ["a", "b"]}],
                "immediate_fx": [],
                "sfx": [
                    {
                        "type": "creation", "param": "b",
                        "created_obj": {"name": "x", "type": "item", "param": "i"},
                        "fx": [{"predicate": "near", "params": ["i"] * arity}],
                    }
                ],
            }
        ],
        "layout": [{"predicate": "at", "when": "faces"}],
        "kinds": {},
    }  # fmt: skip
    objects = {
        "station": [{"name": "table", "x": 1, "y": 2}],
        "player": [{"name": "robot", "x": 1, "y": 1, "direction": [0, 1]}],
    }
    problem = {"version": "2.0", "width": 3, "height": 3, "objects": objects, "goal": []}
    return Task.from_json(
        {"name": "related", "seats": 1, "timing": "benchmark", "domain": domain,
         "problem": problem}
    )  # fmt: skip


@pytest.mark.slow
def test_play_that_creates_without_end_stops_at_a_limit() -> None:
    world = World(related(2))
    (make,) = (a for a in world.actions(world.initial, "robot1") if a.name == "make")
    state, steps = world.initial, 0
    with pytest.raises(TooManyObjectsError, match=r"too many objects have been created \(x\)"):
        while True:
            state = world.step(state, make).state
            steps += 1
    assert 80 < steps < 120
    assert len(world.table.atoms) <= MAX_GROWTH + 100
    assert world.step(world.initial, make).state.objects, "other games go on"


@pytest.mark.parametrize("number", [30, 400])
def test_a_name_from_a_server_does_not_fill_the_memory(number: int) -> None:
    world = World(related(4))
    tables = {"predicates": [], "objects": [[f"x{number}", "x", "item"]], "atoms": []}
    with pytest.raises(ProtocolError, match="too many objects"):
        StateReader(world, tables, {"facts": [], "timers": [], "busy": {}})
    assert len(world.table.atoms) <= MAX_GROWTH + 100


def test_a_world_that_cannot_grow_further_still_plays() -> None:
    world = World(related(2))
    with pytest.raises(TooManyObjectsError):
        world.admit(["x400"])
    (make,) = (a for a in world.actions(world.initial, "robot1") if a.name == "make")
    made = world.step(world.initial, make).state
    assert [thing.name for thing in made.objects if thing.kind == "x"] == ["x1"]


@pytest.mark.slow
def test_shipped_kitchens_leave_room_for_long_games() -> None:
    for name in ("workshop/01", "workshop/02", "multi_agent/10", "shifts/06_rush_hour"):
        world = World(load_task(name))
        for _ in range(60):
            world.make_room_for_another()
        assert len(world.table.atoms) <= world.table_sizes[0] + MAX_GROWTH
