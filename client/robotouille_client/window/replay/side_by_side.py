"""Two histories in one window; each half has its own painter and timeline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pygame

from robotouille.world.world import State, World
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.drawing.window_layout import Layout, UiOverlay
from robotouille_client.window.pictures.appearance import SceneSprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import INK
from robotouille_client.window.replay.timeline.timeline_strip import TimelineStrip
from robotouille_client.window.view import View

_MOUSE = frozenset({pygame.MOUSEMOTION, pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP})


def _halves(size: tuple[int, int]) -> tuple[pygame.Rect, pygame.Rect]:
    left = size[0] // 2
    return pygame.Rect(0, 0, left, size[1]), pygame.Rect(left, 0, size[0] - left, size[1])


def _without_outcome(view: View) -> View:
    """Return a view without its outcome, which the strip shows."""
    return replace(view, outcome="", lost=bool(view.outcome) and not view.won)


class SideBySidePainter(Painter):
    """Paints a view on the left and another one on the right.

    To the window it is the painter of the left half, where it looks for what the mouse points at.
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
        self._right_view: Callable[[], View] = lambda: _without_outcome(right_view())

    def paint(
        self, surface: pygame.Surface, view: View, ui_overlay: UiOverlay | None = None
    ) -> None:
        """Draw each view on its half of a surface."""
        left, right = _halves(surface.get_size())
        self._right.paint(surface.subsurface(right), self._right_view())
        self._left.paint(surface.subsurface(left), view, ui_overlay)
        pygame.draw.line(surface, INK, right.topleft, right.bottomleft, 3)

    def redraw_key(self, view: View) -> object:
        """Return the visible part of both views."""
        return self._left.redraw_key(view), self._right.redraw_key(self._right_view())

    def layout(self, size: tuple[int, int], world: World) -> Layout:
        """Return the layout of the left half."""
        return self._left.layout(_halves(size)[0].size, world)

    def stage(self, state: State) -> SceneSprites:
        """Return everything to draw of a state on the left."""
        return self._left.stage(state)

    def preload(self, size: tuple[int, int], seconds: float) -> None:
        """Draw pictures that either half may need."""
        for painter, half in zip((self._left, self._right), _halves(size), strict=True):
            painter.preload(half.size, seconds / 2)

    def icon(self, world: World, size: int) -> pygame.Surface | None:
        """Return the window's icon."""
        return self._left.icon(world, size)


class SideBySideStrip:
    """Both timelines as a single strip. The painters of the halves draw them."""

    def __init__(self, left: TimelineStrip, right: TimelineStrip) -> None:
        self._left = left
        self._right = right

    @property
    def lines(self) -> float:
        """Height as a multiple of the window's text size."""
        return max(self._left.lines, self._right.lines)

    def draw(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int, view: View
    ) -> None:
        """Do nothing: the painters of the halves have drawn."""

    def tick(self) -> None:
        """Advance both strips by one frame."""
        self._left.tick()
        self._right.tick()

    def redraw_key(self) -> object:
        """Return a value that changes whenever either picture would."""
        return self._left.redraw_key(), self._right.redraw_key()

    def handle(self, event: pygame.Event, area: pygame.Rect) -> bool:
        """Pass an event to both strips, with mouse positions relative to each half."""
        there, shift = event, self._right.offset
        if event.type in _MOUSE:
            moved = (event.pos[0] - shift, event.pos[1])
            there = pygame.Event(event.type, {**event.dict, "pos": moved})
        # Both halves follow the mouse; the half that it leaves must drop its tooltip.
        if event.type == pygame.MOUSEMOTION:
            return self._left.handle(event, area) | self._right.handle(there, self._right.area)
        return self._left.handle(event, area) or self._right.handle(there, self._right.area)

    def covers(self, position: tuple[int, int]) -> bool:
        """Return whether a pixel shows one of the strips."""
        there = position[0] - self._right.offset, position[1]
        return self._left.covers(position) or self._right.covers(there)
