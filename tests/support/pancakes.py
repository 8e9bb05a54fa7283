"""A small domain in which an item takes the place of another: batter becomes a pancake."""

from __future__ import annotations

from typing import Any

from robotouille import World
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task, read_domain

__all__ = ["pancake_kitchen"]

PREDICATES = [
    ("isgriddle", "station", "{0} is a griddle"),
    ("isbatter", "item", "{0} is batter"),
    ("ispancake", "item", "{0} is a pancake"),
]

MAKE_PANCAKE = {
    "name": "make-pancake",
    "language_description": "Make a pancake of {i1} at {s1} with {p1}",
    "precons": [
        {"predicate": "isgriddle", "params": ["s1"]},
        {"predicate": "isbatter", "params": ["i1"]},
        {"predicate": "loc", "params": ["p1", "s1"]},
        {"predicate": "nothing", "params": ["p1"]},
        {"predicate": "item_on", "params": ["i1", "s1"]},
        {"predicate": "clear", "params": ["i1"]},
    ],
    "sfx": [
        {
            "type": "conditional",
            "param": "i1",
            "conditions": [{"predicate": "item_on", "params": ["i1", "s1"]}],
            "sfx": [
                {
                    "type": "delayed",
                    "param": "i1",
                    "config": "bake_time",
                    "default": 3,
                    "sfx": [
                        {
                            "type": "creation",
                            "param": "i1",
                            "created_obj": {"name": "pancake", "type": "item", "param": "i2"},
                            "fx": [
                                {"predicate": "ispancake", "params": ["i2"]},
                                {"predicate": "item_on", "params": ["i2", "s1"]},
                                {"predicate": "item_at", "params": ["i2", "s1"]},
                                {"predicate": "clear", "params": ["i2"]},
                            ],
                        },
                        {"type": "deletion", "param": "i1"},
                    ],
                }
            ],
        }
    ],
}


def pancake_kitchen(
    *, batter: int = 1, players: int = 1, goal: list[dict[str, Any]] | None = None
) -> World:
    """Batter on tables, a griddle, a free table for pancakes, and cheese that is of no use."""
    domain = read_domain("robotouille").model_dump(mode="json")
    domain["name"] = "pancakes"
    domain["predicate_defs"] += [
        {"name": name, "param_types": [kind], "language_descriptors": {"0": words}}
        for name, kind, words in PREDICATES
    ]
    domain["action_defs"].append(MAKE_PANCAKE)
    tables = [{"name": "table", "x": x, "y": 0} for x in range(batter + 1)]
    problem = {
        "version": "2.0",
        "domain": "pancakes",
        "width": batter + 4,
        "height": 3,
        "objects": {
            "station": [
                *tables,
                {"name": "griddle", "x": batter + 2, "y": 0},
                {"name": "table", "x": 0, "y": 2},
            ],
            "item": [
                *(
                    {"name": "batter", "x": x, "y": 0, "predicates": ["isbatter"]}
                    for x in range(batter)
                ),
                {"name": "cheese", "x": 0, "y": 2},
            ],
            "player": [
                {"name": "robot", "x": x, "y": 1, "direction": [0, -1]} for x in range(players)
            ],
        },
        "goal_description": "Serve pancakes.",
        "goal": goal
        or [
            {"predicate": "ispancake", "args": ["pancake"], "ids": [1]},
            {"predicate": "item_on", "args": ["pancake", "table"], "ids": [1, 2]},
        ],
    }
    task = build_task(
        "pancakes", DomainFile.model_validate(domain), ProblemFile.model_validate(problem)
    )
    return World(task)
