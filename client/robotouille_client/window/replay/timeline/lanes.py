"""Lanes of the timeline: what each seat did in each step, with marks."""

from __future__ import annotations

from collections import Counter

import pygame

from robotouille_client.window.pictures.theme import CARD
from robotouille_client.window.replay.histories.history import ACTIVITIES, EntryKind, History
from robotouille_client.window.replay.timeline.legend import (
    ACTIVITY_LOOKS,
    MARK_COLOURS,
    TRACK,
    ActivityLook,
    draw_mark,
    textured,
)

# Fewest steps shown.
MIN_SHOWN = 10


class Scale:
    """Visible part of a game, and the pixels it is drawn on.

    Attributes:
        left: Left edge of the lanes in pixels.
        width: Width of the lanes in pixels.
        first: First visible step.
    """

    def __init__(self) -> None:
        self.left = 0
        self.width = 1
        self.first = 0.0
        self._shown: float | None = None
        self._steps = (0, 0)

    @property
    def shown(self) -> float:
        """Number of visible steps."""
        return self._whole if self._shown is None else min(self._shown, self._whole)

    @property
    def last(self) -> float:
        """Last visible step."""
        return self.first + self.shown

    @property
    def _whole(self) -> float:
        return float(max(1, self._steps[1] - self._steps[0]))

    def place(self, left: int, width: int, first: int, last: int) -> None:
        """Set the pixels of the lanes and the steps of the game."""
        self.left, self.width, self._steps = left, max(1, width), (first, last)
        self._go(self.first)

    def x(self, step: float) -> int:
        """Return the pixel of a step."""
        return self.left + round((step - self.first) / self.shown * self.width)

    def step(self, x: int) -> int:
        """Return the step nearest to a pixel."""
        first, last = self._steps
        return min(last, max(first, round(self.first + self._share(x) * self.shown)))

    def zoom(self, x: int, factor: float) -> None:
        """Multiply the number of visible steps, keeping the step at a pixel in place."""
        share = self._share(x)
        middle = self.first + share * self.shown
        wanted = max(float(MIN_SHOWN), self.shown * factor)
        self._shown = None if wanted >= self._whole else wanted
        self._go(middle - share * self.shown)

    def reveal(self, step: float) -> None:
        """Scroll to make a step visible."""
        if step < self.first:
            self._go(step - self.shown * 0.1)
        elif step > self.last:
            self._go(step - self.shown * 0.9)

    def _share(self, x: int) -> float:
        return min(1.0, max(0.0, (x - self.left) / self.width))

    def _go(self, first: float) -> None:
        """Start at a step, or earlier if too few steps follow it."""
        lowest = float(self._steps[0])
        self.first = min(max(lowest, first), lowest + self._whole - self.shown)


# Pixels per step from which steps are drawn one by one, with a gap.
_WIDE = 5
# Looks by lane byte; unknown steps are not drawn.
_LOOKS = [*(ACTIVITY_LOOKS[activity] for activity in ACTIVITIES), ActivityLook(CARD, 0.0, "")]


class Lanes:
    """Draws the lanes of a history, again only if something in them has changed."""

    def __init__(self, history: History) -> None:
        self._history = history
        self._surface: pygame.Surface | None = None
        self._drawn: tuple[object, ...] = ()

    def draw(
        self,
        target: pygame.Surface,
        area: pygame.Rect,
        scale: Scale,
        rows: int,
        head: int,
        followed: int | None,
    ) -> None:
        """Draw the lanes in an area, below the marks that belong to no player.

        Args:
            rows: Height of a lane, including the marks above it.
            head: Height of the marks that belong to no player.
            followed: Lane that is not faded; None fades no lane.
        """
        history = self._history
        drawn = (
            area.size, rows, scale.left - area.left, scale.width, scale.first, scale.shown,
            history.length, len(history.marks), followed,
        )  # fmt: skip
        if self._surface is None or drawn != self._drawn:
            self._surface, self._drawn = self._render(area, scale, rows, head, followed), drawn
        target.blit(self._surface, area)

    def _render(
        self, area: pygame.Rect, scale: Scale, rows: int, head: int, followed: int | None
    ) -> pygame.Surface:
        surface = pygame.Surface(area.size, pygame.SRCALPHA)
        left, marks = scale.left - area.left, rows * 2 // 5
        for place, lane in enumerate(self._history.lanes.values()):
            top = head + place * rows
            fade = 0.0 if followed in (None, place) else 0.6
            track = pygame.Rect(left, top + 1, scale.width, rows - 2)
            surface.fill(TRACK, track)
            row = pygame.Rect(left, top + marks, scale.width, rows - marks - 2)
            looks = [textured(look, row.size, fade) for look in _LOOKS]
            if scale.width >= _WIDE * scale.shown:
                self._steps(surface, row, lane, scale, looks)
            else:
                self._columns(surface, row, lane, scale, looks)
        self._marks(surface, area.left, scale, rows, head, followed)
        return surface

    def _steps(
        self,
        surface: pygame.Surface,
        row: pygame.Rect,
        lane: bytearray,
        scale: Scale,
        looks: list[pygame.Surface],
    ) -> None:
        shift = row.left - scale.left
        for step in range(int(scale.first), min(len(lane), int(scale.last) + 1)):
            code = lane[step]
            high = _LOOKS[code].height
            left = max(row.left, scale.x(step) + shift)
            right = min(row.right, scale.x(step + 1) + shift) - 1
            height = max(2, round(row.height * high))
            if right > left and high:
                part = (left - row.left, row.height - height, right - left, height)
                surface.blit(looks[code], (left, row.bottom - height), part)

    def _columns(
        self,
        surface: pygame.Surface,
        row: pygame.Rect,
        lane: bytearray,
        scale: Scale,
        looks: list[pygame.Surface],
    ) -> None:
        """Draw a column of pixels for several steps, shared out among their activities."""
        for x in range(row.width):
            start = int(scale.first + x * scale.shown / row.width)
            end = max(start + 1, int(scale.first + (x + 1) * scale.shown / row.width))
            steps = lane[start:end]
            if not steps:
                break
            bottom = float(row.height)
            # The tallest blocks are drawn at the bottom, so that columns form layers.
            for code in _BY_HEIGHT:
                count = steps.count(code)
                if count:
                    height = row.height * _LOOKS[code].height * count / len(steps)
                    top = round(bottom - height)
                    part = (x, top, 1, max(1, round(bottom) - top))
                    surface.blit(looks[code], (row.left + x, row.top + top), part)
                    bottom -= height

    def _marks(
        self,
        surface: pygame.Surface,
        origin: int,
        scale: Scale,
        rows: int,
        head: int,
        followed: int | None,
    ) -> None:
        """Draw the signs of marks next to each other, or lines if there are many."""
        places = {player: place for place, player in enumerate(self._history.lanes)}
        size = max(5, rows // 3)
        shown = [mark for mark in self._history.marks if scale.first <= mark.step <= scale.last]
        number = Counter(mark.player for mark in shown)
        drawn: set[tuple[int, EntryKind, str]] = set()
        taken: Counter[tuple[int, str]] = Counter()
        for mark in shown:
            place = places.get(mark.player)
            if followed is not None and place not in (None, followed):
                continue
            x = scale.x(mark.step) - origin
            if (x, mark.kind, mark.player) in drawn:
                continue
            drawn.add((x, mark.kind, mark.player))
            top = 1 if place is None else head + place * rows + 2
            if place is not None and number[mark.player] * size > scale.width // 2:
                below = _LINE[mark.kind] * size // 6
                surface.fill(MARK_COLOURS[mark.kind], (x, top + below, 1, max(2, size // 2)))
                continue
            draw_mark(surface, mark.kind, (x + taken[x, mark.player] * (size + 2), top), size)
            taken[x, mark.player] += 1


# Start of the lines of each kind, in sixths of their height, so that they do not overlap.
_LINE = {EntryKind.REJECTED: 0, EntryKind.REASONING: 2, EntryKind.SAID: 4}
_BY_HEIGHT = sorted(range(len(ACTIVITIES)), key=lambda code: -_LOOKS[code].height)
