"""Colours and proportions of the window."""

from __future__ import annotations

import colorsys
import hashlib

__all__ = [
    "ABSENT",
    "ACCENT",
    "BACKGROUND",
    "BAD",
    "CARD",
    "DONE",
    "FAINT",
    "GOOD",
    "INK",
    "PANEL",
    "PAPER",
    "REASON",
    "REASON_EDGE",
    "SEATS",
    "TEXT",
    "TICKED",
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
BAD: Colour = (244, 132, 120)
DONE: Colour = (46, 125, 60)
TICKED: Colour = (222, 240, 212)
REASON: Colour = (152, 52, 46)
REASON_EDGE: Colour = (206, 74, 62)
ABSENT: Colour = (96, 90, 100)

SEATS: tuple[Colour, ...] = (
    (226, 80, 62),
    (104, 187, 245),
    (199, 217, 58),
    (112, 62, 184),
    (74, 178, 178),
    (240, 236, 228),
    (70, 70, 80),
    (60, 80, 130),
)
"""Told apart under deuteranopia and protanopia, too: they differ in lightness."""


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
