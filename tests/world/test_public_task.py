"""The task that players with limited sight receive."""

from __future__ import annotations

import json

import pytest

from robotouille import World
from robotouille.domain.task import Task
from robotouille.world.public_task import public_task
from tests.support.samples import quick_sample

TASKS = quick_sample(
    [
        "shifts/06",
        "multi_agent/07@3",
        "examples/pancakes",
        "workshop/02",
        "shifts/04",
        "training/03",
    ],
    4,
)


@pytest.mark.parametrize("name", TASKS)
def test_its_world_has_all_objects_and_facts_that_never_change(name: str) -> None:
    world = World(name)
    public = World(Task.from_json(json.loads(json.dumps(public_task(world).json))))
    assert public.players == world.players and public.thing_names == world.thing_names
    assert public.table.static == world.table.static
    assert set(public.table.atoms) == set(world.table.atoms)
    stations = list(world.floor.stations)
    assert public.floor.stations == world.floor.stations
    for here in stations:
        distances = [public.floor.distance(here, there) for there in stations]
        assert distances == [world.floor.distance(here, there) for there in stations]


@pytest.mark.parametrize("name", TASKS)
def test_the_public_task_of_a_public_task_is_equal(name: str) -> None:
    public = public_task(World(name))
    assert public_task(World(public)).json == public.json
    assert "provenance" not in public.json["problem"]
