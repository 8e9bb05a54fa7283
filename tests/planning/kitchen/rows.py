"""Kitchens in which everything is in a row."""

from __future__ import annotations

from typing import Any

from robotouille import World
from tests.world.kitchens import kitchen

__all__ = ["FACTS", "placed", "row", "term"]

Json = dict[str, Any]

FACTS = {
    "patty": ["iscookable"],
    "chicken": ["iscookable", "isfryable"],
    "lettuce": ["iscuttable"],
    "onion": ["iscuttable", "isfryableifcut"],
}


def row(
    stations: str, *goal: tuple[str, str], things: str = "", at: int = 0, **delays: int
) -> World:
    """A cook at one of the stations in a row; things are `kind@station`, piles from below.

    A goal is a predicate and `kind+number` for each argument.
    """
    kinds = stations.split()
    named = [thing.split("@") for thing in things.split()]
    items: list[Json] = []
    for kind, x in named:
        if kind not in ("pot", "bowl", "water"):
            level = sum(item["x"] == int(x) for item in items)
            items.append({"name": kind, "x": int(x), "y": 0, "stack-level": level,
                          "predicates": FACTS.get(kind, [])})  # fmt: skip
    return kitchen(
        width=len(kinds),
        stations=placed((kind, x) for x, kind in enumerate(kinds)),
        items=items,
        containers=placed((k, int(x)) for k, x in named if k in ("pot", "bowl")),
        meals=placed((k, int(x)) for k, x in named if k == "water"),
        players=[{"name": "robot", "x": at, "y": 1, "direction": [0, -1]}],
        config={name: {"default": steps} for name, steps in delays.items()},
        goal=[term(predicate, arguments) for predicate, arguments in goal],
    )


def placed(things: Any) -> list[Json]:
    return [{"name": kind, "x": x, "y": 0} for kind, x in things]


def term(predicate: str, arguments: str) -> Json:
    pairs = [argument.split("+") for argument in arguments.split()]
    return {
        "predicate": predicate,
        "args": [k for k, _ in pairs],
        "ids": [int(n) for _, n in pairs],
    }
