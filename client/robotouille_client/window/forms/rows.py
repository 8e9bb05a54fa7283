"""Scrolling list of a form's rows, and the choices that lead from screen to screen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from enum import StrEnum

import pygame

from robotouille_client.window.forms.widgets import DrawContext, Row
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.theme import FAINT, TRACK


class MenuChoice(StrEnum):
    """Result of a form that decides what the app does next.

    Results that only one form has are strings of their own, or the picked object.
    """

    LEVELS = "levels"
    PLAY = "play"
    JOIN = "join"
    OPEN = "open"
    LOBBY = "lobby"
    REPLAYS = "replays"
    TUTORIAL = "tutorial"
    SETTINGS = "settings"
    MENU = "menu"

    STAY = "stay"
    """Stay in the game that is shown."""
    AGAIN = "again"
    SLOWER = "slower"
    """Play the same game again at an easy pace."""
    NEXT = "next"
    """Play the next task."""
    WATCH = "watch"
    """Watch the replay of the game."""
    VIDEO = "video"

    ASK_TO_QUIT = "ask to quit"
    QUIT = "quit"
    """Close the window."""


class RowList:
    """Rows below each other, with a scroll bar. The last `pinned` rows stay at the bottom."""

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
        """Return the area and index of the row at a point.

        With `whole`, ignore a row that is cut off.
        """
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
        context: DrawContext,
        *,
        marked: bool = True,
    ) -> None:
        """Draw the rows that fit, including the focused one."""
        size = context.size
        gap = max(3, size // 4)
        ends = rows[max(0, len(rows) - self._pinned) :]
        count = len(rows) - len(ends)
        below = sum(row.height(context, area.width) + gap for row in ends)
        room = pygame.Rect(area.x, area.y, area.width, area.height - below)
        heights = [row.height(context, room.width) for row in rows[:count]]
        last = count
        if sum(heights) + gap * (count - 1) > room.height:
            # The scroll bar makes the rows narrower, so they may need more lines.
            room.width -= size
            heights = [row.height(context, room.width) for row in rows[:count]]
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
            *self._rows(target, room, rows, shown, mark, context),
            *self._rows(target, foot, rows, range(count, len(rows)), mark, context),
        ]

    def _rows(
        self,
        target: pygame.Surface,
        room: pygame.Rect,
        rows: Sequence[Row],
        indices: Iterable[int],
        mark: int,
        context: DrawContext,
    ) -> Iterator[tuple[pygame.Rect, int]]:
        """Draw rows, clipped to the area, and yield their places."""
        gap, y = max(3, context.size // 4), room.y
        clip = target.get_clip()
        for index in indices:
            place = pygame.Rect(room.x, y, room.width, rows[index].height(context, room.width))
            seen = place.clip(room)
            # A row with less than half a letter visible cannot be read.
            if seen.height < context.size // 2:
                return
            target.set_clip(seen.clip(clip))
            rows[index].draw(target, place, replace(context, focused=index == mark))
            target.set_clip(clip)
            yield seen, index
            y += place.height + gap

    def _scroll(self, heights: list[int], rows: Sequence[Row], focus: int, room: int) -> int:
        """Scroll as little as possible to show the focus; return the index after the last row.

        Rows above the first focusable one, and below the last one, are shown together with it.
        """
        able = [index for index, row in enumerate(rows[: len(heights)]) if row.focusable]
        if focus < len(heights):
            self._first = min(self._first, 0 if able and focus == able[0] else focus)
            upto = len(heights) - 1 if able and focus == able[-1] else focus
            while self._first < focus and sum(heights[self._first : upto + 1]) > room:
                self._first += 1
        self._first = min(self._first, len(heights) - 1)
        # When the window has grown, earlier rows fill the room below the last one.
        while self._first > 0 and sum(heights[self._first - 1 :]) <= room:
            self._first -= 1
        last, left = self._first, room
        while last < len(heights) and (heights[last] <= left or last == self._first):
            left -= heights[last]
            last += 1
        return last

    def _mark(self, target: pygame.Surface, bar: pygame.Rect, start: float, end: float) -> None:
        self.bar = bar
        target.blit(box(bar.size, TRACK, bar.width // 2), bar)
        height = max(bar.width * 2, round(bar.height * (end - start)))
        knob = pygame.Rect(bar.x, 0, bar.width, min(height, bar.height))
        knob.top = min(bar.bottom - knob.height, bar.y + round(bar.height * start))
        target.blit(box(knob.size, FAINT, bar.width // 2), knob)
