"""What the published generator works with: a problem as it loads it, its draws, its objects.

Source: a description of the published generator, draw by draw; no line of it is taken over.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from robotouille.errors import Fault, FileError
from robotouille_evaluation.packs.published.floor import Cell, Floor

__all__ = ["LISTS", "Draft", "Kitchen", "PlacementError", "Thing", "draw_extras", "load_kitchen"]

LISTS = ("stations", "items", "players", "containers", "meals")

STATION_KINDS = ("board", "stove", "table", "fryer", "sink")
ITEM_KINDS = (
    "bottombun",
    "lettuce",
    "patty",
    "topbun",
    "bread",
    "cheese",
    "tomato",
    "onion",
    "chicken",
    "potato",
)
ABILITIES = {
    "patty": "iscookable",
    "chicken": "iscookable",
    "lettuce": "iscuttable",
    "onion": "iscuttable",
    "tomato": "iscuttable",
}

S = TypeVar("S")


class PlacementError(Exception):
    """An attempt that comes to nothing: the generator goes on with the next seed. The words are
    those that it prints. With `hopeless`, no other seed will do better."""

    def __init__(self, why: str, *, hopeless: bool = False) -> None:
        super().__init__(why)
        self.hopeless = hopeless


@dataclass(slots=True, eq=False)
class Thing:
    """An object that is placed: its cell and level, and all other fields as the problem has them.

    `own` ones are the problem's; the others are extras, which give way.
    """

    fields: dict[str, Any]
    cell: Cell
    own: bool
    level: int | None = None
    direction: Cell | None = None

    def json(self) -> dict[str, Any]:
        """The object as a problem file has it."""
        raw = {**self.fields, "x": self.cell[0], "y": self.cell[1]}
        if self.level is not None:
            raw["stack-level"] = self.level
        if self.direction is not None:
            raw["direction"] = list(self.direction)
        return raw


@dataclass(slots=True)
class Kitchen:
    """A problem as it is loaded: the lists that it has, each in the order of columns and rows."""

    raw: dict[str, Any]
    floor: Floor
    lists: dict[str, list[dict[str, Any]]]

    def own(self, name: str) -> list[Thing]:
        """The problem's own objects of a list, anew."""
        return [
            Thing(
                fields,
                (fields["x"], fields["y"]),
                own=True,
                level=fields.get("stack-level"),
                direction=tuple(fields["direction"]) if fields.get("direction") else None,
            )
            for fields in self.lists.get(name, [])
        ]


@dataclass(slots=True)
class Draft:
    """An instance in the making: what has a place already, each list in the order of the file."""

    floor: Floor
    stations: list[Thing] = field(default_factory=list)
    items: list[Thing] = field(default_factory=list)
    containers: list[Thing] = field(default_factory=list)
    player: Thing | None = None

    def station_cells(self) -> list[Cell]:
        """The cells of the stations, in their order."""
        return [station.cell for station in self.stations]

    def station_at(self, cell: Cell) -> Thing | None:
        """The station on a cell."""
        return at(self.stations, cell)

    def spots(self) -> list[Cell]:
        """Where an item or container can be: on the stations, then in the player's hand."""
        hand = [] if self.player is None else [self.player.cell]
        return [*self.station_cells(), *hand]

    def item_at(self, cell: Cell) -> Thing | None:
        """The first item on a cell."""
        return at(self.items, cell)

    def container_at(self, cell: Cell) -> Thing | None:
        """The first container on a cell."""
        return at(self.containers, cell)

    def add_extra_station(self, station: Thing, start: Cell) -> None:
        """Place an extra if its cell is free, and all stations are reached from `start` then."""
        taken = self.station_cells()
        if station.cell not in taken and self.floor.reaches([*taken, station.cell], start):
            self.stations.append(station)

    def place_player(self, player: Thing) -> None:
        """Put the player beside the first station it can stand at and reach all others from.

        Raises:
            PlacementError: There is no such cell.
        """
        taken = self.station_cells()
        for station in taken:
            for cell in self.floor.neighbours(station):
                if cell not in taken and self.floor.reaches(taken, cell):
                    player.cell = cell
                    player.direction = (station[0] - cell[0], station[1] - cell[1])
                    self.player = player
                    return
        raise PlacementError("No place for the player found")

    def problem(self, raw: dict[str, Any]) -> dict[str, Any]:
        """The problem with these objects in place of its own."""
        players = [] if self.player is None else [self.player.json()]
        return {
            **raw,
            "stations": [thing.json() for thing in self.stations],
            "items": [thing.json() for thing in self.items],
            "containers": [thing.json() for thing in self.containers],
            "players": players,
        }


def at(things: Iterable[Thing], cell: Cell) -> Thing | None:
    """The first of some things that is on a cell."""
    return next((thing for thing in things if thing.cell == cell), None)


def load_kitchen(raw: dict[str, Any], source: str = "problem") -> Kitchen:
    """A problem file's JSON value as the generator loads it.

    Raises:
        FileError: It has no grid, no station or no player, or an object without a place.
    """
    faults = list(_faults(raw))
    if faults:
        raise FileError(source, faults)
    lists = {
        name: sorted(raw[name], key=lambda thing: (thing["x"], thing["y"]))
        for name in LISTS
        if name in raw
    }
    return Kitchen({**raw, **lists}, Floor(raw["width"], raw["height"]), lists)


def _faults(raw: dict[str, Any]) -> Iterator[Fault]:
    for name in ("width", "height"):
        if not isinstance(raw.get(name), int) or not 1 <= raw[name] <= 100:
            yield Fault(name, f"expected a number from 1 to 100, found {raw.get(name)!r}")
    for name in ("stations", "players"):
        if not raw.get(name):
            yield Fault(name, f"a problem without {name} has no layouts")
    for name in LISTS:
        things = raw.get(name, [])
        if not isinstance(things, list):
            yield Fault(name, "expected a list of objects")
            continue
        for i, thing in enumerate(things):
            where = thing if isinstance(thing, dict) else {}
            if not all(isinstance(where.get(key), int) for key in ("x", "y")):
                yield Fault(f"{name}[{i}]", "expected an object with x and y")


def draw_extras(kitchen: Kitchen, rng: random.Random) -> tuple[list[Thing], list[Thing]]:
    """The stations and items that nobody needs, each on a cell that may turn out to be taken."""
    floor = kitchen.floor
    count = rng.randrange(0, floor.width * floor.height)
    cells = [(rng.randrange(0, floor.width), rng.randrange(0, floor.height)) for _ in range(count)]
    stations = [
        Thing({"name": kind}, cell, own=False)
        for cell, kind in zip(cells, _draw(rng, STATION_KINDS, count), strict=True)
    ]
    count = rng.randrange(0, count + 1)
    # Two picks: column and row may be those of two stations.
    cells = [(rng.choice(stations).cell[0], rng.choice(stations).cell[1]) for _ in range(count)]
    items = [
        Thing(_item_fields(kind), cell, own=False, level=0)
        for cell, kind in zip(cells, _draw(rng, ITEM_KINDS, count), strict=True)
    ]
    return stations, items


def _draw(rng: random.Random, kinds: Sequence[S], count: int) -> list[S]:
    return [rng.choice(kinds) for _ in range(count)]


def _item_fields(kind: str) -> dict[str, Any]:
    fields: dict[str, Any] = {"name": kind}
    if kind in ABILITIES:
        fields["predicates"] = [ABILITIES[kind]]
    return fields
