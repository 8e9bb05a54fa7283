"""Perceived colour differences."""

from __future__ import annotations

import math

from robotouille_client.window.pictures.theme import Colour, linear

__all__ = ["colour_distance"]


def colour_distance(one: Colour, other: Colour) -> float:
    """Return the perceptual distance of two colours: their distance in CIELAB (D65)."""
    return math.dist(_lab(one), _lab(other))


def _lab(colour: Colour) -> tuple[float, float, float]:
    red, green, blue = (linear(value) for value in colour)
    x = (0.4124 * red + 0.3576 * green + 0.1805 * blue) / 0.95047
    y = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    z = (0.0193 * red + 0.1192 * green + 0.9505 * blue) / 1.08883
    x, y, z = (t ** (1 / 3) if t > 0.008856 else 7.787 * t + 16 / 116 for t in (x, y, z))
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)
