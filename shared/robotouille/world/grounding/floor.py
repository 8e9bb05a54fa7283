"""The floor of a kitchen: walkable tiles, the tiles from which stations are used, distances."""

from __future__ import annotations

from collections import Counter, deque
from functools import cached_property

from robotouille.world.grounding.objects import Object

Tile = tuple[int, int]

# South comes first: there, a player who faces the station turns its back to the viewer.
_NEIGHBOURS = ((0, -1), (0, 1), (-1, 0), (1, 0))


class Floor:
    """Tiles of a grid without a station, and walks over them.

    Attributes:
        stations: The tile of each station.
        plain: The stations of the most frequent kind, usually tables, at which players only put
            things down.
    """

    def __init__(self, width: int, height: int, objects: tuple[Object, ...], stations: set[str]):
        self.width = width
        self.height = height
        self.stations = {o.name: o.tile for o in objects if o.type in stations and o.tile}
        self.plain = _plain([o for o in objects if o.type in stations])
        self.blocked = frozenset(self.stations.values())
        # Only players have a direction; their tiles are where walks begin.
        self._starts = tuple(o.tile for o in objects if o.facing is not None and o.tile)
        self._walks: dict[Tile, dict[Tile, Tile]] = {}

    def is_free(self, tile: Tile) -> bool:
        """Return whether a tile is on the grid and has no station."""
        x, y = tile
        return 0 <= x < self.width and 0 <= y < self.height and tile not in self.blocked

    @cached_property
    def reachable(self) -> frozenset[Tile]:
        """The free tiles that some player can reach from its start."""
        found: set[Tile] = set()
        for start in self._starts:
            if start not in found:
                found.update(self._walk_from(start))
        return frozenset(found)

    def beside(self, station: str) -> list[Tile]:
        """Return the reachable free tiles next to a station, the preferred one first."""
        x, y = self.stations[station]
        around = [(x + dx, y + dy) for dx, dy in _NEIGHBOURS]
        return [tile for tile in around if self.is_free(tile) and tile in self.reachable]

    def standing(self, station: str) -> Tile:
        """Return the tile from which a station is used, or its own tile if it is enclosed."""
        beside = self.beside(station)
        return beside[0] if beside else self.stations[station]

    def path(self, start: Tile, goal: Tile) -> list[Tile]:
        """Return a shortest walk with both ends; only the ends if none exists."""
        came_from = self._walk_from(goal)
        if start not in came_from:
            return [start, goal]
        path = [start]
        while path[-1] != goal:
            path.append(came_from[path[-1]])
        return path

    def distance(self, here: str, there: str) -> int:
        """Return the length of the walk between the tiles from which two stations are used."""
        return len(self.path(self.standing(here), self.standing(there))) - 1

    def _walk_from(self, goal: Tile) -> dict[Tile, Tile]:
        """Return the next tile on the way to `goal` for each tile from which it can be reached."""
        known = self._walks.get(goal)
        if known is None:
            known = {goal: goal}
            queue = deque([goal])
            while queue:
                x, y = tile = queue.popleft()
                for dx, dy in _NEIGHBOURS:
                    neighbour = (x + dx, y + dy)
                    if neighbour not in known and self.is_free(neighbour):
                        known[neighbour] = tile
                        queue.append(neighbour)
            # Searching backward from the goal answers all walks to it with one search.
            self._walks[goal] = known
        return known


def _plain(stations: list[Object]) -> frozenset[str]:
    kinds = Counter(each.kind for each in stations).most_common(1)
    return frozenset(each.name for each in stations if each.kind == kinds[0][0])
