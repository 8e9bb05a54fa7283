"""The lanes of a timeline: what each seat did with each step, and marks, on one picture."""

from __future__ import annotations

from collections import Counter

import pygame

from robotouille_client.window.pictures.theme import CARD
from robotouille_client.window.replay.history.history import ACTIVITIES, EntryKind, History
from robotouille_client.window.replay.timeline.legend import (
    ACTIVITY_LOOKS,
    MARK_COLOURS,
    TRACK,
    ActivityLook,
    draw_mark,
    textured,
)
from robotouille_client.window.replay.timeline.scale import Scale

__all__ = ["Lanes"]

_WIDE = 5
"""Pixels a step from which on steps are drawn one by one, with a gap."""
_LOOKS = [*(ACTIVITY_LOOKS[activity] for activity in ACTIVITIES), ActivityLook(CARD, 0.0, "")]
"""By the byte of a lane; nothing is drawn of what was not seen."""


class Lanes:
    """Draws the lanes of a history, anew only when something in them has changed."""

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
        """The lanes in an area, below the marks that are nobody's.

        Args:
            rows: The height of a lane, with room for its marks above it.
            head: The height of the marks that are nobody's.
            followed: The lane that is not faded; None: no lane is.
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
        """A block for each step."""
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
        """A column of pixels for several steps: each activity has its share of the height."""
        for x in range(row.width):
            start = int(scale.first + x * scale.shown / row.width)
            end = max(start + 1, int(scale.first + (x + 1) * scale.shown / row.width))
            steps = lane[start:end]
            if not steps:
                break
            bottom = float(row.height)
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
        """The signs of marks, those of one place beside each other; lines where there are many."""
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
                beside = _LINE[mark.kind] * size // 6
                surface.fill(MARK_COLOURS[mark.kind], (x, top + beside, 1, max(2, size // 2)))
                continue
            draw_mark(surface, mark.kind, (x + taken[x, mark.player] * (size + 2), top), size)
            taken[x, mark.player] += 1


_LINE = {EntryKind.REJECTED: 0, EntryKind.REASONING: 2, EntryKind.SAID: 4}
"""How far down the lines of a kind begin, in sixths: they are seen side by side."""
_BY_HEIGHT = sorted(range(len(ACTIVITIES)), key=lambda code: -_LOOKS[code].height)
