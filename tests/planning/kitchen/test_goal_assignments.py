"""Which choices of objects are searched."""

from __future__ import annotations

import pytest

from robotouille import World
from robotouille.planners.kitchen.encode import encode
from robotouille.planners.kitchen.goal_assignments import goal_assignments
from robotouille.planners.kitchen.model import model_of
from tests.world.kitchens import kitchen


def choices(world: World) -> int:
    """How many goal assignments are searched."""
    model = model_of(world, world.initial)
    assert model is not None
    goals = goal_assignments(model, encode(model, world.initial))
    assert goals is not None
    return len(goals)


CUT = [{"predicate": "iscut", "args": ["lettuce"], "ids": [1]}]


def lettuces(*places: int, cuttable: int = 9, level: int = 0) -> World:
    items = [
        {"name": "lettuce", "x": x, "y": 0, "stack-level": level * number,
         "predicates": ["iscuttable"] if number < cuttable else []}
        for number, x in enumerate(places)
    ]  # fmt: skip
    stations = [{"name": kind, "x": x, "y": 0} for x, kind in enumerate(KINDS)]
    return kitchen(stations=stations, items=items, goal=CUT)


KINDS = ["table", "table", "table", "table", "board"]


@pytest.mark.parametrize(
    ("world", "count"),
    [
        (lettuces(1, 2, 3), 1),
        (lettuces(0, 1, 2), 2),
        (lettuces(1, 2, 4), 2),
        (lettuces(1, 2, 3, cuttable=1), 2),
        (lettuces(1, 1, 1, level=1), 3),
    ],
    ids=["alike", "one is here", "one is on the board", "one is different", "a pile"],
)
def test_objects_that_are_alike_are_one_choice(world: World, count: int) -> None:
    assert choices(world) == count


def test_pieces_of_a_shipped_kitchen_that_are_alike() -> None:
    assert choices(World("synchronous/01")) == 1
