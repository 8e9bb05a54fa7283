"""Where things are in a window of a given size."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import pygame

from robotouille.world.grounding.floor import Tile

__all__ = ["Layout", "layout"]

_MARGIN = 8
_WALL = 1.0


@dataclass(frozen=True)
class Layout:
    """The kitchen's grid of square tiles, with a row of wall above it, the panel beside it, and the
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

    @property
    def kitchen(self) -> pygame.Rect:
        """The wall and the floor."""
        wall = round(_WALL * self.tile)
        return pygame.Rect(
            self.left, self.top - wall, self.columns * self.tile, self.rows * self.tile + wall
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
) -> Layout:
    """The largest tiles that leave room for a readable panel, and for a strip of some lines.

    Letters grow with the window; `text_scale` makes them larger or smaller than they would be.
    """
    width, height = max(size[0], 160), max(size[1], 120)
    text = max(11, round(min(height / 45, width / 60) * text_scale))
    panel = min(round(text * 18.5), width * 2 // 5)
    strip = round(strip_lines * text)
    room_x = width - panel - 2 * _MARGIN
    room_y = height - strip - 2 * _MARGIN - text * 3 // 2
    tile = max(8, min(room_x // columns, int(room_y / (rows + _WALL))))
    left = _MARGIN + (room_x - tile * columns) // 2
    used = round((rows + _WALL) * tile)
    top = _MARGIN + (room_y - used) // 2 + round(_WALL * tile)
    side = pygame.Rect(width - panel, 0, panel, height)
    below = pygame.Rect(0, height - strip, width - panel, strip)
    return Layout((width, height), columns, rows, tile, left, top, side, below, text)
