"""Log in place of the panel: who did what, around the current step."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import pygame

from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    BAD,
    CARD,
    FAINT,
    INK,
    PANEL,
    SEATS,
    TEXT,
    Colour,
    mixed,
)
from robotouille_client.window.replay.histories.history import Entry, EntryKind, History
from robotouille_client.window.replay.readout import entry_words, name_of

# Lines of one entry.
MAX_LINES = 3
# Steps without events that are searched for the next entry.
FAR = 2000


class _Row(NamedTuple):
    entry: Entry
    head: str
    lines: tuple[str, ...]


class LogPanel:
    """Draws the log, and finds the step at a pixel."""

    def __init__(self, history: History) -> None:
        self._history = history
        self._places: list[tuple[pygame.Rect, int]] = []
        self._area = pygame.Rect(0, 0, 0, 0)
        self._surface: pygame.Surface | None = None
        self._drawn: tuple[object, ...] = ()

    def draw(
        self,
        target: pygame.Surface,
        area: pygame.Rect,
        text: Typesetter,
        size: int,
        step: int,
        followed: str | None,
    ) -> None:
        """Draw the log in an area, with the entries of a step in its middle."""
        history = self._history
        drawn = (area.size, size, step, followed, history.length, len(history.marks))
        if self._surface is None or drawn != self._drawn:
            self._surface, self._drawn = pygame.Surface(area.size), drawn
            self._render(self._surface, text, size, step, followed)
        self._area = area
        target.blit(self._surface, area)

    def _render(
        self, surface: pygame.Surface, text: Typesetter, size: int, step: int, followed: str | None
    ) -> None:
        self._places = []
        surface.fill(PANEL)
        surface.fill(INK, (0, 0, 2, surface.get_height()))
        pad, head = size, text.height(size + 3)
        inside = surface.get_rect().inflate(-2 * pad, -2 * pad)
        title = "Log" if followed is None else f"Log of {name_of(self._history, followed, step)}"
        surface.blit(text.line(text.fit(title, size + 3, inside.width), size + 3, TEXT), inside)
        inside.y += head + pad // 2
        inside.height -= head + pad // 2
        small = max(10, size - 2)
        surface.set_clip(inside.inflate(8, 0))
        y = inside.y
        for row in self._rows(text, inside, small, step, followed):
            y = self._draw_row(surface, inside, text, small, row, y, row.entry.step == step)

    def step_at(self, position: tuple[int, int]) -> int | None:
        """Return the step of the entry at a pixel, or None."""
        at = (position[0] - self._area.x, position[1] - self._area.y)
        return next((step for place, step in self._places if place.collidepoint(at)), None)

    def covers(self, position: tuple[int, int]) -> bool:
        """Return whether a pixel is in the log, as drawn last."""
        return self._area.collidepoint(position)

    def _rows(
        self, text: Typesetter, inside: pygame.Rect, size: int, step: int, followed: str | None
    ) -> list[_Row]:
        """Return as many entries as fit: those of the step, with some before and after."""
        line = text.height(size)
        room = max(1, inside.height // line)
        before: list[_Row] = []
        after: list[_Row] = []
        used = 0
        for entry in self._entries(range(step, -1, -1), followed):
            row = self._row(entry, text, inside.width, size)
            used += len(row.lines)
            if used > room * 3 // 5 and entry.step != step:
                break
            before.insert(0, row)
        before = before[-room:]
        used = sum(len(row.lines) for row in before)
        for entry in self._entries(range(step + 1, self._history.length + 1), followed):
            row = self._row(entry, text, inside.width, size)
            used += len(row.lines)
            if used > room:
                break
            after.append(row)
        return [*before, *after]

    def _entries(self, steps: range, followed: str | None) -> Iterator[Entry]:
        backwards = steps.step < 0
        for step in islice(steps, FAR):
            entries = self._history.entries(step)
            for entry in reversed(entries) if backwards else entries:
                if followed in (None, entry.player) or not entry.player:
                    yield entry

    def _row(self, entry: Entry, text: Typesetter, width: int, size: int) -> _Row:
        head = str(entry.step)
        who = f"{name_of(self._history, entry.player, entry.step)}: " if entry.player else ""
        says_who = entry.kind is EntryKind.SEAT
        words = entry_words(entry) if says_who else f"{who}{entry_words(entry)}"
        room = width - text.width("00000 ", size)
        return _Row(entry, head, text.wrap(words, size, room, MAX_LINES) or ("",))

    def _draw_row(
        self,
        target: pygame.Surface,
        inside: pygame.Rect,
        text: Typesetter,
        size: int,
        row: _Row,
        y: int,
        current: bool,
    ) -> int:
        line = text.height(size)
        place = pygame.Rect(inside.x - 4, y, inside.width + 8, line * len(row.lines))
        if current:
            target.blit(box(place.size, mixed(CARD, ACCENT, 0.25), 4), place)
        self._places.append((place, row.entry.step))
        gutter = text.width("00000 ", size)
        number = text.line(row.head, size, ACCENT if current else FAINT)
        target.blit(number, number.get_rect(topright=(inside.x + gutter - size // 2, y)))
        for i, words in enumerate(row.lines):
            drawn = text.line(words, size, self._colour(row.entry))
            target.blit(drawn, (inside.x + gutter, y + i * line))
        return y + place.height

    def _colour(self, entry: Entry) -> Colour:
        players = self._history.world.players
        if entry.kind is EntryKind.REJECTED:
            return mixed(BAD, TEXT, 0.35)
        if entry.player not in players:
            return ACCENT
        colour = SEATS[players.index(entry.player) % len(SEATS)]
        faint = entry.kind in (EntryKind.REASONING, EntryKind.OTHER, EntryKind.SEAT)
        return mixed(colour, FAINT if faint else TEXT, 0.6)
