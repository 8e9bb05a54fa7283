"""Short movements: a tick that pops up, points that rise from the score or from a station."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass

import pygame

_SECONDS = 0.7
# Largest size of a tick, as a multiple, and the way of rising points, in their heights.
_GROWN, _RISE = 2.0, 1.2


@dataclass(frozen=True, slots=True)
class Pop:
    """Picture that pops up around a point, or that rises from it and fades."""

    picture: pygame.Surface
    middle: tuple[int, int]
    rises: bool = False
    seconds: float = _SECONDS


class Pops:
    """Movements of what appears. What is there at first does not move."""

    def __init__(self) -> None:
        self._seen: set[Hashable] | None = None
        self._began: dict[Hashable, tuple[Pop, float]] = {}

    def follow(self, shown: Mapping[Hashable, Pop], seconds: float | None) -> None:
        """Start a movement for everything that was not shown before.

        In a small window nothing is shown, which changes nothing.
        """
        if not shown and self._seen:
            return
        if seconds is not None and self._seen is not None:
            for key in shown.keys() - self._seen:
                self._began[key] = shown[key], seconds
        self._seen = set(shown)

    def moving(self, seconds: float | None) -> tuple[float, ...]:
        """Return the ages of all movements, which end by themselves."""
        if seconds is None:
            self._began.clear()
            return ()
        for key, (pop, began) in list(self._began.items()):
            if not 0 <= seconds - began < pop.seconds:
                del self._began[key]
        return tuple(seconds - began for _, began in self._began.values())

    def draw(self, target: pygame.Surface, seconds: float | None) -> None:
        """Draw all movements at a time."""
        for (pop, _), age in zip(self._began.values(), self.moving(seconds), strict=False):
            share = age / pop.seconds
            width, height = pop.picture.get_size()
            if pop.rises:
                picture = pop.picture.copy()
                picture.set_alpha(round(255 * (1 - share**2)))
                middle = (pop.middle[0], pop.middle[1] - round(_RISE * height * share))
            else:
                size = 1 + (_GROWN - 1) * math.sin(math.pi * share) * (1 - share)
                picture = pygame.transform.smoothscale(
                    pop.picture, (round(width * size), round(height * size))
                )
                middle = pop.middle
            target.blit(picture, picture.get_rect(center=middle))
