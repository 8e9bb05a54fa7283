"""The badges of the seats: a colour and a shape each, so that either tells them apart."""

from __future__ import annotations

import math

import pygame

from robotouille_client.window.pictures.colour_vision import readable
from robotouille_client.window.pictures.kept import kept
from robotouille_client.window.pictures.theme import CARD, INK, PAPER, SEATS, TEXT, Colour, mixed

__all__ = ["SHAPES", "badge", "seat_colour", "seat_fill", "seat_ink"]

_FINE = 4
Corners = tuple[tuple[float, float], ...]


def _regular(corners: int, turn: float = 0.0, dent: float = 1.0, reach: float = 0.46) -> Corners:
    """A polygon around the middle of a unit square; every other corner is pushed in by `dent`."""
    count = corners if dent == 1.0 else corners * 2
    return tuple(
        (
            0.5 + reach * (dent if i % 2 and dent != 1.0 else 1.0) * math.sin(math.tau * part),
            0.5 - reach * (dent if i % 2 and dent != 1.0 else 1.0) * math.cos(math.tau * part),
        )
        for i in range(count)
        for part in [i / count + turn]
    )


_ARM = (0.08, 0.35, 0.65, 0.92)
SHAPES: dict[str, Corners] = {
    "circle": _regular(40),
    "square": _regular(4, 0.125, reach=0.56),
    "triangle": tuple((x, y + 0.1) for x, y in _regular(3, reach=0.54)),
    "star": tuple((x, y + 0.03) for x, y in _regular(5, dent=0.48, reach=0.52)),
    "diamond": ((0.5, 0.0), (0.86, 0.5), (0.5, 1.0), (0.14, 0.5)),
    "cross": tuple(
        (_ARM[x], _ARM[y])
        for x, y in (
            *((1, 0), (2, 0), (2, 1), (3, 1), (3, 2), (2, 2)),
            *((2, 3), (1, 3), (1, 2), (0, 2), (0, 1), (1, 1)),
        )
    ),
    "hourglass": ((0.08, 0.06), (0.92, 0.06), (0.62, 0.5), (0.92, 0.94), (0.08, 0.94), (0.38, 0.5)),
    "arrow": (
        *((0.08, 0.3), (0.5, 0.3), (0.5, 0.05), (0.95, 0.5)),
        *((0.5, 0.95), (0.5, 0.7), (0.08, 0.7)),
    ),
}  # fmt: skip
"""Corners in a unit square, by name, in the order of the seats."""


def seat_colour(seat: int) -> Colour:
    """The colour of a seat."""
    return SEATS[seat % len(SEATS)]


def seat_fill(seat: int) -> Colour:
    """It as a ground for PAPER letters."""
    return readable(mixed(seat_colour(seat), INK, 0.2), PAPER, INK)


def seat_ink(seat: int) -> Colour:
    """It as an ink on PANEL and CARD."""
    return readable(mixed(seat_colour(seat), TEXT, 0.3), CARD, TEXT)


@kept
def badge(seat: int, size: int, fill: Colour | None = None) -> pygame.Surface:
    """The badge of a seat in a square; do not draw on it, it is shared."""
    colour = seat_colour(seat) if fill is None else fill
    corners = list(SHAPES.values())[seat % len(SHAPES)]
    side = max(1, size) * _FINE
    large = pygame.Surface((side, side), pygame.SRCALPHA)
    large.fill((*INK, 0))
    for scale, ink in ((1.0, INK), (0.84, PAPER), (0.64, colour)):
        points = [
            ((0.5 + (x - 0.5) * scale) * side, (0.5 + (y - 0.5) * scale) * side) for x, y in corners
        ]
        pygame.draw.polygon(large, ink, points)
    return pygame.transform.smoothscale(large, (max(1, size), max(1, size)))
