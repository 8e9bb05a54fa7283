"""Particles: few small pictures that leave a thing, by a rendering's `effects`.

Where they are is a function of the time in steps, so that a recording looks the same each time.
"""

from __future__ import annotations

import math

import pygame

from robotouille_client.window.drawing.kitchen.life import Emission
from robotouille_client.window.drawing.kitchen.spots import Spot
from robotouille_client.window.pictures.sprites import Sprites

__all__ = ["draw_particles"]

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
        look = round(age * _FRAMES) / _FRAMES
        first, last = effect.size
        size = max(2, round((first + (last - first) * look) * spot.tile))
        picture = sprites.shade(effect.asset, size, round(255 * (1 - look**2)))
        if picture is None:
            continue
        lean = math.sin(math.tau * _GOLDEN * (number + 1 + len(emission.source)))
        x = spot.x + lean * effect.spread * spot.tile * (0.4 + 0.6 * age)
        y = spot.y - (effect.start + effect.rise * age) * spot.tile
        target.blit(picture, (round(x - size / 2), round(y - size / 2)))
