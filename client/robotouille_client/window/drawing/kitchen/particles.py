"""Particles: few small pictures that leave a thing, by a rendering's `effects`.

Where they are is a function of the time in steps, so that a recording looks the same each time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import pygame

from robotouille.domain.rendering.art import Effect
from robotouille_client.window.drawing.kitchen.life import Emission
from robotouille_client.window.drawing.kitchen.spots import Spot
from robotouille_client.window.pictures.sprites import Sprites

__all__ = ["draw_particles", "looks"]

_FRAMES = 12
"""How many looks a particle has on its way: sizes and shades that are drawn once."""

_GOLDEN = 0.618


def draw_particles(
    target: pygame.Surface, sprites: Sprites, emission: Emission, spot: Spot, time: float
) -> None:
    """The particles of an effect at a time in steps."""
    effect = emission.effect
    for number in range(effect.count):
        age = (time / effect.steps + number / effect.count) % 1.0
        size, opacity = _look(effect, round(age * _FRAMES), spot.tile)
        picture = sprites.shade(effect.asset, size, opacity)
        if picture is None:
            continue
        lean = math.sin(math.tau * _GOLDEN * (number + 1 + len(emission.source)))
        x = spot.x + lean * effect.spread * spot.tile * (0.4 + 0.6 * age)
        y = spot.y - (effect.start + effect.rise * age) * spot.tile
        target.blit(picture, (round(x - size / 2), round(y - size / 2)))


def looks(effect: Effect, tile: float) -> Iterator[tuple[int, int]]:
    """Each size and opacity of its particles, on tiles of a size."""
    return (_look(effect, frame, tile) for frame in range(_FRAMES + 1))


def _look(effect: Effect, frame: int, tile: float) -> tuple[int, int]:
    """How large a particle is, and how opaque, after some of its `_FRAMES`."""
    look = frame / _FRAMES
    first, last = effect.size
    return max(2, round((first + (last - first) * look) * tile)), round(255 * (1 - look**2))
