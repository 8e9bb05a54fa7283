"""What each seat did with the steps of a game, as a bar."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pygame

from robotouille_client.window.forms.widgets import Look, Row
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.theme import ACCENT, BAD, FAINT, GOOD, TEXT, TRACK, Colour

__all__ = ["SeatShare", "ShareRow"]

_KINDS: tuple[tuple[str, str, Colour], ...] = (
    ("acted", "acted", GOOD),
    ("busy", "at work", ACCENT),
    ("waiting", "waited", BAD),
    ("idle", "idle", TRACK),
    ("away", "away", FAINT),
    ("substituted", "stand-in", FAINT),
)


@dataclass(frozen=True, slots=True)
class SeatShare:
    """One seat's steps by what it did with them (`Activity`), and who played it."""

    name: str
    steps: Mapping[str, int]

    @classmethod
    def of(cls, name: str, row: Mapping[str, Any]) -> SeatShare:
        """From a seat's row of an outcome as JSON; what a server does not tell counts as none."""
        return cls(name, {kind: int(row.get(kind, 0)) for kind, _, _ in _KINDS})

    @property
    def words(self) -> str:
        """`acted 12, at work 40`; only what there was."""
        told = [f"{words} {self.steps[kind]}" for kind, words, _ in _KINDS if self.steps[kind]]
        return ", ".join(told) or "did nothing"


class ShareRow(Row):
    """A seat's name, a bar of its steps, and the same in words."""

    focusable = False

    def __init__(self, share: SeatShare) -> None:
        super().__init__(share.name)
        self._share = share

    def lines(self, look: Look, width: int) -> int:
        return 2 + len(look.text.wrap(self._share.words, look.size - 2, width))

    def draw(self, target: pygame.Surface, area: pygame.Rect, look: Look) -> None:
        name, top = look.text.fit(self.label, look.size, area.width), area.y + look.size // 3
        target.blit(look.text.line(name, look.size, TEXT), (area.x, top))
        y = top + look.text.height(look.size)
        whole = max(1, *self._share.steps.values(), sum(self._share.steps.values()))
        x = float(area.x)
        for kind, _, colour in _KINDS:
            width = area.width * (max(0, self._share.steps[kind]) / whole)
            if width >= 1:
                piece = pygame.Rect(round(x), y, round(width), max(6, look.size // 2))
                target.blit(box(piece.size, colour, 2), piece)
            x += width
        y += max(6, look.size // 2) + 3
        for words in look.text.wrap(self._share.words, look.size - 2, area.width):
            target.blit(look.text.line(words, look.size - 2, FAINT), (area.x, y))
            y += look.text.height(look.size - 2)
