"""Small smooth shapes: rounded boxes, rings of progress, shadows."""

from __future__ import annotations

import math

import pygame

from robotouille_client.window.pictures.kept import kept
from robotouille_client.window.pictures.theme import INK, PAPER, Colour, mixed

__all__ = [
    "DIAL_STEPS",
    "RING_STEPS",
    "bar",
    "box",
    "dial",
    "ellipse",
    "frame",
    "pill",
    "ring",
    "share_disc",
    "speech",
    "tick",
]

RING_STEPS = 48
DIAL_STEPS = 360
_FINE = 4
_RIM: Colour = (104, 92, 92)


@kept
def box(
    size: tuple[int, int], fill: tuple[int, ...], radius: int, edge: Colour | None = None
) -> pygame.Surface:
    """A box with round corners; do not draw on it, it is shared."""
    width, height = max(1, size[0]), max(1, size[1])
    if radius < 1 and edge is None:
        plain = pygame.Surface((width, height), pygame.SRCALPHA)
        plain.fill(fill)
        return plain
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
    """A line round a box, with a thin dark one on either side, and a wash of its colour within."""
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
    """A smooth ellipse; do not draw on it, it is shared."""
    width, height = max(1, size[0]), max(1, size[1])
    large = pygame.Surface((width * 2, height * 2), pygame.SRCALPHA)
    large.fill((*fill[:3], 0))
    pygame.draw.ellipse(large, fill, large.get_rect())
    return pygame.transform.smoothscale(large, (width, height))


@kept
def pill(
    words: pygame.Surface, fill: tuple[int, ...], edge: Colour | None = None
) -> pygame.Surface:
    """Words on a box with round ends; do not draw on it, it is shared."""
    width, height = words.get_width() + words.get_height(), words.get_height() + 2
    surface = box((width, height), fill, height // 2, edge).copy()
    surface.blit(words, words.get_rect(center=surface.get_rect().center))
    return surface


@kept
def tick(size: int, colour: Colour) -> pygame.Surface:
    """A check mark in a square; do not draw on it, it is shared."""
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
    """A disc with `steps` of RING_STEPS of its rim filled, clockwise from the top."""
    large = pygame.Surface((size * _FINE, size * _FINE), pygame.SRCALPHA)
    middle, radius = (size * _FINE // 2, size * _FINE // 2), size * _FINE // 2
    pygame.draw.circle(large, INK, middle, radius)
    pygame.draw.circle(large, _RIM, middle, round(radius * 0.93))
    _sector(large, steps / RING_STEPS, colour, 0.93)
    pygame.draw.circle(large, PAPER, middle, round(radius * 0.64))
    surface = pygame.transform.smoothscale(large, (size, size))
    surface.set_alpha(opacity)
    return surface


@kept
def share_disc(size: int, steps: int, colour: Colour, ground: Colour) -> pygame.Surface:
    """A small circle of which `steps` of RING_STEPS are filled; do not draw on it."""
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
    """A large clock face with `steps` of DIAL_STEPS of its rim left to go."""
    fine = 2
    large = pygame.Surface((size * fine, size * fine), pygame.SRCALPHA)
    large.fill((*PAPER, 0))
    middle, radius = (size * fine // 2, size * fine // 2), size * fine // 2
    pygame.draw.circle(large, mixed(PAPER, INK, 0.16), middle, radius)
    _sector(large, -steps / DIAL_STEPS, colour, 1.0)
    pygame.draw.circle(large, PAPER, middle, round(radius * 0.78))
    return pygame.transform.smoothscale(large, (size, size))


def _sector(surface: pygame.Surface, turns: float, colour: Colour, reach: float) -> None:
    """A sector from the top on: a share of a turn clockwise, or backwards if it is negative."""
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
    """A bar that is filled from the left."""
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
    """A speech bubble whose tail points down by `drop` pixels, `tail` pixels from the left."""
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
