"""What is a kitchen, and what is not: that is left to the general planner."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from robotouille import Task, World, load_task, task_names
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task, read_domain
from robotouille.planners.kitchen.recognition import recognise
from robotouille.planners.kitchen.solver import kitchen_search
from robotouille.planning.search_result import Limits
from robotouille.planning.solvers import solve
from robotouille.resources import data_folder

Json = dict[str, Any]


ALONE = [
    name
    for name in task_names()
    if name.startswith(("synchronous/", "asynchronous/", "training/"))
    and load_task(name).seats == 1
]


def changed(name: str, **fields: Any) -> Task:
    """A shipped task with other fields of its problem."""
    task = load_task(name)
    raw = json.loads(Path(task.source).read_text())
    return build_task("changed", task.domain, ProblemFile.model_validate({**raw, **fields}))


def is_left_to_others(task: Task) -> bool:
    world = World(task)
    return kitchen_search(world, world.initial) is None


def test_pots_that_fill_at_different_speeds() -> None:
    pots = [
        {"name": "pot", "x": 0, "y": 2},
        {"name": "pot", "x": 4, "y": 1},
        {"name": "bowl", "x": 0, "y": 1},
    ]
    goal = [{"predicate": "in", "args": ["water", "bowl"], "ids": [1, 2]}]
    slow = {"fill_time": {"default": 1, "pot2": 25}}
    task = changed("asynchronous/06", containers=pots, goal=goal, config=slow)
    assert is_left_to_others(task)
    assert solve(World(task)).bound == 9


@pytest.mark.parametrize(
    "extra",
    [
        {"predicate": "item_on", "args": ["bread", "table"], "ids": [1, 9]},
        {"predicate": "atop", "args": ["bread", "cheese"], "ids": [1, 3]},
        {"predicate": "item_at", "args": ["cheese", "table"], "ids": [3, 9]},
    ],
)
def test_goals_that_contradict_themselves(extra: Json) -> None:
    goal = [
        {"predicate": "item_on", "args": ["bread", "table"], "ids": [1, 2]},
        {"predicate": "item_at", "args": ["cheese", "table"], "ids": [3, 2]},
        extra,
    ]
    assert is_left_to_others(changed("synchronous/01", goal=goal))


def test_more_work_than_there_is_room_for_is_not_called_unsolvable() -> None:
    whole = {"name": "lettuce", "stack-level": 0, "predicates": ["iscuttable"]}
    places = ((0, 1), (0, 2), (1, 4), (3, 4))
    lettuces = [{**whole, "x": x, "y": y} for x, y in places]
    goal = [{"predicate": "iscut", "args": ["lettuce"], "ids": [i]} for i in range(4)]
    slow = {"num_cuts": {"default": 60}}
    task = changed("synchronous/02", items=lettuces, goal=goal, config=slow)
    answer = solve(World(task), limits=Limits(expansions=200))
    assert not answer.unsolvable
    assert answer.bound >= 240


@pytest.mark.parametrize("needs", ["iscut", "iscooked"])
def test_domains_in_which_one_process_needs_the_result_of_another(needs: str) -> None:
    raw = json.loads((data_folder("domains") / "robotouille.json").read_text())
    fry = next(a for a in raw["action_defs"] if a["name"] == "fry")
    for condition in fry["precons"]:
        if condition["predicate"] == "isfryable":
            condition["predicate"] = needs
    assert recognise(load_task("synchronous/01").domain) is not None
    assert recognise(DomainFile.model_validate(raw)) is None


@pytest.mark.parametrize("name", ALONE)
def test_shipped_kitchens_are_recognised(name: str) -> None:
    world = World(load_task(name))
    assert recognise(world.task.domain) is not None
    assert kitchen_search(world, world.initial) is not None


def test_there_are_shipped_kitchens_for_one() -> None:
    assert len(ALONE) >= 20


def test_a_workshop_is_no_kitchen() -> None:
    assert recognise(read_domain("workshop")) is None
    world = World("workshop/01")
    assert kitchen_search(world, world.initial) is None


def test_people_walk_step_by_step() -> None:
    world = World(load_task("synchronous/01", timing="people"))
    assert kitchen_search(world, world.initial) is None
