"""Placement of objects on stations and of all stations and players on tiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from robotouille.domain.schema import ObjectDef
from robotouille.generation.decomposition import (
    Key,
    PlacedObject,
    ProblemParts,
    Roles,
    StackItem,
    Stock,
    Tile,
)
from robotouille.generation.parameters import (
    MAX_OBJECTS,
    MAX_SIDE,
    Amounts,
    AttemptError,
    GenerationError,
    Kind,
    Parameters,
    SeededRng,
)

HOLDS = 1 / 2
"""Probability that a player holds something if that is allowed."""


@dataclass(slots=True)
class Arrangement:
    """All objects, the original ones first, with their carriers and each player's station."""

    things: list[PlacedObject]
    carrier: dict[Key, tuple[Key, int]] = field(default_factory=dict)
    faces: dict[Key, Key] = field(default_factory=dict)

    def put(self, piece: StackItem, host: Key, level: int = 0) -> None:
        """Put an object and its contents on a station or into a player's hands."""
        self.carrier[piece.thing.key] = (host, level)
        for filling in piece.fillings:
            self.carrier[filling.key] = (host, filling.definition.stack_level)


def arrange(
    parts: ProblemParts, stock: Stock, kind: Kind, parameters: Parameters, rng: SeededRng
) -> Arrangement:
    """Return one random arrangement of a kitchen.

    Raises:
        AttemptError: The objects do not fit.
    """
    amounts = Amounts.of(parameters, kind, rng)
    if amounts.items and not stock.has_items:
        raise AttemptError("items", "the domain has no kind of item that stands on a station")
    total = len(parts.things) + amounts.stations + amounts.items
    if total > MAX_OBJECTS:
        name = "stations" if amounts.stations > amounts.items else "items"
        raise GenerationError(name, f"{total} objects in total; at most {MAX_OBJECTS} are allowed")
    added = _Added(parts)
    stations = [added.make(*stock.station(rng)) for _ in range(amounts.stations)]
    pieces = [StackItem(added.make(*stock.item(rng))) for _ in range(amounts.items)]
    things = [*parts.things, *stations, *(piece.thing for piece in pieces)]
    arrangement = Arrangement(things)
    stacks = parameters.stacks(kind)
    if kind is Kind.NOISY:
        _keep(parts, arrangement)
        shelves = _Shelves(stations, parts.roles, stacks, arrangement)
        shelves.fill(pieces, rng)
        return arrangement
    everywhere = [*parts.stations, *stations]
    for player, station in zip(parts.players, rng.shuffled(everywhere), strict=False):
        arrangement.faces[player.key] = station.key
    loose = rng.shuffled([*parts.pieces(), *pieces])
    if parameters.held:
        loose = _hand_out(parts, arrangement, loose, rng)
    _Shelves(everywhere, parts.roles, stacks, arrangement).fill(loose, rng)
    return arrangement


def _keep(parts: ProblemParts, arrangement: Arrangement) -> None:
    """Leave every object with its station or player."""
    for thing in parts.movables:
        arrangement.put(StackItem(thing), parts.carrier[thing.key], thing.definition.stack_level)
    arrangement.faces.update(parts.faces)


def _hand_out(
    parts: ProblemParts, arrangement: Arrangement, pieces: list[StackItem], rng: SeededRng
) -> list[StackItem]:
    """Give objects to some players and return the others."""
    left = list(pieces)
    for player in parts.players:
        holdable = [piece for piece in left if piece.thing.type in parts.roles.holdable]
        if holdable and rng.happens(HOLDS):
            left.remove(holdable[0])
            arrangement.put(holdable[0], player.key)
    return left


class _Added:
    """Factory of additional objects, which are numbered after the original ones."""

    def __init__(self, parts: ProblemParts) -> None:
        self._counts = {t: parts.count(t) for t in parts.task.domain.object_types}

    def make(self, type_: str, definition: ObjectDef) -> PlacedObject:
        number = self._counts[type_]
        self._counts[type_] += 1
        return PlacedObject(type_, number, definition)


class _Shelves:
    """Stations for objects: one object each, or a stack of one type."""

    def __init__(
        self, stations: list[PlacedObject], roles: Roles, stacks: bool, arrangement: Arrangement
    ) -> None:
        self._stackable = roles.stackable if stacks else ()
        self._arrangement = arrangement
        self._stacks: dict[Key, list[StackItem]] = {station.key: [] for station in stations}

    def fill(self, pieces: list[StackItem], rng: SeededRng) -> None:
        """Put every object on a station."""
        # Objects that need a station of their own come first; stacks can grow later.
        for piece in sorted(pieces, key=lambda p: p.thing.type in self._stackable):
            fitting = [key for key, stack in self._stacks.items() if self._fits(piece, stack)]
            if not fitting:
                alone = sum(p.thing.type not in self._stackable for p in pieces)
                message = (
                    f"{len(pieces)} objects ({alone} need a station of their own) "
                    f"do not fit on {len(self._stacks)} stations"
                )
                raise AttemptError("items", message)
            key = rng.one_of(fitting)
            self._arrangement.put(piece, key, len(self._stacks[key]))
            self._stacks[key].append(piece)

    def _fits(self, piece: StackItem, stack: list[StackItem]) -> bool:
        type_ = piece.thing.type
        return not stack or (type_ in self._stackable and stack[0].thing.type == type_)


ROOM = 2.5
"""Default number of tiles per station, including the floor."""

_NEIGHBOURS = ((0, -1), (0, 1), (-1, 0), (1, 0))


@dataclass(frozen=True, slots=True)
class Floorplan:
    """The tile of each station and player, and each player's direction."""

    width: int
    height: int
    tiles: dict[Key, Tile]
    directions: dict[Key, Tile]


def size_for(stations: int, width: int, height: int, parameters: Parameters) -> tuple[int, int]:
    """Return the requested size, else the original's size, enlarged until there is room."""
    size = [parameters.width or max(3, width), parameters.height or max(3, height)]
    open_sides = [i for i, side in enumerate((parameters.width, parameters.height)) if side is None]
    while open_sides and size[0] * size[1] < ROOM * stations:
        side = min(open_sides, key=lambda i: size[i])
        if size[side] == MAX_SIDE:
            raise GenerationError("stations", f"{stations} do not fit on any grid")
        size[side] += 1
    return size[0], size[1]


def lay_out(
    stations: Sequence[Key], faces: dict[Key, Key], width: int, height: int, rng: SeededRng
) -> Floorplan:
    """Return tiles for stations and for the players who face them.

    Raises:
        AttemptError: The stations or players do not fit.
    """
    grid = [(x, y) for x in range(width) for y in range(height)]
    floor = _Floor(grid)
    placed: dict[Key, Tile] = {}
    candidates = iter(rng.shuffled(grid))
    for station in stations:
        tile = next((t for t in candidates if floor.block(t)), None)
        if tile is None:
            message = (
                f"{len(placed)} of {len(stations)} stations fit on a grid of {width} by {height}"
            )
            raise AttemptError("size", message)
        placed[station] = tile
    standing: dict[Key, Tile] = {}
    directions: dict[Key, Tile] = {}
    for player, station in faces.items():
        x, y = placed[station]
        beside = [t for t in floor.around((x, y)) if t not in standing.values()]
        if not beside:
            raise AttemptError("size", "a player has no free tile next to its station")
        standing[player] = here = rng.one_of(beside)
        directions[player] = (x - here[0], y - here[1])
    return Floorplan(width, height, {**placed, **standing}, directions)


class _Floor:
    """Connected free tiles, with at least one next to each station."""

    def __init__(self, grid: list[Tile]) -> None:
        self._free = dict.fromkeys(grid, True)

    def around(self, tile: Tile) -> list[Tile]:
        """Return the free tiles next to a tile."""
        x, y = tile
        near = [(x + dx, y + dy) for dx, dy in _NEIGHBOURS]
        return [t for t in near if self._free.get(t, False)]

    def block(self, tile: Tile) -> bool:
        """Put a station on a tile unless that would divide the floor or enclose a station."""
        around = self.around(tile)
        self._free[tile] = False
        if around and not self._shuts_in(tile) and self._connected(around[0]):
            return True
        self._free[tile] = True
        return False

    def _shuts_in(self, tile: Tile) -> bool:
        x, y = tile
        near = [(x + dx, y + dy) for dx, dy in _NEIGHBOURS]
        return any(self._free.get(t) is False and not self.around(t) for t in near)

    def _connected(self, start: Tile) -> bool:
        found = {start}
        pending = [start]
        while pending:
            for tile in self.around(pending.pop()):
                if tile not in found:
                    found.add(tile)
                    pending.append(tile)
        return len(found) == sum(self._free.values())
