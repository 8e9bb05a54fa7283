"""The published generator's noisy layouts: stations move, and take along what is on and at them.

A group is a station, the items on it and the first player beside it. Containers of the problem are
lost, so that soups cannot be made, as is what is in no group; and the player ends beside the first
station, wherever its group is, while an item that it held stays behind.
"""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass

from robotouille_evaluation.packs.published.floor import Cell, Floor
from robotouille_evaluation.packs.published.placement import (
    Draft,
    Kitchen,
    PlacementError,
    Thing,
    draw_extras,
)

__all__ = ["MAX_SHUFFLES", "place_noisily"]

MAX_SHUFFLES = 100_000
"""Attempts to place the groups for one seed; the published generator goes on for ever."""


@dataclass(slots=True)
class _Group:
    station: Thing
    items: list[Thing]
    player: Thing | None
    held: Thing | None


def place_noisily(kitchen: Kitchen, rng: random.Random) -> Draft:
    """The problem's stations in groups, and extras between; PlacementError if there is no room."""
    extra_stations, extra_items = draw_extras(kitchen, rng)
    stations, items, players = (kitchen.own(name) for name in ("stations", "items", "players"))
    groups = [_group(station, items, players) for station in stations]
    # Whoever and whatever is in no group is lost, and the players are in the order of the groups.
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


def _items(groups: Iterable[_Group]) -> dict[Thing, None]:
    """The items of all groups, each once: those on the station, then the one that is held."""
    things: dict[Thing, None] = {}
    for group in groups:
        held = [] if group.held is None else [group.held]
        things.update(dict.fromkeys((*group.items, *held)))
    return things


def _group(station: Thing, items: list[Thing], players: list[Thing]) -> _Group:
    (x, y) = station.cell
    beside = {(x, y + 1), (x, y - 1), (x + 1, y), (x - 1, y)}
    player = next((p for p in players if p.cell in beside), None)
    held = None
    if player is not None:
        held = next((item for item in items if item.cell == player.cell), None)
    return _Group(station, [item for item in items if item.cell == station.cell], player, held)


def _place_groups(groups: list[_Group], first: Thing, floor: Floor, rng: random.Random) -> None:
    for _ in range(MAX_SHUFFLES):
        cells = floor.cells()
        rng.shuffle(cells)
        if _place_once(groups, cells, floor, rng):
            taken = [group.station.cell for group in groups]
            if floor.reaches(taken, first.cell):
                return
    raise PlacementError("No place for the groups found", hopeless=True)


def _place_once(groups: list[_Group], cells: list[Cell], floor: Floor, rng: random.Random) -> bool:
    """Place each group on the next of the shuffled cells; False where one does not fit."""
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
