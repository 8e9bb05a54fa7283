"""Where the rows of a form are, which of them have room, and how far it is scrolled."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import pygame

from robotouille_client.window.forms.widgets import Look, Row
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import FAINT, TRACK

__all__ = ["RowList"]


class RowList:
    """Draws rows below each other, with a mark of how far they are scrolled.

    The last `pinned` ones are always at the bottom.
    """

    def __init__(self, pinned: int = 0) -> None:
        self.places: list[tuple[pygame.Rect, int]] = []
        self.bar = pygame.Rect(0, 0, 0, 0)
        self.page = 1
        self._pinned = pinned
        self._first = 0
        self._cut = -1

    def row_at(
        self, pos: tuple[int, int], *, whole: bool = False
    ) -> tuple[pygame.Rect, int] | None:
        """The place and number of the row that was drawn at a point; with `whole`, of one that is
        not cut off."""
        for place, index in self.places:
            if place.collidepoint(pos):
                return None if whole and index == self._cut else (place, index)
        return None

    def draw(
        self,
        target: pygame.Surface,
        area: pygame.Rect,
        rows: Sequence[Row],
        focus: int,
        text: Typesetter,
        size: int,
        *,
        marked: bool = True,
    ) -> None:
        """Draw the rows that have room, the one with the focus among them, which may be
        `marked`."""
        gap = max(3, size // 4)
        look = Look(text, size, focused=False)
        ends = rows[max(0, len(rows) - self._pinned) :]
        count = len(rows) - len(ends)
        below = sum(row.height(look, area.width) + gap for row in ends)
        room = pygame.Rect(area.x, area.y, area.width, area.height - below)
        heights = [row.height(look, room.width) for row in rows[:count]]
        last = count
        if sum(heights) + gap * (count - 1) > room.height:
            room.width -= size
            heights = [row.height(look, room.width) for row in rows[:count]]
            steps = [height + gap for height in heights]
            last = self._scroll(steps, rows, focus, room.height + gap)
            bar = pygame.Rect(area.right - size // 2, room.y, max(4, size // 2), room.height)
            self._mark(target, bar, self._first / count, last / count)
        else:
            self._first, self.bar = 0, pygame.Rect(0, 0, 0, 0)
        self.page, self._cut = max(1, last - self._first - 1), last if last < count else -1
        shown = range(self._first, min(count, last + 1))  # One in part: there is more below.
        foot = pygame.Rect(area.x, room.bottom + gap, area.width, below)
        mark = focus if marked else -1
        self.places = [
            *self._rows(target, room, rows, shown, mark, look),
            *self._rows(target, foot, rows, range(count, len(rows)), mark, look),
        ]

    def _rows(
        self,
        target: pygame.Surface,
        room: pygame.Rect,
        rows: Sequence[Row],
        indices: Iterable[int],
        mark: int,
        look: Look,
    ) -> Iterator[tuple[pygame.Rect, int]]:
        """Draw rows below each other, cut off where the room ends; where they are."""
        gap, y = max(3, look.size // 4), room.y
        clip = target.get_clip()
        for index in indices:
            place = pygame.Rect(room.x, y, room.width, rows[index].height(look, room.width))
            seen = place.clip(room)
            if seen.height < look.size // 2:
                return
            target.set_clip(seen.clip(clip))
            rows[index].draw(target, place, Look(look.text, look.size, index == mark))
            target.set_clip(clip)
            yield seen, index
            y += place.height + gap

    def _scroll(self, heights: list[int], rows: Sequence[Row], focus: int, room: int) -> int:
        """Move as little as brings the focus into sight; the row behind the last that has room.

        What stands above the first row that can have the focus, and below the last one, is shown
        with it.
        """
        able = [index for index, row in enumerate(rows[: len(heights)]) if row.focusable]
        if focus < len(heights):
            self._first = min(self._first, 0 if able and focus == able[0] else focus)
            upto = len(heights) - 1 if able and focus == able[-1] else focus
            while self._first < focus and sum(heights[self._first : upto + 1]) > room:
                self._first += 1
        self._first = min(self._first, len(heights) - 1)
        while self._first > 0 and sum(heights[self._first - 1 :]) <= room:
            self._first -= 1
        last, left = self._first, room
        while last < len(heights) and (heights[last] <= left or last == self._first):
            left -= heights[last]
            last += 1
        return last

    def _mark(self, target: pygame.Surface, bar: pygame.Rect, start: float, end: float) -> None:
        """The part of all rows that is shown."""
        self.bar = bar
        target.blit(box(bar.size, TRACK, bar.width // 2), bar)
        height = max(bar.width * 2, round(bar.height * (end - start)))
        knob = pygame.Rect(bar.x, 0, bar.width, min(height, bar.height))
        knob.top = min(bar.bottom - knob.height, bar.y + round(bar.height * start))
        target.blit(box(knob.size, FAINT, bar.width // 2), knob)
