"""Colours and proportions of the window."""

from __future__ import annotations

import colorsys
import hashlib

__all__ = [
    "ACCENT",
    "BACKGROUND",
    "BAD",
    "CARD",
    "FAINT",
    "GOOD",
    "INK",
    "PANEL",
    "PAPER",
    "SEATS",
    "TEXT",
    "TRACK",
    "Colour",
    "kind_colour",
    "mixed",
]

Colour = tuple[int, int, int]

INK: Colour = (59, 47, 47)
BACKGROUND: Colour = (38, 34, 43)
PANEL: Colour = (46, 41, 52)
CARD: Colour = (59, 53, 66)
TRACK: Colour = (82, 75, 91)
TEXT: Colour = (250, 243, 230)
FAINT: Colour = (178, 168, 186)
PAPER: Colour = (255, 250, 240)
ACCENT: Colour = (255, 196, 84)
GOOD: Colour = (126, 201, 110)
BAD: Colour = (228, 96, 84)

SEATS: tuple[Colour, ...] = (
    (239, 106, 90),
    (79, 147, 217),
    (92, 174, 86),
    (154, 107, 208),
    (232, 168, 56),
    (74, 178, 178),
    (222, 120, 176),
    (150, 140, 120),
)


def kind_colour(kind: str) -> Colour:
    """A colour for a kind without a picture, the same on every machine."""
    digest = hashlib.blake2b(kind.encode(), digest_size=4).digest()
    hue = digest[0] / 256
    red, green, blue = colorsys.hls_to_rgb(hue, 0.62 + digest[1] / 2560, 0.38 + digest[2] / 1280)
    return round(red * 255), round(green * 255), round(blue * 255)


def mixed(one: Colour, other: Colour, share: float) -> Colour:
    """`one` with a `share` of `other` in it."""
    red, green, blue = (round(a + (b - a) * share) for a, b in zip(one, other, strict=True))
    return red, green, blue
