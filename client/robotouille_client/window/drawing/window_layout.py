"""Where things are in a window of a given size."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import pygame

from robotouille.world.grounding.floor import Tile

__all__ = ["Layout", "layout"]

_MARGIN = 8
_WALL, _LOW_WALL = 1.0, 0.55
"""How high the wall is in tiles, and how low where the kitchen would be smaller for it."""

_LETTERS, _LARGE_LETTERS = 45, 38
"""How many times the height of letters goes into that of a window; where a wide one has room beside
the kitchen, they are larger."""

_PANEL = 18.5
"""The width of the panel in letters."""

_COMPACT = 26
"""A panel that is less high than so many letters has one line for each seat."""


@dataclass(frozen=True)
class Layout:
    """The kitchen's grid of square tiles, with a wall above it, the panel beside it, and the
    strip below it, which may have no height."""

    size: tuple[int, int]
    columns: int
    rows: int
    tile: int
    left: int
    top: int
    panel: pygame.Rect
    strip: pygame.Rect
    text: int
    wall: int = 0

    @property
    def compact(self) -> bool:
        """Whether there is little room in the panel."""
        return self.panel.height < _COMPACT * self.text

    @property
    def kitchen(self) -> pygame.Rect:
        """The wall and the floor."""
        return pygame.Rect(
            self.left,
            self.top - self.wall,
            self.columns * self.tile,
            self.rows * self.tile + self.wall,
        )

    def corner(self, tile: tuple[float, float]) -> tuple[float, float]:
        """The upper left pixel of a tile; a tile between two others works too."""
        x, y = tile
        return self.left + x * self.tile, self.top + (self.rows - 1 - y) * self.tile

    def cell(self, tile: Tile) -> pygame.Rect:
        """The square of a tile."""
        x, y = self.corner(tile)
        return pygame.Rect(round(x), round(y), self.tile, self.tile)

    def tile_at(self, position: tuple[int, int]) -> Tile | None:
        """The tile under a pixel."""
        x, y = (position[0] - self.left) // self.tile, (position[1] - self.top) // self.tile
        inside = 0 <= x < self.columns and 0 <= y < self.rows
        return (x, self.rows - 1 - y) if inside else None


@lru_cache(maxsize=64)
def layout(
    size: tuple[int, int],
    columns: int,
    rows: int,
    strip_lines: float = 0.0,
    text_scale: float = 1.0,
    head_lines: float = 0.0,
) -> Layout:
    """The largest tiles that leave room for a readable panel, for a strip of some lines, and for
    some above the floor, which may lie over the wall.

    Letters grow with the window; `text_scale` makes them larger or smaller than they would be.
    """
    wide, high = max(size[0], 160), max(size[1], 120)
    small, large = (
        max(11, round(min(high / share, wide / 60) * text_scale))
        for share in (_LETTERS, _LARGE_LETTERS)
    )
    plain = _with_letters((wide, high), columns, rows, (0.0, strip_lines), small)
    roomy = large > small and plain.left > 2 * (large - small) * _PANEL
    letters = large if roomy else small  # Whatever is above the floor.
    return _with_letters((wide, high), columns, rows, (head_lines, strip_lines), letters)


def _with_letters(
    size: tuple[int, int], columns: int, rows: int, lines: tuple[float, float], text: int
) -> Layout:
    width, height = size
    panel = min(round(text * _PANEL), width * 2 // 5)
    head, strip = (round(each * text) for each in lines)
    room_x = width - panel - 2 * _MARGIN
    room_y = height - strip - 2 * _MARGIN - text * 3 // 2
    floor = min(int(room_y / (rows + _LOW_WALL)), (room_y + _MARGIN - head) // rows)
    tile = max(8, min(room_x // columns, floor))
    wall = round(tile * min(_WALL, max(_LOW_WALL, room_y / tile - rows)))
    left = _MARGIN + (room_x - tile * columns) // 2
    top = max(head, _MARGIN + (room_y - rows * tile - wall) // 2 + wall)
    side = pygame.Rect(width - panel, 0, panel, height)
    below = pygame.Rect(0, height - strip, width - panel, strip)
    return Layout((width, height), columns, rows, tile, left, top, side, below, text, wall)
