"""The published generator's layouts of a problem: the same file for the same seed.

`generate_layout(problem, 84)` draws stations and items that nobody needs, then new cells for
everything, and gives the problem with these. An attempt that comes to nothing is made again with
the next seed. Its order of draws is kept to the letter; so are its surprises: one player at most
stays, stacks are dissolved, an item may begin in the player's hand.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from robotouille.errors import Fault, FileError
from robotouille_evaluation.packs.published.floor import Cell
from robotouille_evaluation.packs.published.noisy_layouts import place_noisily
from robotouille_evaluation.packs.published.placement import (
    Draft,
    Kitchen,
    PlacementError,
    Thing,
    draw_extras,
    load_kitchen,
)

__all__ = ["MAX_RETRIES", "Layout", "generate_layout"]

MAX_RETRIES = 1000
"""Seeds after the one asked for; the published generator has no limit, and no file needs 20."""

DIRECTIONS = ((0, 1), (1, 0), (0, -1), (-1, 0))


@dataclass(frozen=True, slots=True)
class Layout:
    """What the generator makes of a problem for a seed.

    `errors` are those of the attempts before `seed_used`, one for each seed. `random` is the state
    in which the generator leaves Python's random numbers: the published evaluation goes on drawing
    from it (the order of examples, what a stochastic run undoes). `rng()` gives a fresh copy.
    """

    problem: dict[str, Any]
    seed: int
    seed_used: int
    errors: tuple[str, ...]
    random_state: tuple[Any, ...]

    def rng(self) -> random.Random:
        """Random numbers that go on where the generator stopped."""
        rng = random.Random()
        rng.setstate(self.random_state)
        return rng


def generate_layout(
    raw: dict[str, Any], seed: int, *, noisy: bool = False, source: str = "problem"
) -> Layout:
    """The layout of a problem, a JSON value as its file has it, for a seed.

    Args:
        noisy: Move the problem's stations in groups, with what is on them and who is beside.
        source: What errors call the problem.

    Raises:
        FileError: It is no problem that has layouts, or no seed gives one.
    """
    kitchen = load_kitchen(raw, source)
    place: Callable[[Kitchen, random.Random], Draft] = place_noisily if noisy else place_freely
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
            return Layout(problem, seed, used, tuple(errors), rng.getstate())
    why = f"no layout for the seeds {seed} to {used}: {errors[-1]}"
    raise FileError(source, [Fault("", why)])


def place_freely(kitchen: Kitchen, rng: random.Random) -> Draft:
    """Everything anywhere; PlacementError if this seed gives nothing."""
    floor = kitchen.floor
    extra_stations, extra_items = draw_extras(kitchen, rng)
    stations, items, containers, players = (
        kitchen.own(name) for name in ("stations", "items", "containers", "players")
    )
    for thing in (*stations, *items, *containers):
        thing.cell = (rng.randrange(0, floor.width), rng.randrange(0, floor.height))
    for player in players:
        player.cell = (rng.randrange(0, floor.width), rng.randrange(0, floor.height))
        rng.choice(DIRECTIONS)
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


def _place_station(draft: Draft, station: Thing, rng: random.Random) -> None:
    """Place one of the problem's stations: on its cell, or in an extra's stead."""
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


def _place_item(draft: Draft, item: Thing) -> None:
    """Place an item: on its cell, or, if it is the problem's own, wherever there is room."""
    spots = draft.spots()
    there = draft.item_at(item.cell)
    if item.cell in spots and there is None:
        draft.items.append(item)
    elif item.own:
        if item.cell in spots and there is not None and not there.own:
            _replace(draft.items, there, item, there.cell)
        else:
            _force_item(draft, item, spots)


def _force_item(draft: Draft, item: Thing, spots: list[Cell]) -> None:
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


def _place_container(draft: Draft, container: Thing) -> None:
    """Place a container: on its cell, or wherever there is room; an extra item gives way."""
    spots = draft.spots()
    cell, there = container.cell, draft.item_at(container.cell)
    if cell in spots and there is None and draft.container_at(cell) is None:
        draft.containers.append(container)
        return
    if cell in spots and there is not None and not there.own:
        # The published code fails at a key there, and its error's text is the key.
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


def _replace(things: list[Thing], old: Thing, new: Thing, cell: Cell) -> None:
    """Put one thing in the place of another, on the grid and in the list."""
    new.cell = cell
    things[things.index(old)] = new
