"""The steps to go as a curve: what is known of them, and how it is drawn."""

from __future__ import annotations

from typing import NamedTuple

import pygame

from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, BAD, CARD, FAINT, INK, mixed
from robotouille_client.window.replay.timeline.scale import Scale

__all__ = ["StepsCurve", "StepsKnown"]


class StepsKnown(NamedTuple):
    """The fewest steps from a state to the goal: `least` to `most` (None: nobody knows); none are
    enough any more if it is `dead`."""

    least: int
    most: int | None
    dead: bool = False

    @property
    def words(self) -> str:
        """`12 steps to go`, `12 to 14 …`, `at least 12 …`."""
        if self.dead:
            return "the goal is out of reach"
        if self.most is None:
            return f"at least {self.least} steps to go"
        if self.most == self.least:
            return f"{self.least} steps to go"
        return f"{self.least} to {self.most} steps to go"


class StepsCurve:
    """A curve that grows as more becomes known; `begun` says that it has room in the strip."""

    def __init__(self) -> None:
        self.begun = False
        self.known: list[StepsKnown] = []
        self._highest = 1
        self._surface: pygame.Surface | None = None
        self._drawn: tuple[object, ...] = ()

    def add(self, known: StepsKnown) -> None:
        """What is known of the next state, from step 0 on."""
        self.known.append(known)
        if not known.dead:
            self._highest = max(self._highest, known.most or known.least)

    def words(self, step: int) -> str:
        """What is known of a step; empty if nothing is."""
        return self.known[step].words if step < len(self.known) else ""

    def draw(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int, scale: Scale
    ) -> None:
        """The curve over the steps that are shown, its highest at the top."""
        if not self.begun:
            return
        inside = area.inflate(0, -size // 2)
        drawn = (inside.size, scale.first, scale.shown, len(self.known))
        if self._surface is None or drawn != self._drawn:
            self._surface, self._drawn = pygame.Surface(inside.size), drawn
            self._surface.fill(mixed(CARD, INK, 0.25))
            self._columns(self._surface, scale)
        target.blit(self._surface, inside)
        small = max(9, size - 4)
        for words, y in ((str(self._highest), inside.top), ("0", inside.bottom - small)):
            number = text.line(words, small, FAINT)
            target.blit(number, number.get_rect(topright=(area.left - 4, y)))
        label = text.line("steps to go", small, FAINT)
        target.blit(label, label.get_rect(midright=(area.left - 4, inside.centery)))

    def _columns(self, surface: pygame.Surface, scale: Scale) -> None:
        """A column of pixels for each step, or for one of several."""
        width, height = surface.get_size()
        before: int | None = None
        for x in range(width):
            step = int(scale.first + x * scale.shown / width + 0.5)
            if step >= len(self.known):
                return
            known = self.known[step]
            if known.dead:
                surface.fill(mixed(BAD, INK, 0.35), (x, 0, 1, height))
                before = None
                continue
            low = height - round(known.least / self._highest * height)
            most = known.least if known.most is None else known.most
            high = height - round(most / self._highest * height)
            surface.fill(mixed(ACCENT, CARD, 0.75), (x, low, 1, height - low))
            surface.fill(mixed(ACCENT, CARD, 0.5), (x, high, 1, low - high))
            top, bottom = sorted((high, high if before is None else before))
            colour = FAINT if known.most is None else ACCENT
            surface.fill(colour, (x, min(top, height - 2), 1, max(2, bottom - top)))
            before = high
