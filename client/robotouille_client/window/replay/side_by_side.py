"""Two histories in one window: each half has a painter and a timeline of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pygame

from robotouille.world.world import State, World
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.ui_overlay import UiOverlay
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import Stage
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import INK
from robotouille_client.window.replay.timeline.timeline_strip import TimelineStrip
from robotouille_client.window.view import View

__all__ = ["SideBySidePainter", "SideBySideStrip"]

_MOUSE = frozenset({pygame.MOUSEMOTION, pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP})


def _halves(size: tuple[int, int]) -> tuple[pygame.Rect, pygame.Rect]:
    left = size[0] // 2
    return pygame.Rect(0, 0, left, size[1]), pygame.Rect(left, 0, size[0] - left, size[1])


def _untold(view: View) -> View:
    """Without the outcome, which the strip tells."""
    return replace(view, outcome="", lost=bool(view.outcome) and not view.won)


class SideBySidePainter(Painter):
    """Paints the view that it is given on the left, and another one on the right.

    To the window it is the painter of the left half: what the mouse points at is looked for there.
    """

    def __init__(
        self,
        left: TimelineStrip,
        right: TimelineStrip,
        right_view: Callable[[], View],
        rendering: str,
    ) -> None:
        super().__init__(rendering)
        self._left = Painter(rendering, strip=left)
        self._right = Painter(rendering, strip=right)
        self._right_view: Callable[[], View] = lambda: _untold(right_view())

    def paint(
        self, surface: pygame.Surface, view: View, ui_overlay: UiOverlay | None = None
    ) -> None:
        """Draw both views, each on its half of a surface."""
        left, right = _halves(surface.get_size())
        self._right.paint(surface.subsurface(right), self._right_view())
        self._left.paint(surface.subsurface(left), view, ui_overlay)
        pygame.draw.line(surface, INK, right.topleft, right.bottomleft, 3)

    def seen(self, view: View) -> object:
        """What can be seen of both views: two that are equal look the same."""
        return self._left.seen(view), self._right.seen(self._right_view())

    def layout(self, size: tuple[int, int], world: World) -> Layout:
        """Where things are on the left half of a surface of a size."""
        return self._left.layout(_halves(size)[0].size, world)

    def stage(self, state: State) -> Stage:
        """What there is to draw of a state on the left."""
        return self._left.stage(state)

    def preload(self, size: tuple[int, int], seconds: float) -> None:
        """Draw pictures that both halves may show."""
        for painter, half in zip((self._left, self._right), _halves(size), strict=True):
            painter.preload(half.size, seconds / 2)

    def icon(self, world: World, size: int) -> pygame.Surface | None:
        """The window's icon."""
        return self._left.icon(world, size)


class SideBySideStrip:
    """Both timelines, as the one strip that a window knows; their painters draw them."""

    def __init__(self, left: TimelineStrip, right: TimelineStrip) -> None:
        self._left = left
        self._right = right

    @property
    def lines(self) -> float:
        """The height, as a multiple of the window's text size."""
        return max(self._left.lines, self._right.lines)

    def draw(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int, view: View
    ) -> None:
        """Nothing: the painters of the halves have drawn."""

    def tick(self) -> None:
        """A frame passes: for a key that is held."""
        self._left.tick()
        self._right.tick()

    def seen(self) -> object:
        """What can be seen of both, as a value."""
        return self._left.seen(), self._right.seen()

    def handle(self, event: pygame.Event, area: pygame.Rect) -> bool:
        """Whether an event was for one of both; the mouse on the right is moved to the left."""
        there, shift = event, self._right.offset
        if event.type in _MOUSE:
            moved = (event.pos[0] - shift, event.pos[1])
            there = pygame.Event(event.type, {**event.dict, "pos": moved})
        if event.type == pygame.MOUSEMOTION:
            return self._left.handle(event, area) | self._right.handle(there, self._right.area)
        return self._left.handle(event, area) or self._right.handle(there, self._right.area)

    def covers(self, position: tuple[int, int]) -> bool:
        """Whether a pixel of the window shows one of both."""
        there = position[0] - self._right.offset, position[1]
        return self._left.covers(position) or self._right.covers(there)
