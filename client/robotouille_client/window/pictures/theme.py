"""Colours of the window, and their contrast."""

from __future__ import annotations

import colorsys
import hashlib
from functools import lru_cache

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
RIM: Colour = (104, 92, 92)

# Seat colours. They differ in lightness, which deuteranopia and protanopia leave intact.
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


def kind_colour(kind: str) -> Colour:
    """Return a colour for a kind without a picture, the same on every machine."""
    # Python's own hash of a string differs from process to process.
    digest = hashlib.blake2b(kind.encode(), digest_size=4).digest()
    hue = digest[0] / 256
    red, green, blue = colorsys.hls_to_rgb(hue, 0.62 + digest[1] / 2560, 0.38 + digest[2] / 1280)
    return round(red * 255), round(green * 255), round(blue * 255)


def mixed(one: Colour, other: Colour, share: float) -> Colour:
    """Return `one` with a `share` of `other` in it."""
    red, green, blue = (round(a + (b - a) * share) for a, b in zip(one, other, strict=True))
    return red, green, blue


Matrix = tuple[tuple[float, float, float], ...]

# Matrices for linear red, green and blue (Machado, Oliveira and Fernandes 2009, severity 1).
DICHROMACIES: dict[str, Matrix] = {
    "deuteranopia": (
        (0.367322, 0.860646, -0.227968),
        (0.280085, 0.672501, 0.047413),
        (-0.011820, 0.042940, 0.968881),
    ),
    "protanopia": (
        (0.152286, 1.052583, -0.204868),
        (0.114503, 0.786281, 0.099216),
        (-0.003882, -0.048116, 1.051998),
    ),
}


_WHITE: Colour = (255, 255, 255)
_BLACK: Colour = (0, 0, 0)
# Contrasts of text in the strong setting. WCAG 2.2, level AAA, asks for 7.  Inks get more;
# grounds keep as much of their colour as possible.
_STRONG_INK, _STRONG_GROUND = 9.0, 7.05
# Luminance above which an ink is meant for dark grounds.
_LIGHT = 0.28


def linear(value: float) -> float:
    """Return an sRGB channel (0 to 255) as linear light (0 to 1)."""
    share = value / 255
    return share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4


def encoded(light: float) -> int:
    """Return linear light (0 to 1) as an sRGB channel."""
    light = min(1.0, max(0.0, light))
    share = light * 12.92 if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055
    return round(share * 255)


def simulated(colour: Colour, kind: str) -> Colour:
    """Return a colour as a person with one of DICHROMACIES sees it."""
    light = [linear(value) for value in colour]
    rows = DICHROMACIES[kind]
    red, green, blue = (
        encoded(sum(a * b for a, b in zip(row, light, strict=True))) for row in rows
    )
    return red, green, blue


def contrast(one: Colour, other: Colour) -> float:
    """Return the contrast ratio of two colours, from 1 to 21 (WCAG 2.2)."""
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


@lru_cache(maxsize=256)
def readable(ink: Colour, ground: Colour, towards: Colour, ratio: float = 4.6) -> Colour:
    """Mix an ink with another colour until it can be read on a ground."""
    for share in range(21):
        shown = mixed(ink, towards, share / 20)
        if contrast(shown, ground) >= ratio:
            return shown
    return towards


@lru_cache(maxsize=512)
def strong_ink(ink: Colour) -> Colour:
    """Return an ink with strong contrast: light ones on CARD, dark ones on PAPER."""
    if _luminance(ink) > _LIGHT:
        return readable(ink, CARD, _WHITE, _STRONG_INK)
    return readable(ink, PAPER, _BLACK, _STRONG_INK)


@lru_cache(maxsize=512)
def strong_ground(ground: Colour) -> Colour:
    """Return a ground dark enough for PAPER letters with strong contrast."""
    return readable(ground, PAPER, _BLACK, _STRONG_GROUND)


def _luminance(colour: Colour) -> float:
    red, green, blue = (linear(value) for value in colour)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue
