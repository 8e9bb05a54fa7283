"""A title, rows to go through, and a result: by mouse, keys and gamepad alike."""

from __future__ import annotations

from collections.abc import Sequence

import pygame

from robotouille_client.window.forms.widgets import Button, Look, Row
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    FAINT,
    PANEL,
    TEXT,
    Colour,
    mixed,
)

__all__ = ["Form"]

_DOUBLE = 5 / 2


class Form:
    """Rows under a title; `result` is None until one of them, or `cancel`, has given one.

    Args:
        title: What the form is about.
        rows: From the top; the first that can have it gets the focus.
        cancel: The result of Escape; None where there is no way back.
        picture: What is shown beside the rows.
        accent: The title's colour.
    """

    def __init__(
        self,
        title: str,
        rows: Sequence[Row],
        *,
        cancel: object = "back",
        picture: pygame.Surface | None = None,
        accent: Colour = ACCENT,
    ) -> None:
        self.title = title
        self.rows = tuple(rows)
        self.cancel = cancel
        self.picture = picture
        self.message = ""
        self.result: object = None
        self._accent = accent
        self._focus = next((i for i, row in enumerate(self.rows) if row.focusable), -1)
        self._places: list[tuple[pygame.Rect, int]] = []
        self._first = 0

    @property
    def focused(self) -> Row | None:
        """The row that commands go to."""
        return self.rows[self._focus] if self._focus >= 0 else None

    def focus(self, row: Row) -> None:
        """Move the focus."""
        self._focus = self.rows.index(row)

    # Events

    def handle(self, event: pygame.Event, keys: KeyMap) -> Command | None:
        """Follow an event; a command that is not for the form comes back."""
        row = self.focused
        if event.type == pygame.MOUSEMOTION:
            self._point(event.pos)
        elif event.type == pygame.MOUSEBUTTONDOWN and event.button == 1:
            self._click(event.pos)
        elif event.type == pygame.MOUSEWHEEL:
            self._move(-1 if event.y > 0 else 1)
        elif event.type == pygame.TEXTINPUT and row is not None and row.wants_letters:
            row.letters(event.text)
        elif event.type == pygame.KEYDOWN:
            return self._key(pygame.key.name(event.key).casefold(), keys)
        return None

    def command(self, command: Command) -> Command | None:
        """Follow a command; one that is not for the form comes back."""
        if command is Command.CANCEL:
            self.result = self.cancel
        elif command in (Command.UP, Command.DOWN, Command.LIST):
            self._move(-1 if command is Command.UP else 1)
        elif command in (Command.LEFT, Command.RIGHT, Command.USE, Command.ENTER):
            self._use(self.focused, command)
        else:
            return command
        return None

    def _key(self, name: str, keys: KeyMap) -> Command | None:
        row = self.focused
        if row is not None and row.key(name):
            return None
        command = keys.command(name)
        if row is not None and row.wants_letters and len(name) == 1:
            return None
        if command is Command.USE and name == "space" and row is not None and row.wants_letters:
            return None
        return self.command(command) if command is not None else None

    def _use(self, row: Row | None, command: Command) -> None:
        if row is not None and row.command(command):
            self._choose(row)

    def _choose(self, row: Row) -> None:
        """What a row asks for: its value, or, of a field that is filled in, the next button."""
        if isinstance(row, Button):
            self.result = row.value
            return
        following = self.rows[self.rows.index(row) + 1 :]
        button = next((r for r in following if r.focusable), None)
        if button is not None:
            self.focus(button)

    def _move(self, step: int) -> None:
        """Give the focus to the next row that can have it, round and round."""
        for _ in self.rows:
            self._focus = (self._focus + step) % len(self.rows)
            if self.rows[self._focus].focusable:
                return

    def _point(self, pos: tuple[int, int]) -> None:
        for area, index in self._places:
            if area.collidepoint(pos) and self.rows[index].focusable:
                self._focus = index

    def _click(self, pos: tuple[int, int]) -> None:
        for area, index in self._places:
            row = self.rows[index]
            if area.collidepoint(pos) and row.focusable:
                self._focus = index
                if row.click((pos[0] - area.x) / area.width):
                    self._choose(row)
                return

    # Drawing

    def draw(self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int) -> None:
        """Fill an area of the window; what does not fit is scrolled to."""
        pad = size
        target.blit(box(area.size, PANEL, pad, mixed(PANEL, TEXT, 0.25)), area)
        inner = area.inflate(-2 * pad, -2 * pad)
        y = inner.y
        for line in text.wrap(self.title, round(size * 1.5), inner.width, 3):
            target.blit(text.line(line, round(size * 1.5), self._accent), (inner.x, y))
            y += text.height(round(size * 1.5))
        y += pad // 2
        if self.picture is not None and self.picture.get_width() * 2 < inner.width:
            place = self.picture.get_rect(topright=(inner.right, y))
            target.blit(self.picture, place)
            inner.width -= place.width + pad
        foot = text.wrap(self.message, size, inner.width, 4)
        bottom = inner.bottom - text.height(size) * len(foot)
        self._draw_rows(target, pygame.Rect(inner.x, y, inner.width, bottom - y), text, size)
        for i, line in enumerate(foot):
            at = (inner.x, bottom + i * text.height(size))
            target.blit(text.line(line, size, ACCENT), at)

    def _draw_rows(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int
    ) -> None:
        gap = max(3, size // 4)
        heights = [self._height(row, text, size, area.width) + gap for row in self.rows]
        self._scroll(heights, area.height)
        self._places = []
        y = area.y
        for index in range(self._first, len(self.rows)):
            if y + heights[index] - gap > area.bottom:
                more = text.line("…", size, FAINT)
                target.blit(more, more.get_rect(midbottom=(area.centerx, area.bottom + size // 2)))
                break
            row = self.rows[index]
            place = pygame.Rect(area.x, y, area.width, heights[index] - gap)
            row.draw(target, place, Look(text, size, index == self._focus))
            self._places.append((place, index))
            y += heights[index]

    def _height(self, row: Row, text: Typesetter, size: int, width: int) -> int:
        lines = row.lines(Look(text, size, focused=False), width)
        line = text.height(size)
        return round(size * _DOUBLE) if row.focusable else lines * line + size // 2

    def _scroll(self, heights: list[int], room: int) -> None:
        """Show as much from the top as can be with the focus in sight."""
        self._first = 0
        while self._first < self._focus and sum(heights[self._first : self._focus + 1]) > room:
            self._first += 1
