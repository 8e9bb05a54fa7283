"""How colours are seen: contrast of text, and the two common kinds of colour blindness."""

from __future__ import annotations

from functools import lru_cache

from robotouille_client.window.pictures.theme import CARD, PAPER, Colour, mixed

__all__ = ["DICHROMACIES", "contrast", "readable", "simulated", "strong_ground", "strong_ink"]

Matrix = tuple[tuple[float, float, float], ...]

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
"""What becomes of linear red, green and blue (Machado, Oliveira and Fernandes 2009, severity 1)."""


_WHITE: Colour = (255, 255, 255)
_BLACK: Colour = (0, 0, 0)
_STRONG_INK, _STRONG_GROUND = 9.0, 7.05
"""Contrasts of text for those who see little of it: 7 is asked for (WCAG 2.2, level AAA); inks have
more, and grounds keep as much of their colour as they may."""
_LIGHT = 0.28
"""The luminance from which on letters are meant for dark grounds."""


def linear(value: float) -> float:
    """An sRGB channel (0 to 255) as light, 0 to 1."""
    share = value / 255
    return share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4


def encoded(light: float) -> int:
    """Light from 0 to 1 as an sRGB channel."""
    light = min(1.0, max(0.0, light))
    share = light * 12.92 if light <= 0.0031308 else 1.055 * light ** (1 / 2.4) - 0.055
    return round(share * 255)


def simulated(colour: Colour, kind: str) -> Colour:
    """A colour as somebody with a kind of DICHROMACIES sees it."""
    light = [linear(value) for value in colour]
    rows = DICHROMACIES[kind]
    red, green, blue = (
        encoded(sum(a * b for a, b in zip(row, light, strict=True))) for row in rows
    )
    return red, green, blue


def contrast(one: Colour, other: Colour) -> float:
    """The contrast ratio of two colours, from 1 to 21 (WCAG 2.2)."""
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


@lru_cache(maxsize=256)
def readable(ink: Colour, ground: Colour, towards: Colour, ratio: float = 4.6) -> Colour:
    """An ink, mixed with as much of another as it needs to be read on a ground."""
    for share in range(21):
        shown = mixed(ink, towards, share / 20)
        if contrast(shown, ground) >= ratio:
            return shown
    return towards


@lru_cache(maxsize=512)
def strong_ink(ink: Colour) -> Colour:
    """An ink with strong contrast: on CARD and darker grounds if it is light, else on PAPER and
    lighter ones."""
    if _luminance(ink) > _LIGHT:
        return readable(ink, CARD, _WHITE, _STRONG_INK)
    return readable(ink, PAPER, _BLACK, _STRONG_INK)


@lru_cache(maxsize=512)
def strong_ground(ground: Colour) -> Colour:
    """A ground for letters of PAPER, so dark that they have strong contrast."""
    return readable(ground, PAPER, _BLACK, _STRONG_GROUND)


def _luminance(colour: Colour) -> float:
    red, green, blue = (linear(value) for value in colour)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue
