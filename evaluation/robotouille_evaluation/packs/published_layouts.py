"""Layouts of the published generator: the same file for the same seed.

`generate_layout(problem, 84)` draws extra stations and items that the goal does not need, then new
cells for everything. A failed attempt is repeated with the next seed. The order of draws is exactly
the published one, and so are its oddities: at most one player stays, stacks are dissolved, and an
item may start in the player's hand.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from robotouille.errors import Fault, FileError
from robotouille_evaluation.packs.published_placement import (
    Cell,
    Draft,
    PlacedObject,
    PlacementError,
    PlacementGrid,
    SourceProblem,
    draw_extras,
    load_kitchen,
)

MAX_SHUFFLES = 100_000
"""Attempts to place the groups for one seed. The published generator has no limit."""


@dataclass(slots=True)
class _Group:
    station: PlacedObject
    items: list[PlacedObject]
    player: PlacedObject | None
    held: PlacedObject | None


def place_noisily(kitchen: SourceProblem, rng: random.Random) -> Draft:
    """Place the problem's stations in groups, with extras between them, or raise PlacementError."""
    extra_stations, extra_items = draw_extras(kitchen, rng)
    stations, items, players = (kitchen.own(name) for name in ("stations", "items", "players"))
    groups = [_group(station, items, players) for station in stations]
    # As in the published code, objects and players without a group are lost, and groups order the
    # players.
    standing = list(dict.fromkeys(group.player for group in groups if group.player is not None))
    if not standing:
        raise PlacementError("No player stands beside a station", hopeless=True)
    _place_groups(groups, standing[0], kitchen.floor, rng)
    draft = Draft(kitchen.floor, stations, list(_items(groups)))
    frozen = {player.cell for player in standing}
    for station in extra_stations:
        if station.cell not in frozen:
            draft.add_extra_station(station, standing[0].cell)
    draft.place_player(standing[0])
    for item in extra_items:
        there = draft.station_at(item.cell)
        if there is not None and not there.own and draft.item_at(item.cell) is None:
            draft.items.append(item)
    return draft


def _items(groups: Iterable[_Group]) -> dict[PlacedObject, None]:
    """Return the items of all groups, each once: those on the station, then the held one."""
    things: dict[PlacedObject, None] = {}
    for group in groups:
        held = [] if group.held is None else [group.held]
        things.update(dict.fromkeys((*group.items, *held)))
    return things


def _group(station: PlacedObject, items: list[PlacedObject], players: list[PlacedObject]) -> _Group:
    (x, y) = station.cell
    beside = {(x, y + 1), (x, y - 1), (x + 1, y), (x - 1, y)}
    player = next((p for p in players if p.cell in beside), None)
    held = None
    if player is not None:
        held = next((item for item in items if item.cell == player.cell), None)
    return _Group(station, [item for item in items if item.cell == station.cell], player, held)


def _place_groups(
    groups: list[_Group], first: PlacedObject, floor: PlacementGrid, rng: random.Random
) -> None:
    for _ in range(MAX_SHUFFLES):
        cells = floor.cells()
        rng.shuffle(cells)
        if _place_once(groups, cells, floor, rng):
            taken = [group.station.cell for group in groups]
            if floor.reaches(taken, first.cell):
                return
    raise PlacementError("No place for the groups found", hopeless=True)


def _place_once(
    groups: list[_Group], cells: list[Cell], floor: PlacementGrid, rng: random.Random
) -> bool:
    """Place each group on the next of the shuffled cells; return False if one does not fit."""
    stations: set[Cell] = set()
    players: dict[int, Cell] = {}
    for group in groups:
        cell = cells.pop()
        taken = {*stations, *players.values()}
        if cell in taken:
            return False
        free = [near for near in floor.neighbours(cell) if near not in taken]
        if group.player is not None and not free:
            return False
        stations.add(cell)
        _move(group, cell)
        if group.player is not None:
            stand = rng.choice(free)
            group.player.cell = players[id(group.player)] = stand
            group.player.direction = (cell[0] - stand[0], cell[1] - stand[1])
            if group.held is not None:
                group.held.cell = stand
    return True


def _move(group: _Group, cell: Cell) -> None:
    group.station.cell = cell
    for item in group.items:
        item.cell = cell


MAX_RETRIES = 1000
"""Seeds tried after the given one. The published generator has no limit; no file needs 20."""

DIRECTIONS = ((0, 1), (1, 0), (0, -1), (-1, 0))


@dataclass(frozen=True, slots=True)
class ObjectLayout:
    """Layout of a problem for a seed.

    `errors` has one error for each seed before `seed_used`. `random_state` is the state in which
    the generator leaves Python's random numbers. The published evaluation goes on drawing from it:
    the order of examples, and the reversals of stochastic runs.
    """

    problem: dict[str, Any]
    seed: int
    seed_used: int
    errors: tuple[str, ...]
    random_state: tuple[Any, ...]

    def rng(self) -> random.Random:
        """Return random numbers that continue where the generator stopped."""
        rng = random.Random()
        rng.setstate(self.random_state)
        return rng


def generate_layout(
    raw: dict[str, Any], seed: int, *, noisy: bool = False, source: str = "problem"
) -> ObjectLayout:
    """Return the layout of a problem, given as the JSON value of its file, for a seed.

    Args:
        noisy: Move stations in groups with their items and the players next to them.
        source: Name of the problem in errors.

    Raises:
        FileError: The problem cannot have layouts, or no seed gives one.
    """
    kitchen = load_kitchen(raw, source)
    place: Callable[[SourceProblem, random.Random], Draft] = (
        place_noisily if noisy else place_freely
    )
    errors: list[str] = []
    for used in range(seed, seed + MAX_RETRIES + 1):
        rng = random.Random(used)
        try:
            problem = place(kitchen, rng).problem(kitchen.raw)
        except PlacementError as error:
            errors.append(str(error))
            if error.hopeless:
                break
        else:
            return ObjectLayout(problem, seed, used, tuple(errors), rng.getstate())
    why = f"no layout for the seeds {seed} to {used}: {errors[-1]}"
    raise FileError(source, [Fault("", why)])


def place_freely(kitchen: SourceProblem, rng: random.Random) -> Draft:
    """Place everything on random cells, or raise PlacementError if this seed fails."""
    floor = kitchen.floor
    extra_stations, extra_items = draw_extras(kitchen, rng)
    stations, items, containers, players = (
        kitchen.own(name) for name in ("stations", "items", "containers", "players")
    )
    for thing in (*stations, *items, *containers):
        thing.cell = (rng.randrange(0, floor.width), rng.randrange(0, floor.height))
    for player in players:
        player.cell = (rng.randrange(0, floor.width), rng.randrange(0, floor.height))
        # This draw only keeps the sequence of draws: `place_player` sets the direction.
        rng.choice(DIRECTIONS)
    # The order of these draws is part of the result; see the module docstring.
    draft = Draft(floor)
    for station in extra_stations:
        draft.add_extra_station(station, players[0].cell)
    for station in stations:
        _place_station(draft, station, rng)
    draft.place_player(players[0])
    for item in (*extra_items, *items):
        _place_item(draft, item)
    for item in draft.items:
        item.level = 0
    for container in containers:
        _place_container(draft, container)
    return draft


def _place_station(draft: Draft, station: PlacedObject, rng: random.Random) -> None:
    """Place one of the problem's stations on its cell, or in place of an extra one."""
    there = draft.station_at(station.cell)
    if there is None:
        if draft.floor.reachable([*draft.station_cells(), station.cell]):
            draft.stations.append(station)
            return
    elif not there.own:
        _replace(draft.stations, there, station, there.cell)
        return
    extras = [other for other in draft.stations if not other.own]
    if not extras:
        raise PlacementError("No replaceable stations found")
    extra = rng.choice(extras)
    _replace(draft.stations, extra, station, extra.cell)


def _place_item(draft: Draft, item: PlacedObject) -> None:
    """Place an item on its cell or, if it is one of the problem's, wherever there is room."""
    spots = draft.spots()
    there = draft.item_at(item.cell)
    if item.cell in spots and there is None:
        draft.items.append(item)
    elif item.own:
        if item.cell in spots and there is not None and not there.own:
            _replace(draft.items, there, item, there.cell)
        else:
            _force_item(draft, item, spots)


def _force_item(draft: Draft, item: PlacedObject, spots: list[Cell]) -> None:
    for spot in spots:
        there = draft.item_at(spot)
        if there is None:
            item.cell = spot
            draft.items.append(item)
            return
        if not there.own:
            _replace(draft.items, there, item, spot)
            return
    raise PlacementError("Item force add failed")


def _place_container(draft: Draft, container: PlacedObject) -> None:
    """Place a container on its cell or wherever there is room, replacing an extra item."""
    spots = draft.spots()
    cell, there = container.cell, draft.item_at(container.cell)
    if cell in spots and there is None and draft.container_at(cell) is None:
        draft.containers.append(container)
        return
    if cell in spots and there is not None and not there.own:
        # The published code fails with a KeyError here, whose text is the key.
        raise PlacementError("0")
    for spot in spots:
        there = draft.item_at(spot)
        if draft.container_at(spot) is None and (there is None or not there.own):
            if there is not None:
                draft.items.remove(there)
            container.cell = spot
            draft.containers.append(container)
            return
    raise PlacementError("Container force add failed")


def _replace(things: list[PlacedObject], old: PlacedObject, new: PlacedObject, cell: Cell) -> None:
    """Replace one object by another, on the grid and in the list."""
    new.cell = cell
    things[things.index(old)] = new
