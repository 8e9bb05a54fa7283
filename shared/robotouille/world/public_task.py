"""The task that players with limited sight receive: it does not show where things are at the start.

Its world has the same objects, atoms and actions as the real one, in another order, and the same
facts that never change. So it can read all states of the real world. Its initial state is made up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from robotouille.domain.schema import ProblemFile
from robotouille.domain.task import Task
from robotouille.world.grounding.objects import Object, Tile
from robotouille.world.sight import ranks
from robotouille.world.world import World

DIRECTION = (0, -1)
"""Direction of all players in a public task."""


def public_task(world: World) -> Task:
    """Return a world's task with places and conditions that do not depend on the real ones.

    Stations keep their places. All other things lie on the first stations, one for each type, and
    players stand together, but on their own part of a divided floor. The origin of a generated
    problem and points that were computed for it are left out.
    """
    task = world.task
    raw = task.problem.model_dump(mode="json", by_alias=True, exclude_unset=True)
    raw["objects"] = {kind: [] for kind in raw.get("objects", ())}
    rank = ranks(world)
    # Objects at one place are numbered in the order in which the problem lists them.
    for thing, tile in sorted(_public_places(world), key=lambda row: rank[row[0].name]):
        raw["objects"][thing.type].append(_definition(world, thing, tile))
    raw["seats"] = [task.seats]
    raw.pop("provenance", None)
    for computed in ("stars", "planner"):
        raw.get("shift", {}).pop(computed, None)
    return replace(task, problem=ProblemFile.model_validate(raw))


def _public_places(world: World) -> Iterator[tuple[Object, Tile]]:
    """Yield the objects in their order, each with its place in the public task.

    The places of each type ascend, because objects are numbered by place.
    """
    domain, problem = world.task.domain, world.task.problem
    fixed = _fixed_types(world)
    surfaces = sorted(world.floor.blocked) or [(0, 0)]
    movable = [t for t in domain.object_types if t not in fixed and t not in domain.player_types]
    grid = [(x, y) for x in range(problem.width) for y in range(problem.height)]
    last: Tile = (0, 0)
    for thing in world.placed:
        if thing.tile is None or thing.type in fixed:
            yield thing, thing.tile or (0, 0)
        elif thing.type in movable:
            yield thing, surfaces[movable.index(thing.type) % len(surfaces)]
        else:
            last = next(t for t in _standing_places(world, thing.tile, grid) if t >= last)
            yield thing, last


def _fixed_types(world: World) -> set[str]:
    """Return the types of objects whose places everybody knows: stations, and what never moves."""
    domain, table = world.task.domain, world.table
    never = {
        rule.predicate
        for rule in domain.layout or ()
        if rule.when not in (None, "reaches") and rule.predicate in table.static_predicates
    }
    related = {atom[0] for atom in table.static} & never
    return {*domain.station_types, *(kind for name in related for kind in table.types[name])}


def _standing_places(world: World, start: Tile, grid: list[Tile]) -> list[Tile]:
    """Return the tiles from which a player reaches the same stations as from its start."""
    if not world.floor.is_free(start):
        return [start]
    return world.floor.connected(start, [tile for tile in grid if world.floor.is_free(tile)])


def _definition(world: World, thing: Object, tile: Tile) -> dict[str, Any]:
    """Return an object of the public task as JSON values."""
    row: dict[str, Any] = {"name": thing.kind, "x": tile[0], "y": tile[1]}
    if known := [name for name in thing.predicates if name in world.table.static_predicates]:
        row["predicates"] = known
    if thing.label is not None:
        row["id"] = thing.label
    if thing.level and thing.type in _fixed_types(world):
        row["stack-level"] = thing.level
    if thing.facing is not None:
        row["direction"] = DIRECTION
    return row
