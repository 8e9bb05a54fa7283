"""Small smooth shapes, such as rounded boxes, progress rings and seat badges.

Surfaces are cached and shared: never draw on them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator
from functools import wraps
from typing import ParamSpec

import pygame

from robotouille_client.window.pictures.theme import (
    CARD,
    INK,
    PAPER,
    RIM,
    SEATS,
    TEXT,
    Colour,
    mixed,
    readable,
)

MAX_PICTURES = 1500

# Pixels in one cache, at 4 bytes each (128 MiB). One frame needs less.
MAX_PIXELS = 32_000_000

P = ParamSpec("P")


class PictureCache:
    """Pictures by key. The whole cache is cleared when it is full."""

    def __init__(self) -> None:
        self._pictures: dict[Hashable, pygame.Surface] = {}
        self._pixels = 0

    def get(self, key: Hashable) -> pygame.Surface | None:
        """Return a cached picture, or None."""
        return self._pictures.get(key)

    @property
    def roomy(self) -> bool:
        """True while half of the cache is free, so that pictures can be drawn ahead of need."""
        return 2 * len(self._pictures) < MAX_PICTURES and 2 * self._pixels < MAX_PIXELS

    def __iter__(self) -> Iterator[pygame.Surface]:
        return iter(self._pictures.values())

    def keep(self, key: Hashable, picture: pygame.Surface) -> pygame.Surface:
        """Store a picture and return it."""
        pixels = picture.get_width() * picture.get_height()
        # Simpler than tracking use, and rare: one frame needs less than a full cache.
        if len(self._pictures) >= MAX_PICTURES or self._pixels + pixels > MAX_PIXELS:
            self._pictures.clear()
            self._pixels = 0
        self._pictures[key] = picture
        self._pixels += pixels
        return picture


def kept(make: Callable[P, pygame.Surface]) -> Callable[P, pygame.Surface]:
    """Cache what a function draws, by its arguments, in a cache shared with other functions."""

    @wraps(make)
    def remembered(*args: P.args, **kwargs: P.kwargs) -> pygame.Surface:
        key = (make, args, *kwargs.items()) if kwargs else (make, args)
        picture = _shared.get(key)
        return _shared.keep(key, make(*args, **kwargs)) if picture is None else picture

    return remembered


_shared = PictureCache()


RING_STEPS = 48
DIAL_STEPS = 360
_FINE = 4


@kept
def box(
    size: tuple[int, int], fill: tuple[int, ...], radius: int, edge: Colour | None = None
) -> pygame.Surface:
    """Return a box with round corners."""
    width, height = max(1, size[0]), max(1, size[1])
    if radius < 1 and edge is None:
        plain = pygame.Surface((width, height), pygame.SRCALPHA)
        plain.fill(fill)
        return plain
    # Half the factor smooths a large box well enough, at a quarter of the pixels.
    fine = 2 if height > 24 else _FINE
    large = pygame.Surface((width * fine, height * fine), pygame.SRCALPHA)
    radius = min(radius * fine, width * fine // 2, height * fine // 2)
    pygame.draw.rect(large, edge or fill, large.get_rect(), border_radius=radius)
    if edge is not None:
        inner = large.get_rect().inflate(-2 * fine, -2 * fine)
        pygame.draw.rect(large, fill, inner, border_radius=max(0, radius - fine))
    return pygame.transform.smoothscale(large, (width, height))


@kept
def frame(
    size: tuple[int, int], width: int, radius: int, colour: Colour, wash: int
) -> pygame.Surface:
    """Return a coloured line around a box, edged in dark, with a light wash inside."""
    wide, high = size[0] + 2, size[1] + 2
    large = pygame.Surface((wide * _FINE, high * _FINE), pygame.SRCALPHA)
    area, round_ = large.get_rect(), radius * _FINE
    for ink, inset in (((*INK, 255), 0), ((*colour, 255), 1), ((*INK, 150), 1 + width)):
        inner = area.inflate(-2 * inset * _FINE, -2 * inset * _FINE)
        pygame.draw.rect(large, ink, inner, border_radius=max(0, round_ - inset * _FINE))
    inner = area.inflate(-2 * (2 + width) * _FINE, -2 * (2 + width) * _FINE)
    within = max(0, round_ - (2 + width) * _FINE)
    pygame.draw.rect(large, (*colour, wash), inner, border_radius=within)
    return pygame.transform.smoothscale(large, (wide, high))


@kept
def ellipse(size: tuple[int, int], fill: tuple[int, ...]) -> pygame.Surface:
    """Return a smooth ellipse."""
    width, height = max(1, size[0]), max(1, size[1])
    large = pygame.Surface((width * 2, height * 2), pygame.SRCALPHA)
    large.fill((*fill[:3], 0))
    pygame.draw.ellipse(large, fill, large.get_rect())
    return pygame.transform.smoothscale(large, (width, height))


@kept
def pill(
    words: pygame.Surface, fill: tuple[int, ...], edge: Colour | None = None
) -> pygame.Surface:
    """Return words on a box with round ends."""
    width, height = words.get_width() + words.get_height(), words.get_height() + 2
    surface = box((width, height), fill, height // 2, edge).copy()
    surface.blit(words, words.get_rect(center=surface.get_rect().center))
    return surface


@kept
def tick(size: int, colour: Colour) -> pygame.Surface:
    """Return a check mark in a square."""
    side = size * _FINE
    large = pygame.Surface((side, side), pygame.SRCALPHA)
    large.fill((*colour, 0))
    points = [
        (round(x * side), round(y * side)) for x, y in ((0.1, 0.55), (0.4, 0.85), (0.9, 0.18))
    ]
    pygame.draw.lines(large, colour, closed=False, points=points, width=max(1, side // 5))
    return pygame.transform.smoothscale(large, (size, size))


@kept
def ring(size: int, steps: int, colour: Colour, opacity: int = 255) -> pygame.Surface:
    """Return a disc whose rim is filled by `steps` of RING_STEPS, clockwise from the top."""
    large = pygame.Surface((size * _FINE, size * _FINE), pygame.SRCALPHA)
    middle, radius = (size * _FINE // 2, size * _FINE // 2), size * _FINE // 2
    pygame.draw.circle(large, INK, middle, radius)
    pygame.draw.circle(large, RIM, middle, round(radius * 0.93))
    _sector(large, steps / RING_STEPS, colour, 0.93)
    pygame.draw.circle(large, PAPER, middle, round(radius * 0.64))
    surface = pygame.transform.smoothscale(large, (size, size))
    surface.set_alpha(opacity)
    return surface


@kept
def share_disc(size: int, steps: int, colour: Colour, ground: Colour) -> pygame.Surface:
    """Return a small circle that is filled by `steps` of RING_STEPS."""
    size = max(4, size)
    large = pygame.Surface((size * _FINE, size * _FINE), pygame.SRCALPHA)
    large.fill((*ground, 0))
    middle, radius = (size * _FINE // 2, size * _FINE // 2), size * _FINE // 2
    pygame.draw.circle(large, mixed(ground, INK, 0.5), middle, radius)
    pygame.draw.circle(large, ground, middle, round(radius * 0.8))
    _sector(large, min(steps, RING_STEPS) / RING_STEPS, colour, 0.8)
    return pygame.transform.smoothscale(large, (size, size))


@kept
def dial(size: int, steps: int, colour: Colour) -> pygame.Surface:
    """Return a large clock face with `steps` of DIAL_STEPS of its rim left."""
    fine = 2
    large = pygame.Surface((size * fine, size * fine), pygame.SRCALPHA)
    large.fill((*PAPER, 0))
    middle, radius = (size * fine // 2, size * fine // 2), size * fine // 2
    pygame.draw.circle(large, mixed(PAPER, INK, 0.16), middle, radius)
    _sector(large, -steps / DIAL_STEPS, colour, 1.0)
    pygame.draw.circle(large, PAPER, middle, round(radius * 0.78))
    return pygame.transform.smoothscale(large, (size, size))


def _sector(surface: pygame.Surface, turns: float, colour: Colour, reach: float) -> None:
    """Draw a sector from the top: a share of a turn, clockwise if positive."""
    if turns == 0:
        return
    side = surface.get_width()
    middle, radius = (side // 2, side // 2), side // 2 * reach
    count = max(2, round(abs(turns) * 2 * RING_STEPS))
    rim = [
        (
            middle[0] + radius * math.sin(math.tau * turns * i / count),
            middle[1] - radius * math.cos(math.tau * turns * i / count),
        )
        for i in range(count + 1)
    ]
    pygame.draw.polygon(surface, colour, [middle, *rim])


def bar(
    target: pygame.Surface, area: pygame.Rect, share: float, colour: Colour, track: Colour
) -> None:
    """Draw a bar that is filled from the left."""
    radius = area.height // 2
    target.blit(box(area.size, track, radius), area)
    width = round(area.width * min(1.0, max(0.0, share)))
    if width > 0:
        filled = box(area.size, colour, radius)
        target.blit(filled, area, pygame.Rect(0, 0, width, area.height))


@kept
def speech(
    size: tuple[int, int], fill: Colour, edge: Colour, tail: int, drop: int
) -> pygame.Surface:
    """Return a speech bubble with a tail `drop` pixels long, `tail` pixels from the left."""
    width, height = size
    large = pygame.Surface((width * 2, (height + drop) * 2), pygame.SRCALPHA)
    body = pygame.Rect(0, 0, width * 2, height * 2)
    point = [(tail * 2 - drop * 2, height * 2 - 4), (tail * 2 + drop * 2, height * 2 - 4)]
    pygame.draw.rect(large, edge, body, border_radius=18)
    pygame.draw.polygon(large, edge, [*point, (tail * 2, (height + drop) * 2)])
    pygame.draw.rect(large, fill, body.inflate(-5, -5), border_radius=16)
    inner = [(x + (5 if i == 0 else -5), y - 1) for i, (x, y) in enumerate(point)]
    pygame.draw.polygon(large, fill, [*inner, (tail * 2, (height + drop) * 2 - 7)])
    return pygame.transform.smoothscale(large, (width, height + drop))


Corners = tuple[tuple[float, float], ...]


def _regular(corners: int, turn: float = 0.0, dent: float = 1.0, reach: float = 0.46) -> Corners:
    """Return a regular polygon in a unit square; `dent` pushes every other corner in."""
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
# Corners of the badges in a unit square, by name, in the order of the seats. A colour and a
# shape each: either one tells the seats apart.
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


def seat_colour(seat: int) -> Colour:
    """Return the colour of a seat."""
    return SEATS[seat % len(SEATS)]


def seat_fill(seat: int) -> Colour:
    """Return a seat's colour as a ground for PAPER letters."""
    return readable(mixed(seat_colour(seat), INK, 0.2), PAPER, INK)


def seat_ink(seat: int) -> Colour:
    """Return a seat's colour as an ink on PANEL and CARD."""
    return readable(mixed(seat_colour(seat), TEXT, 0.3), CARD, TEXT)


@kept
def badge(seat: int, size: int, fill: Colour | None = None) -> pygame.Surface:
    """Return the badge of a seat in a square."""
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


def star_points(middle: tuple[int, int], radius: float) -> list[tuple[float, float]]:
    """Return the corners of a star with five points."""
    corners = []
    for number in range(10):
        far, angle = radius * (0.45 if number % 2 else 1.0), math.pi * (number / 5 - 0.5)
        corners.append((middle[0] + far * math.cos(angle), middle[1] + far * math.sin(angle)))
    return corners
