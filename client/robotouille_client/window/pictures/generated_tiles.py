"""Tiles for kinds that have no picture: a shape for the role, a colour and the kind's name."""

from __future__ import annotations

import pygame

from robotouille_client.window.pictures.appearance import Appearance
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import INK, PAPER, Colour, kind_colour, mixed

__all__ = ["generate"]

_FINE = 3
_EYES = {"front": 0.0, "left": -0.1, "right": 0.1}


def generate(appearance: Appearance, size: int, text: Typesetter) -> pygame.Surface:
    """A square tile for a thing; drawn large first, so that its edges are smooth."""
    large = pygame.Surface((size * _FINE, size * _FINE), pygame.SRCALPHA)
    colour = kind_colour(appearance.kind)
    if appearance.role == "station":
        _bench(large, colour)
    elif appearance.role == "player":
        _figure(large, colour, appearance.facing)
    else:
        _block(large, colour, round_top=appearance.role == "container")
    tile = pygame.transform.smoothscale(large, (size, size))
    _label(tile, appearance, text)
    return tile


def _box(surface: pygame.Surface, x: float, y: float, w: float, h: float) -> pygame.Rect:
    side = surface.get_width()
    return pygame.Rect(round(x * side), round(y * side), round(w * side), round(h * side))


def _outlined(surface: pygame.Surface, box: pygame.Rect, fill: Colour, radius: float) -> None:
    side = surface.get_width()
    pygame.draw.rect(surface, fill, box, border_radius=round(radius * side))
    pygame.draw.rect(
        surface, INK, box, width=max(1, round(0.03 * side)), border_radius=round(radius * side)
    )


def _bench(surface: pygame.Surface, colour: Colour) -> None:
    front = _box(surface, 0.01, 0.1, 0.98, 0.89)
    _outlined(surface, front, mixed(colour, INK, 0.35), 0.05)
    _outlined(surface, _box(surface, 0.01, 0.01, 0.98, 0.74), mixed(colour, PAPER, 0.25), 0.05)
    shine = _box(surface, 0.07, 0.06, 0.86, 0.05)
    pygame.draw.rect(surface, mixed(colour, PAPER, 0.6), shine, border_radius=shine.height // 2)


def _block(surface: pygame.Surface, colour: Colour, *, round_top: bool) -> None:
    _outlined(surface, _box(surface, 0.08, 0.18, 0.84, 0.68), colour, 0.3 if round_top else 0.14)
    shine = _box(surface, 0.2, 0.26, 0.6, 0.06)
    pygame.draw.rect(surface, mixed(colour, PAPER, 0.6), shine, border_radius=shine.height // 2)


def _figure(surface: pygame.Surface, colour: Colour, facing: str) -> None:
    _outlined(surface, _box(surface, 0.3, 0.5, 0.4, 0.44), mixed(colour, INK, 0.25), 0.14)
    _outlined(surface, _box(surface, 0.24, 0.1, 0.52, 0.5), colour, 0.25)
    if facing == "back":
        return
    shift = _EYES.get(facing, 0.0)
    for x in (0.36, 0.54):
        eye = _box(surface, x + shift, 0.28, 0.1, 0.14)
        pygame.draw.ellipse(surface, PAPER, eye)
        pygame.draw.ellipse(surface, INK, eye.inflate(-eye.width // 2, -eye.height // 2))


def _label(tile: pygame.Surface, appearance: Appearance, text: Typesetter) -> None:
    side = tile.get_width()
    lines = [appearance.kind, *appearance.words.split()[:2]]
    middle = {"station": 0.86, "player": 0.76}.get(appearance.role, 0.52)
    height = max(7, min(13, side // 5 if len(lines) == 1 else side // 6))
    if appearance.role == "station":
        height = max(7, min(height, round(side * 0.2 / len(lines))))
    total = (len(lines) - 1) * height
    for i, line in enumerate(lines):
        size = height
        while size > 7 and text.width(line, size) > side * 0.86:
            size -= 1
        colour = PAPER if appearance.role == "station" else INK
        words = text.line(text.fit(line, size, round(side * 0.96)), size, colour)
        y = side * middle - total / 2 + i * height
        tile.blit(words, words.get_rect(center=(side // 2, round(y))))
