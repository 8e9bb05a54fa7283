"""Small domain in which one object replaces another: batter becomes a pancake."""

from __future__ import annotations

from typing import Any

from robotouille import World
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task, read_domain
from tests.support.broken_files import condition

__all__ = ["pancake_kitchen"]

CREATED = [
    condition("ispancake", "i2"),
    condition("item_on", "i2", "s1"),
    condition("item_at", "i2", "s1"),
    condition("clear", "i2"),
]
BAKED = [
    {
        "type": "creation", "param": "i1", "fx": CREATED,
        "created_obj": {"name": "pancake", "type": "item", "param": "i2"},
    },
    {"type": "deletion", "param": "i1"},
]  # fmt: skip
BAKE = {"type": "delayed", "param": "i1", "config": "bake_time", "default": 3, "sfx": BAKED}
ON_GRIDDLE = condition("item_on", "i1", "s1")
MAKE_PANCAKE = {
    "name": "make-pancake",
    "language_description": "Make a pancake of {i1} at {s1} with {p1}",
    "precons": [
        condition("isgriddle", "s1"),
        condition("isbatter", "i1"),
        condition("loc", "p1", "s1"),
        condition("nothing", "p1"),
        ON_GRIDDLE,
        condition("clear", "i1"),
    ],
    "sfx": [{"type": "conditional", "param": "i1", "conditions": [ON_GRIDDLE], "sfx": [BAKE]}],
}
SERVED = [
    {"predicate": "ispancake", "args": ["pancake"], "ids": [1]},
    {"predicate": "item_on", "args": ["pancake", "table"], "ids": [1, 2]},
]


def at(name: str, x: int, y: int = 0, **more: Any) -> dict[str, Any]:
    return {"name": name, "x": x, "y": y, **more}


def pancake_kitchen(
    *, batter: int = 1, players: int = 1, goal: list[dict[str, Any]] | None = None
) -> World:
    """Return a kitchen with batter on tables, a griddle, a free table, and useless cheese."""
    domain = read_domain("robotouille").model_dump(mode="json")
    domain["name"] = "pancakes"
    for name, kind in (("isgriddle", "station"), ("isbatter", "item"), ("ispancake", "item")):
        words = {"0": "{0} is " + name.removeprefix("is")}
        domain["predicate_defs"].append(
            {"name": name, "param_types": [kind], "language_descriptors": words}
        )
    domain["action_defs"].append(MAKE_PANCAKE)
    tables = [at("table", x) for x in range(batter + 1)]
    mixed = [at("batter", x, predicates=["isbatter"]) for x in range(batter)]
    problem = {
        "version": "2.0",
        "domain": "pancakes",
        "width": batter + 4,
        "height": 3,
        "objects": {
            "station": [*tables, at("griddle", batter + 2), at("table", 0, 2)],
            "item": [*mixed, at("cheese", 0, 2)],
            "player": [at("robot", x, 1, direction=[0, -1]) for x in range(players)],
        },
        "goal_description": "Serve pancakes.",
        "goal": goal or SERVED,
    }
    files = DomainFile.model_validate(domain), ProblemFile.model_validate(problem)
    return World(build_task("pancakes", *files))
