"""Distances between stations, by flooding the floor.

One stands south of a station if one can, else north, west or east of it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

from robotouille import Task
from robotouille.world.grounding.objects import Object

__all__ = ["distance"]


def distance(
    task: Task, players: list[str], placed: Sequence[Object], here: str, there: str
) -> int:
    """Return the steps over free tiles between the tiles in front of two stations."""
    stations = {o.tile for o in placed if o.type in task.domain.station_types}
    where = {o.name: o.tile for o in placed}
    problem = task.problem

    def free_neighbours(tile: Any) -> list[tuple[int, int]]:
        x, y = tile
        around = [(x, y - 1), (x, y + 1), (x - 1, y), (x + 1, y)]
        on_grid = [(a, b) for a, b in around if a in range(problem.width)]
        return [t for t in on_grid if t[1] in range(problem.height) and t not in stations]

    def walk_from(start: Any) -> dict[tuple[int, int], int]:
        far = {start: 0}
        queue = deque([start])
        while queue:
            tile = queue.popleft()
            for neighbour in free_neighbours(tile):
                if neighbour not in far:
                    far[neighbour] = far[tile] + 1
                    queue.append(neighbour)
        return far

    reachable = {tile for player in players for tile in walk_from(where[player])}
    standing = [
        next(t for t in free_neighbours(where[name]) if t in reachable) for name in (here, there)
    ]
    return walk_from(standing[0])[standing[1]]
