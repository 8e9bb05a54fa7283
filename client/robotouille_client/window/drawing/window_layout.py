"""Layout of a window of a given size, and the parts that others fill."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, Protocol

import pygame

from robotouille.world.grounding.objects import Tile
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.view import View


class Strip(Protocol):
    """Strip below the kitchen. It receives input events before the window does."""

    @property
    def lines(self) -> float:
        """Height as a multiple of the window's text size."""

    def draw(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int, view: View
    ) -> None:
        """Fill an area of the window; `size` is the window's text size."""

    def tick(self) -> None:
        """Advance by one frame, for instance to repeat a held key."""

    def redraw_key(self) -> object:
        """Return a value that changes whenever the strip's picture would."""

    def handle(self, event: pygame.Event, area: pygame.Rect) -> bool:
        """Handle an event. Return whether it was for the strip, which was drawn in `area`."""

    def covers(self, position: tuple[int, int]) -> bool:
        """Return whether a pixel shows the strip rather than the kitchen."""


# Keys with their meanings.
KeyRows = tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class ActionMark:
    """Station of the local player's newest action, and what became of the action."""

    station: str
    fate: Literal["asked", "done", "rejected"]


@dataclass(frozen=True, slots=True)
class UiOverlay:
    """Everything that only the local player sees.

    Attributes:
        tips: Lines next to the mouse.
        prompt: Line below the kitchen, shown for a while.
        typing: Chat line being typed, if any.
        help: Help rows, if help is open.
        hints: Key strip: keys with what they do now.
        keys: Key strip: keys that are always there.
        queued: Key strip: actions that wait.
        choices: Numbered actions of the open list; None if it is closed.
        marks: Stations of the newest actions of the people at this window.
        chosen: Index of the marked action.
        more: Line below the list if the list goes on.
    """

    pointer: tuple[int, int] | None = None
    tips: tuple[str, ...] = ()
    prompt: str = ""
    typing: str | None = None
    help: KeyRows = ()
    hints: KeyRows = ()
    keys: KeyRows = ()
    queued: tuple[str, ...] = ()
    marks: tuple[ActionMark, ...] = ()
    choices: tuple[str, ...] | None = None
    chosen: int = 0
    more: str = ""


_MARGIN = 8
# Height of the wall in tiles: usual, and lowest where tiles would shrink otherwise.
_WALL, _LOW_WALL = 1.0, 0.55

# Window height divided by the letters' height; larger letters if a wide window has room.
_LETTERS, _LARGE_LETTERS = 45, 38

# Width of the panel in letters.
_PANEL = 18.5

# Panel height, in letters, below which a seat gets a single line.
_COMPACT = 26


@dataclass(frozen=True)
class Layout:
    """Grid of square tiles with a wall above, the panel on the right and the strip below.

    The strip may have no height.
    """

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
        """True if the panel is short of room."""
        return self.panel.height < _COMPACT * self.text

    @property
    def kitchen(self) -> pygame.Rect:
        """Area of the wall and the floor."""
        return pygame.Rect(
            self.left,
            self.top - self.wall,
            self.columns * self.tile,
            self.rows * self.tile + self.wall,
        )

    def corner(self, tile: tuple[float, float]) -> tuple[float, float]:
        """Return the upper left pixel of a tile, or of a point between tiles."""
        x, y = tile
        return self.left + x * self.tile, self.top + (self.rows - 1 - y) * self.tile

    def cell(self, tile: Tile) -> pygame.Rect:
        """Return the square of a tile."""
        x, y = self.corner(tile)
        return pygame.Rect(round(x), round(y), self.tile, self.tile)

    def tile_at(self, position: tuple[int, int]) -> Tile | None:
        """Return the tile at a pixel, or None."""
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
    """Return the layout with the largest tiles that leave room for a readable panel.

    Args:
        strip_lines: Height of the strip, as a multiple of the text size.
        text_scale: Factor on the letters' size, which otherwise follows the window's.
        head_lines: Lines above the floor, which may lie over the wall.
    """
    # In smaller windows nothing would be left for the tiles.
    wide, high = max(size[0], 160), max(size[1], 120)
    small, large = (
        max(11, round(min(high / share, wide / 60) * text_scale))
        for share in (_LETTERS, _LARGE_LETTERS)
    )
    plain = _with_letters((wide, high), columns, rows, (0.0, strip_lines), small)
    roomy = large > small and plain.left > 2 * (large - small) * _PANEL
    letters = large if roomy else small  # The same with or without lines above the floor.
    return _with_letters((wide, high), columns, rows, (head_lines, strip_lines), letters)


def _with_letters(
    size: tuple[int, int], columns: int, rows: int, lines: tuple[float, float], text: int
) -> Layout:
    width, height = size
    panel = min(round(text * _PANEL), width * 2 // 5)
    head, strip = (round(each * text) for each in lines)
    room_x = width - panel - 2 * _MARGIN
    room_y = height - strip - 2 * _MARGIN - text * 3 // 2
    # Lines above the floor may cover the wall, but not the floor.
    floor = min(int(room_y / (rows + _LOW_WALL)), (room_y + _MARGIN - head) // rows)
    tile = max(8, min(room_x // columns, floor))
    wall = round(tile * min(_WALL, max(_LOW_WALL, room_y / tile - rows)))
    left = _MARGIN + (room_x - tile * columns) // 2
    top = max(head, _MARGIN + (room_y - rows * tile - wall) // 2 + wall)
    side = pygame.Rect(width - panel, 0, panel, height)
    below = pygame.Rect(0, height - strip, width - panel, strip)
    return Layout((width, height), columns, rows, tile, left, top, side, below, text, wall)
