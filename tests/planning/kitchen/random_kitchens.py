"""Tiny random kitchens, one for each seed."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import Any

from robotouille import Task
from robotouille.domain.schema import ProblemFile
from robotouille.domain.task import build_task, read_domain

__all__ = ["DISHES", "random_kitchen"]

Json = dict[str, Any]

PIECES: dict[str, list[list[str]]] = {
    "cheese": [[]],
    "lettuce": [["iscut"], []],
    "patty": [["iscooked"], []],
    "chicken": [["iscooked"], ["isfried"], ["iscooked", "isfried"]],
    "potato": [["iscut"], ["iscut", "isfried"], ["isfried"]],
    "onion": [["iscut"], ["iscut", "isfried"], []],
}
"""Possible goals for an item."""

FACTS = {
    "lettuce": ["iscuttable"],
    "tomato": ["iscuttable"],
    "patty": ["iscookable"],
    "chicken": ["iscookable", "isfryable"],
    "potato": ["iscuttable", "isfryableifcut"],
    "onion": ["iscuttable", "isfryableifcut"],
}
STATION_FOR = {"iscut": "board", "iscooked": "stove", "isfried": "fryer"}
JUNK = ["bread", "lettuce", "cheese", "patty", "topbun"]
DELAYS = {
    "cook_time": [0, 1, 2, 3],
    "fry_time": [0, 1, 2],
    "fill_time": [0, 1, 2],
    "boil_time": [0, 1, 2, 3],
    "num_cuts": [1, 2],
}


@dataclass
class _Draft:
    """A kitchen being built: its objects and its goal."""

    rng: random.Random
    stations: list[str] = field(default_factory=list)
    items: list[str] = field(default_factory=list)
    containers: list[str] = field(default_factory=list)
    goal: list[Json] = field(default_factory=list)
    delays: dict[str, int] = field(default_factory=dict)
    ids: count[int] = field(default_factory=lambda: count(1))

    def chance(self, probability: float) -> bool:
        return self.rng.random() < probability

    def want(self, predicate: str, *variables: tuple[str, int]) -> None:
        """Add a term of the goal over variables of a kind and a number."""
        kinds, ids = zip(*variables, strict=True)
        self.goal.append({"predicate": predicate, "args": kinds, "ids": ids})

    def station(self, kind: str, another: float = 0.15) -> None:
        if kind not in self.stations or self.chance(another):
            self.stations.append(kind)

    def item(self, kind: str) -> tuple[str, int]:
        """Return a new item of the goal."""
        self.items.append(kind)
        return kind, next(self.ids)

    def piece(self, kind: str) -> tuple[str, int]:
        """Return a new item that the goal may require to be cut, cooked or fried."""
        piece = self.item(kind)
        for result in self.rng.choice(PIECES[kind]):
            self.want(result, piece)
            self.station(STATION_FOR[result])
        if "potato" in piece or "onion" in piece:
            self.station("board", 0)
        return piece

    def pieces(self, counts: Sequence[int]) -> list[tuple[str, int]]:
        kinds = sorted(PIECES)
        return [self.piece(self.rng.choice(kinds)) for _ in range(self.rng.choice(counts))]


def _bread(draft: _Draft) -> tuple[tuple[str, int], str]:
    """Put a base on a plain table and return the kind of its top."""
    kind, top = draft.rng.choice([("bread", "bread"), ("bottombun", "topbun")])
    return draft.item(kind), top


def _sandwich(draft: _Draft, table: int | None = None) -> None:
    """Add items on a base in any order, perhaps with a clear top."""
    base, kind = _bread(draft)
    plate = ("table", next(draft.ids) if table is None else table)
    draft.want("item_on", base, plate)
    for piece in draft.pieces([0, 1, 1, 2]):
        draft.want("item_at", piece, plate)
    if draft.chance(0.6):
        top = draft.item(kind)
        draft.want("item_at", top, plate)
        draft.want("clear", top)


def _stack(draft: _Draft) -> None:
    """Add items in a fixed order."""
    below, kind = _bread(draft)
    if draft.chance(0.9):
        draft.want("item_on", below, ("table", next(draft.ids)))
    for piece in draft.pieces([0, 1, 1, 2]):
        draft.want("atop", piece, below)
        below = piece
    if len(draft.goal) < 2 or draft.chance(0.6):
        top = draft.item(kind)
        draft.want("atop", top, below)
        draft.want("clear", top)


def _loose_pieces(draft: _Draft) -> None:
    """Add items without a place."""
    for piece in draft.pieces([1, 1, 2, 3]):
        if not draft.goal or draft.chance(0.2):
            draft.want("clear", piece)


def _side_dish(draft: _Draft) -> None:
    """Add a sandwich and an item without a place."""
    _sandwich(draft)
    draft.want("iscut", draft.item("lettuce"))
    draft.station("board", 0.1)


def _two_plates(draft: _Draft) -> None:
    """Add two piles on two tables."""
    for _ in range(2):
        base = draft.item(draft.rng.choice(["bread", "bottombun"]))
        plate = ("table", next(draft.ids))
        draft.want("item_on", base, plate)
        for piece in draft.pieces([0, 1]):
            draft.want("item_at", piece, plate)


def _soup(draft: _Draft) -> None:
    """Add water that is perhaps boiled, with ingredients, and served in a bowl."""
    draft.station("sink", 0.1)
    draft.station("stove", 0.1)
    draft.containers += ["pot", "bowl"]
    water, bowl = ("water", next(draft.ids)), ("bowl", next(draft.ids))
    served = draft.chance(0.8)
    if served:
        draft.want("in", water, bowl)
    if not served or draft.chance(0.8):
        draft.want("isboiling", water)
    for _ in range(draft.rng.choice([0, 1, 1, 2])):
        piece = draft.item(draft.rng.choice(["onion", "potato", "tomato"]))
        draft.want("addedto", piece, water)
        if draft.chance(0.3):
            draft.want("iscut", piece)
            draft.station("board", 0)
    if served and draft.chance(0.8):
        draft.want("container_at", bowl, ("table", next(draft.ids)))


def _soup_with_more_vessels(draft: _Draft) -> None:
    _soup(draft)
    draft.containers.append(draft.rng.choice(["pot", "bowl"]))


def _two_soups(draft: _Draft) -> None:
    """Add two meals, one pot, and a bowl for each served meal."""
    draft.stations += ["sink", "stove"]
    draft.containers.append("pot")
    for _ in range(2):
        water, bowl = ("water", next(draft.ids)), ("bowl", next(draft.ids))
        draft.containers.append("bowl")
        draft.want("in", water, bowl)
        if draft.chance(0.5):
            draft.want("isboiling", water)


def _meals_in_turn(draft: _Draft) -> None:
    """Add meals that take turns in one pot, and delays that are worth an interruption."""
    draft.stations += ["sink", "stove"]
    draft.station(draft.rng.choice(["sink", "stove", "stove"]), 0.4)
    draft.containers.append("pot")
    for _ in range(draft.rng.choice([1, 2, 2])):
        water = ("water", next(draft.ids))
        if draft.chance(0.8):
            draft.containers.append("bowl")
            draft.want("in", water, ("bowl", next(draft.ids)))
        draft.want("isboiling", water)
        if draft.chance(0.1):
            draft.want("addedto", draft.item("onion"), water)
    draft.delays["boil_time"] = draft.rng.choice([1, 2, 3, 4, 6])


def _patties_in_turn(draft: _Draft) -> None:
    """Add items that take turns on stoves, with delays that are worth an interruption."""
    draft.stations += ["stove"] * draft.rng.choice([1, 2])
    for _ in range(draft.rng.choice([1, 2])):
        draft.want("iscooked", draft.item("patty"))
    if draft.chance(0.4):
        _bread(draft)
    draft.delays["cook_time"] = draft.rng.choice([2, 4, 6])


def _soup_and_sandwich(draft: _Draft) -> None:
    _soup(draft)
    base, _ = _bread(draft)
    plate = ("table", next(draft.ids))
    draft.want("item_on", base, plate)
    if draft.chance(0.5):
        draft.want("item_at", draft.piece("patty"), plate)


DISHES: dict[str, Callable[[_Draft], None]] = {
    "sandwich": _sandwich,
    "stack": _stack,
    "loose pieces": _loose_pieces,
    "side dish": _side_dish,
    "two plates": _two_plates,
    "soup": _soup,
    "soup with more vessels": _soup_with_more_vessels,
    "two soups": _two_soups,
    "soup and sandwich": _soup_and_sandwich,
    "meals in turn": _meals_in_turn,
    "patties in turn": _patties_in_turn,
}
# The dishes without a weight have many states, so tests ask for them.
WEIGHTS = [5, 4, 3, 2, 2, 4, 2, 1, 1, 0, 0]


def random_kitchen(seed: int, players: int = 1, dish: str | None = None) -> Task:
    """Return the tiny kitchen of a seed. `dish` is a key of `DISHES`."""
    rng = random.Random(seed)
    while True:
        draft = _Draft(rng)
        draft.stations += ["table"] * rng.randint(1, 4)
        DISHES[dish or rng.choices(list(DISHES), WEIGHTS)[0]](draft)
        _clutter(draft)
        problem = _laid_out(draft, players)
        if problem is not None:
            name = f"random kitchen {seed}"
            return build_task(name, read_domain("robotouille"), ProblemFile.model_validate(problem))


def _clutter(draft: _Draft) -> None:
    """Add unneeded objects and stations."""
    if draft.chance(0.4):
        kind = draft.rng.choice(JUNK)
        draft.items += [kind] * draft.rng.choice([1, 1, 2])
    if draft.chance(0.15):
        draft.stations.append(draft.rng.choice(["table", "board", "stove", "sink", "fryer"]))
    draft.rng.shuffle(draft.stations)
    draft.rng.shuffle(draft.items)


def _laid_out(draft: _Draft, players: int) -> Json | None:
    """Return the problem file with stations in a line, or None without room."""
    rng, stations = draft.rng, draft.stations
    free = list(range(len(stations)))
    rng.shuffle(free)
    if len(draft.containers) > len(free) or players > len(stations):
        return None
    containers = [_thing(kind, free.pop()) for kind in draft.containers]
    places = rng.sample(range(len(stations)), players)
    held = draft.items.pop() if draft.items and draft.chance(0.15) else None
    items = _in_piles(draft, free)
    if items is None:
        return None
    if held is not None:
        items.append(_piece(draft, held, places[0]) | {"y": 1})
    meals = [_thing("water", containers[0]["x"])] if containers and draft.chance(0.15) else []
    delays = {name: rng.choice(values) for name, values in DELAYS.items()} | draft.delays
    return {
        "version": "2.0",
        "width": len(stations),
        "height": 3,
        "config": {name: {"default": steps} for name, steps in delays.items()},
        "stations": [_thing(kind, x) for x, kind in enumerate(stations)],
        "items": items,
        "containers": containers,
        "meals": meals,
        "players": [{"name": "robot", "x": x, "y": 1, "direction": [0, -1]} for x in places],
        "goal_description": "",
        "goal": draft.goal,
    }


def _in_piles(draft: _Draft, free: list[int]) -> list[Json] | None:
    """Return every item on a station or a pile, or None without a station."""
    heights = dict.fromkeys(free, 0)
    items = []
    for kind in draft.items:
        empty = [x for x, height in heights.items() if height == 0]
        choices = empty if empty and draft.chance(0.6) else list(heights)
        if not choices:
            return None
        x = draft.rng.choice(choices)
        items.append(_piece(draft, kind, x) | {"stack-level": heights[x]})
        heights[x] += 1
    return items


def _piece(draft: _Draft, kind: str, x: int) -> Json:
    """Return an item with its possible processes, sometimes already cooked or cut."""
    facts = list(FACTS.get(kind, []))
    if "iscookable" in facts and draft.chance(0.1):
        facts.append("iscooked")
    if "iscuttable" in facts and draft.chance(0.1):
        facts += ["iscut", "isfryable"] if "isfryableifcut" in facts else ["iscut"]
    return _thing(kind, x) | {"predicates": facts}


def _thing(kind: str, x: int) -> Json:
    return {"name": kind, "x": x, "y": 0}
