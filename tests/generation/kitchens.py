"""Tasks for the generator, and a solver without work."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from robotouille import Task, World, load_task
from robotouille.generation import Generator, Kind, Parameters
from robotouille.planning.plan import Plan, Proof, SearchResult, read_plan

TASKS = [
    "synchronous/01_cheese_sandwich",
    "asynchronous/07_onion_soup",
    "asynchronous/10_onion_potato_soup_and_lettuce_fried_onion_burger_and_onion_chicken_sandwich",
    "multi_agent/01_lettuce_burger",
    "multi_agent/10_potato_tomato_chicken_soup_and_potato_cheese_onion_soup",
    "workshop/02_two_workers",
]


@cache
def generator(name: str, kind: Kind, parameters: Parameters) -> Generator:
    return Generator(load_task(name), kind, parameters)


def seats_of(task: Task) -> tuple[int, ...]:
    return task.problem.seats or (task.seats,)


def shipped_plan(task: Task) -> Plan:
    """Return the plan next to a shipped problem."""
    source = Path(task.source)
    names = (f"{source.stem}@{task.seats}.plan", f"{source.stem}.plan")
    path = next(p for p in map(source.with_name, names) if p.exists())
    return read_plan(path.read_text(), World(task))


class Oracle:
    """Solver that returns a plan of a fixed length and counts its calls."""

    def __init__(self, refuse: int = 0) -> None:
        self.refuse = refuse
        self.asked = 0

    def __call__(self, world: World) -> SearchResult:
        self.asked += 1
        return SearchResult(None, 0, Proof.NONE, "none", 0, unsolvable=self.asked <= self.refuse)


# A task with everything in it that may be on tiles: a stack, a held thing, a vessel with a filling,
# a delay for one object by its name, and a goal about one object by its id.
CROWDED: dict[str, Any] = {
    "version": "2.0",
    "width": 5,
    "height": 4,
    "ground": ["ABCDE", "ABCDE", "ABCDE", "ABCDE"],
    "config": {"cook_time": {"default": 2, "patty2": 7}, "boil_time": {"water1": 9}},
    "seats": [1, 2],
    "stations": [
        {"name": "table", "x": 0, "y": 0},
        {"name": "table", "x": 4, "y": 0},
        {"name": "stove", "x": 2, "y": 3},
        {"name": "sink", "x": 4, "y": 3},
    ],
    "items": [
        {"name": "patty", "x": 0, "y": 0, "stack-level": 1, "predicates": ["iscookable"]},
        {"name": "bread", "x": 0, "y": 0, "id": "mine"},
        {"name": "patty", "x": 3, "y": 0, "predicates": ["iscookable"]},
    ],
    "containers": [{"name": "pot", "x": 2, "y": 3}, {"name": "pot", "x": 4, "y": 3}],
    "meals": [{"name": "water", "x": 2, "y": 3}],
    "players": [
        {"name": "robot", "x": 3, "y": 0, "direction": [1, 0]},
        {"name": "robot", "x": 0, "y": 1, "direction": [0, -1]},
    ],
    "goal_description": "Cook a patty and put it on the bread.",
    "goal": [
        {"predicate": "iscooked", "args": ["patty"], "ids": [1]},
        {"predicate": "atop", "args": ["patty", "bread"], "ids": [1, "mine"]},
    ],
}


def crowded(folder: Path, **changes: Any) -> Task:
    path = folder / "crowded.json"
    path.write_text(json.dumps({**CROWDED, **changes}))
    return load_task(str(path))
