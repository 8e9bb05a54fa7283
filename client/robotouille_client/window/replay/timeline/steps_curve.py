"""The steps to go as a curve: what is known of them, and how it is drawn."""

from __future__ import annotations

from bisect import bisect_left, insort
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
        if self.least <= 1:
            return f"{self.most} steps to go, or fewer"
        return f"{self.least} to {self.most} steps to go"

    def joined(self, other: StepsKnown) -> StepsKnown:
        """What both say together."""
        if self.dead or other.dead:
            return self if self.dead else other
        most = min((m for m in (self.most, other.most) if m is not None), default=None)
        return StepsKnown(max(self.least, other.least), most)


class StepsCurve:
    """A curve that becomes finer as more becomes known; `begun` says that it has room in the strip.

    Between two steps of which something is known it is a straight line, fainter.
    """

    def __init__(self) -> None:
        self.begun = False
        self.known: dict[int, StepsKnown] = {}
        self._steps: list[int] = []
        self._changes = 0
        self._surface: pygame.Surface | None = None
        self._drawn: tuple[object, ...] = ()

    def add(self, step: int, known: StepsKnown) -> None:
        """What is known of a step, beside what was known before."""
        before = self.known.get(step)
        if before is None:
            insort(self._steps, step)
        self.known[step] = known if before is None else before.joined(known)
        self._changes += 1

    def seen(self) -> object:
        """What can be seen of it, as a value."""
        return self.begun, self._changes

    def words(self, step: int) -> str:
        """What is known of a step; empty if nothing is."""
        if step in self.known:
            return self.known[step].words
        height = self._between(step)
        return "" if height is None else f"about {round(height[1])} steps to go"

    @property
    def highest(self) -> int:
        """The most steps to go that the curve has."""
        return max((k.most or k.least for k in self.known.values() if not k.dead), default=1) or 1

    def draw(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int, scale: Scale
    ) -> None:
        """The curve over the steps that are shown, its highest at the top."""
        if not self.begun:
            return
        inside = area.inflate(0, -size // 2)
        drawn = (inside.size, scale.first, scale.shown, self._changes)
        if self._surface is None or drawn != self._drawn:
            self._surface, self._drawn = pygame.Surface(inside.size), drawn
            self._surface.fill(mixed(CARD, INK, 0.25))
            self._columns(self._surface, scale)
        target.blit(self._surface, inside)
        small = max(9, size - 4)
        for words, y in ((str(self.highest), inside.top), ("0", inside.bottom - small)):
            number = text.line(words, small, FAINT)
            target.blit(number, number.get_rect(topright=(area.left - 4, y)))
        label = text.line(text.fit("steps to go", small, max(1, area.left - 8)), small, FAINT)
        target.blit(label, label.get_rect(midright=(area.left - 4, inside.centery)))

    def _columns(self, surface: pygame.Surface, scale: Scale) -> None:
        """A column of pixels for each step, or for one of several."""
        (width, height), highest = surface.get_size(), self.highest
        before: int | None = None
        for x in range(width):
            step = int(scale.first + x * scale.shown / width + 0.5)
            known = self.known.get(step)
            if known is not None and known.dead:
                surface.fill(mixed(BAD, INK, 0.35), (x, 0, 1, height))
                before = None
                continue
            ends = self._ends(known) if known is not None else self._between(step)
            if ends is None:
                before = None
                continue
            low, high = (height - round(min(end / highest, 1.0) * height) for end in ends)
            surface.fill(mixed(ACCENT, CARD, 0.75), (x, low, 1, height - low))
            surface.fill(mixed(ACCENT, CARD, 0.5), (x, high, 1, low - high))
            top, bottom = sorted((high, high if before is None else before))
            sure = known is not None and known.most is not None
            colour = ACCENT if sure else mixed(ACCENT, CARD, 0.35)
            surface.fill(colour, (x, min(top, height - 2), 1, max(2, bottom - top)))
            before = high

    @staticmethod
    def _ends(known: StepsKnown) -> tuple[float, float]:
        """How high the proven part is, and the curve."""
        return known.least, known.least if known.most is None else known.most

    def _between(self, step: int) -> tuple[float, float] | None:
        """The same of a step between two of which something is known."""
        place = bisect_left(self._steps, step)
        if not 0 < place < len(self._steps):
            return None
        left, right = self._steps[place - 1], self._steps[place]
        one, other = self.known[left], self.known[right]
        if one.dead or other.dead:
            return None
        share = (step - left) / (right - left)
        low, high = (
            a + (b - a) * share for a, b in zip(self._ends(one), self._ends(other), strict=True)
        )
        return low, high
