"""Problems, objects and draws of the published generator.

This code was written from a description of the generator's draws. It copies none of its lines.
"""

from __future__ import annotations

import random
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from robotouille.errors import Fault, FileError

Cell = tuple[int, int]


@dataclass(frozen=True, slots=True)
class PlacementGrid:
    """Grid of cells. Players can stand on every cell without a station."""

    width: int
    height: int

    def cells(self) -> list[Cell]:
        """Return all cells, column by column."""
        return [(x, y) for x in range(self.width) for y in range(self.height)]

    def neighbours(self, cell: Cell) -> Iterator[Cell]:
        """Yield the cells above, below, right and left of a cell, in this order."""
        x, y = cell
        for near in ((x, y + 1), (x, y - 1), (x + 1, y), (x - 1, y)):
            if 0 <= near[0] < self.width and 0 <= near[1] < self.height:
                yield near

    def reaches(self, stations: Collection[Cell], start: Cell) -> bool:
        """Return whether a player who starts at `start` can stand next to every station.

        A start on a station counts as next to that station only.
        """
        wanted = set(stations)
        if start in wanted:
            return wanted == {start}
        return self._touched(wanted, start)[0] >= wanted

    def reachable(self, stations: Collection[Cell]) -> bool:
        """Return whether a player can stand next to every station from some cell."""
        wanted = set(stations)
        # Each connected region is flooded once.
        unseen = set(self.cells()) - wanted
        while unseen:
            touched, flooded = self._touched(wanted, min(unseen))
            if touched >= wanted:
                return True
            unseen -= flooded
        return False

    def _touched(self, stations: set[Cell], start: Cell) -> tuple[set[Cell], set[Cell]]:
        """Return the stations next to the region of `start`, and the region."""
        flooded, touched, pending = {start}, set(), [start]
        while pending:
            for near in self.neighbours(pending.pop()):
                if near in stations:
                    touched.add(near)
                elif near not in flooded:
                    flooded.add(near)
                    pending.append(near)
        return touched, flooded


MAX_SIDE = 20
"""Cells of a side. Published grids have at most ten; the time of the draws grows with the cube."""
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
    """Failed attempt, after which the generator tries the next seed.

    The text is the one that the published generator prints. If `hopeless`, no seed can succeed.
    """

    def __init__(self, why: str, *, hopeless: bool = False) -> None:
        super().__init__(why)
        self.hopeless = hopeless


@dataclass(slots=True, eq=False)
class PlacedObject:
    """Object with its cell and level, and all other fields of the problem file.

    `own` objects belong to the problem. The others are extras that can be replaced.
    """

    fields: dict[str, Any]
    cell: Cell
    own: bool
    level: int | None = None
    direction: Cell | None = None

    def json(self) -> dict[str, Any]:
        """Return the object as in a problem file."""
        raw = {**self.fields, "x": self.cell[0], "y": self.cell[1]}
        if self.level is not None:
            raw["stack-level"] = self.level
        if self.direction is not None:
            raw["direction"] = list(self.direction)
        return raw


@dataclass(slots=True)
class SourceProblem:
    """Problem as the generator loads it, with its lists sorted by column and row."""

    raw: dict[str, Any]
    floor: PlacementGrid
    lists: dict[str, list[dict[str, Any]]]

    def own(self, name: str) -> list[PlacedObject]:
        """Return new copies of the problem's objects in a list."""
        return [
            PlacedObject(
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
    """Unfinished instance: the objects placed so far, in the order of the file."""

    floor: PlacementGrid
    stations: list[PlacedObject] = field(default_factory=list)
    items: list[PlacedObject] = field(default_factory=list)
    containers: list[PlacedObject] = field(default_factory=list)
    player: PlacedObject | None = None

    def station_cells(self) -> list[Cell]:
        """Return the cells of the stations, in order."""
        return [station.cell for station in self.stations]

    def station_at(self, cell: Cell) -> PlacedObject | None:
        """Return the station on a cell."""
        return at(self.stations, cell)

    def spots(self) -> list[Cell]:
        """Return the cells for items and containers: the stations, then the player's hand."""
        hand = [] if self.player is None else [self.player.cell]
        return [*self.station_cells(), *hand]

    def item_at(self, cell: Cell) -> PlacedObject | None:
        """Return the first item on a cell."""
        return at(self.items, cell)

    def container_at(self, cell: Cell) -> PlacedObject | None:
        """Return the first container on a cell."""
        return at(self.containers, cell)

    def add_extra_station(self, station: PlacedObject, start: Cell) -> None:
        """Place an extra if its cell is free and all stations stay reachable from `start`."""
        taken = self.station_cells()
        if station.cell not in taken and self.floor.reaches([*taken, station.cell], start):
            self.stations.append(station)

    def place_player(self, player: PlacedObject) -> None:
        """Put the player next to the first station from which all others are reachable.

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
        """Return the problem with its objects replaced by these."""
        players = [] if self.player is None else [self.player.json()]
        return {
            **raw,
            "stations": [thing.json() for thing in self.stations],
            "items": [thing.json() for thing in self.items],
            "containers": [thing.json() for thing in self.containers],
            "players": players,
        }


def at(things: Iterable[PlacedObject], cell: Cell) -> PlacedObject | None:
    """Return the first object on a cell."""
    return next((thing for thing in things if thing.cell == cell), None)


def load_kitchen(raw: dict[str, Any], source: str = "problem") -> SourceProblem:
    """Return a problem file's JSON value as the generator loads it.

    Raises:
        FileError: The grid, all stations or all players are missing, or an object has no place.
    """
    faults = list(_faults(raw))
    if faults:
        raise FileError(source, faults)
    lists = {
        name: sorted(raw[name], key=lambda thing: (thing["x"], thing["y"]))
        for name in LISTS
        if name in raw
    }
    return SourceProblem({**raw, **lists}, PlacementGrid(raw["width"], raw["height"]), lists)


def _faults(raw: dict[str, Any]) -> Iterator[Fault]:
    for name in ("width", "height"):
        if not isinstance(raw.get(name), int) or not 1 <= raw[name] <= MAX_SIDE:
            yield Fault(name, f"expected a number from 1 to {MAX_SIDE}, found {raw.get(name)!r}")
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


def draw_extras(
    kitchen: SourceProblem, rng: random.Random
) -> tuple[list[PlacedObject], list[PlacedObject]]:
    """Draw extra stations and items, each on a cell that may turn out to be taken."""
    floor = kitchen.floor
    count = rng.randrange(0, floor.width * floor.height)
    cells = [(rng.randrange(0, floor.width), rng.randrange(0, floor.height)) for _ in range(count)]
    stations = [
        PlacedObject({"name": kind}, cell, own=False)
        for cell, kind in zip(cells, _draw(rng, STATION_KINDS, count), strict=True)
    ]
    count = rng.randrange(0, count + 1)
    # As published, column and row are drawn from two stations that may differ.
    cells = [(rng.choice(stations).cell[0], rng.choice(stations).cell[1]) for _ in range(count)]
    items = [
        PlacedObject(_item_fields(kind), cell, own=False, level=0)
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
