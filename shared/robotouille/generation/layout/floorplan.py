"""Tiles for stations and players, so that everybody can get to every station.

The free tiles are all connected, each station has a free tile beside it, and each player stands on
a free tile of its own beside its station. This is more than the world asks for (see
`world/grounding/floor.py`): a kitchen without corners that nobody can get to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from robotouille.generation.layout.decomposition import Key, Tile
from robotouille.generation.parameters import MAX_SIDE, AttemptError, GenerationError, Parameters
from robotouille.generation.rng import SeededRng

__all__ = ["Floorplan", "lay_out", "size_for"]

ROOM = 2.5
"""The tiles of a grid that a station takes, the floor to walk on included, unless told otherwise.
"""

_NEIGHBOURS = ((0, -1), (0, 1), (-1, 0), (1, 0))


@dataclass(frozen=True, slots=True)
class Floorplan:
    """The tile of each station and player, and the direction in which each player looks."""

    width: int
    height: int
    tiles: dict[Key, Tile]
    directions: dict[Key, Tile]


def size_for(stations: int, width: int, height: int, parameters: Parameters) -> tuple[int, int]:
    """The size that was asked for; else the original's, or the next in which there is room."""
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
    """Tiles for stations and for players that face some of them; AttemptError if none are found."""
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
            raise AttemptError("size", "a player has no tile of its own beside its station")
        standing[player] = here = rng.one_of(beside)
        directions[player] = (x - here[0], y - here[1])
    return Floorplan(width, height, {**placed, **standing}, directions)


class _Floor:
    """Free tiles, all connected, with one beside each station."""

    def __init__(self, grid: list[Tile]) -> None:
        self._free = dict.fromkeys(grid, True)

    def around(self, tile: Tile) -> list[Tile]:
        """The free tiles next to a tile."""
        x, y = tile
        near = [(x + dx, y + dy) for dx, dy in _NEIGHBOURS]
        return [t for t in near if self._free.get(t, False)]

    def block(self, tile: Tile) -> bool:
        """Put a station on a tile if the floor stays connected and no station is shut in."""
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
