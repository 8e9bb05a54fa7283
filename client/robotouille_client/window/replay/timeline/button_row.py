"""Buttons of the viewer. Each one does what a key does; its tooltip names the key."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import NamedTuple

import pygame

from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, BAD, CARD, TEXT, TRACK, Colour
from robotouille_client.window.replay.viewer_keys import ViewerKeys

_FINE = 4


class ButtonsLook(NamedTuple):
    """State that the buttons show; `lit` are the keys of those that are on."""

    playing: bool
    live: bool
    lit: frozenset[int]


class _Button(NamedTuple):
    """Button for a key. If room is short, the highest `rank` goes first; `new` starts a group."""

    key: int
    words: str
    rank: int
    new: bool = False


_BUTTONS = (
    _Button(pygame.K_COMMA, "Previous mark (,)", 6),
    _Button(pygame.K_LEFT, "One step back (Left)", 2),
    _Button(pygame.K_SPACE, "Play or pause (Space)", 0),
    _Button(pygame.K_RIGHT, "One step on (Right)", 2),
    _Button(pygame.K_PERIOD, "Next mark (.)", 5),
    _Button(pygame.K_END, "To the end (End)", 9),
    _Button(pygame.K_MINUS, "Slower (-)", 4, new=True),
    _Button(pygame.K_PLUS, "Faster (+)", 3),
    _Button(pygame.K_f, "Follow a player, the next one or nobody (F)", 8, new=True),
    _Button(pygame.K_l, "Log: who did what (L)", 4),
    _Button(pygame.K_g, "Draw the steps to go; again: stop (G)", 7),
    _Button(pygame.K_i, "Start the clip here (I)", 10, new=True),
    _Button(pygame.K_o, "End the clip here (O)", 10),
    _Button(pygame.K_v, "Save the clip as a video; again: stop (V)", 8),
    _Button(pygame.K_p, "Save a picture (P)", 9),
    _Button(pygame.K_h, "Help: keys, colours and signs (H)", 3, new=True),
    _Button(pygame.K_q, "Leave (Esc)", 1),
)


class ButtonRow:
    """Draws as many buttons as fit, and finds the button at a pixel."""

    def __init__(self, keys: ViewerKeys) -> None:
        self._keys = keys
        self._buttons = tuple(button for button in _BUTTONS if keys.has(button.key))
        self._places: dict[int, pygame.Rect] = {}

    def draw(
        self,
        target: pygame.Surface,
        area: pygame.Rect,
        text: Typesetter,
        size: int,
        look: ButtonsLook,
    ) -> int:
        """Draw the buttons from the left of an area, at a text size. Return where they end."""
        shown = self._fitting(area.width, size)
        self._places = {}
        x = area.x + size // 2
        for button in shown:
            x += size // 2 if button.new and button is not shown[0] else 0
            place = pygame.Rect(x, 0, _width(size), _width(size))
            place.centery = area.centery
            self._places[button.key] = place
            lit = button.key in look.lit
            target.blit(box(place.size, TRACK if lit else CARD, size // 4), place)
            ink = ACCENT if lit else TEXT
            if button.key == pygame.K_h:
                sign = text.line("?", size, ink)
            else:
                sign = _sign(button.key, size * 4 // 5, ink, look._replace(lit=frozenset()))
            target.blit(sign, sign.get_rect(center=place.center))
            x = place.right + 2
        return x

    def _fitting(self, room: int, size: int) -> list[_Button]:
        shown = list(self._buttons)
        while len(shown) > 1 and _needed(shown, size) > room:
            shown.remove(max(shown, key=lambda button: button.rank))
        return shown

    def at(self, position: tuple[int, int]) -> int | None:
        """Return the key of the button at a pixel, or None."""
        found = (key for key, place in self._places.items() if place.collidepoint(position))
        return next(found, None)

    def tooltip(self, position: tuple[int, int] | None) -> str:
        """Return what the button at a pixel does."""
        key = None if position is None else self.at(position)
        return next((button.words for button in self._buttons if button.key == key), "")

    def place(self, key: int) -> pygame.Rect | None:
        """Return the area of a key's button, or None if it was not drawn."""
        return self._places.get(key)


def _width(size: int) -> int:
    return size + max(4, size * 2 // 5)


def _needed(buttons: list[_Button], size: int) -> int:
    apart = sum(button.new for button in buttons)
    return len(buttons) * (_width(size) + 2) + apart * (size // 2) + size


# Signs, each drawn in a square


@lru_cache(maxsize=256)
def _sign(key: int, side: int, colour: Colour, look: ButtonsLook) -> pygame.Surface:
    """Return a smooth sign. It is shared: do not draw on it."""
    large = pygame.Surface((side * _FINE, side * _FINE), pygame.SRCALPHA)
    large.fill((*colour, 0))
    if key == pygame.K_SPACE:
        _play(large, large.get_rect(), look)
    else:
        _SIGNS[key](large, large.get_rect(), colour)
    return pygame.transform.smoothscale(large, (side, side))


def _play(target: pygame.Surface, area: pygame.Rect, look: ButtonsLook) -> None:
    """Draw a dot while live, two bars while playing, else a triangle."""
    if look.live:
        pygame.draw.circle(target, BAD, area.center, area.width // 2)
    elif look.playing:
        bar = max(2, area.width // 3)
        for x in (area.x, area.right - bar):
            target.fill(ACCENT, (x, area.y, bar, area.height))
    else:
        _triangle(target, area, ACCENT, 1)


def _triangle(target: pygame.Surface, area: pygame.Rect, colour: Colour, way: int) -> None:
    base, tip = (area.left, area.right - 1) if way > 0 else (area.right - 1, area.left)
    points = [(base, area.top), (base, area.bottom - 1), (tip, area.centery)]
    pygame.draw.polygon(target, colour, points)


def _step(target: pygame.Surface, area: pygame.Rect, colour: Colour, way: int) -> None:
    """Draw a bar, and a triangle pointing away from it."""
    bar = max(2, area.width // 6)
    part = pygame.Rect(0, area.y, area.width - bar - 2, area.height)
    part.x = area.right - part.width if way > 0 else area.x
    _triangle(target, part, colour, way)
    target.fill(colour, (area.x if way > 0 else area.right - bar, area.y, bar, area.height))


def _mark(target: pygame.Surface, area: pygame.Rect, colour: Colour, way: int) -> None:
    """Draw a diamond next to an arrowhead."""
    half = area.width // 2
    x = area.right - half // 2 - 1 if way > 0 else area.x + half // 2
    points = [(x, area.top), (x + half // 2, area.centery), (x, area.bottom - 1)]
    pygame.draw.polygon(target, colour, [*points, (x - half // 2, area.centery)])
    left = area.x if way > 0 else area.right - half
    _triangle(target, pygame.Rect(left, area.y + 1, half - 1, area.height - 2), colour, way)


def _end(target: pygame.Surface, area: pygame.Rect, colour: Colour) -> None:
    bar = max(2, area.width // 6)
    wide = (area.width - bar) // 2
    for x in (area.x, area.x + wide):
        _triangle(target, pygame.Rect(x, area.y, wide, area.height), colour, 1)
    target.fill(colour, (area.right - bar, area.y, bar, area.height))


def _sum(target: pygame.Surface, area: pygame.Rect, colour: Colour, *, plus: bool) -> None:
    bar = max(2, area.width // 6)
    target.fill(colour, (area.x, area.centery - bar // 2, area.width, bar))
    if plus:
        target.fill(colour, (area.centerx - bar // 2, area.y, bar, area.height))


def _follow(target: pygame.Surface, area: pygame.Rect, colour: Colour) -> None:
    """Draw a target: a ring with a dot."""
    pygame.draw.circle(target, colour, area.center, area.width // 2, area.width // 7)
    pygame.draw.circle(target, colour, area.center, area.width // 6)


def _log(target: pygame.Surface, area: pygame.Rect, colour: Colour) -> None:
    line = max(1, area.height // 7)
    for place, share in enumerate((1.0, 0.6, 0.85)):
        y = area.y + place * (area.height - line) // 2
        target.fill(colour, (area.x, y, round(area.width * share), line))


def _curve(target: pygame.Surface, area: pygame.Rect, colour: Colour) -> None:
    """Draw stairs that go down."""
    third = area.width // 3
    for place in range(3):
        high = area.height * (3 - place) // 3
        target.fill(colour, (area.x + place * third, area.bottom - high, third, high))


def _span(target: pygame.Surface, area: pygame.Rect, colour: Colour, way: int) -> None:
    """Draw a bracket that opens inwards."""
    line = max(2, area.width // 6)
    part = pygame.Rect(0, area.y, area.width * 3 // 5, area.height)
    part.centerx = area.centerx
    target.fill(colour, (part.x if way > 0 else part.right - line, part.y, line, part.height))
    for y in (part.y, part.bottom - line):
        target.fill(colour, (part.x, y, part.width, line))


def _video(target: pygame.Surface, area: pygame.Rect, colour: Colour) -> None:
    """Draw a camera: a box with a lens."""
    body = pygame.Rect(area.x, area.y + area.height // 5, area.width * 2 // 3, area.height * 3 // 5)
    pygame.draw.rect(target, colour, body, border_radius=area.width // 6)
    lens = pygame.Rect(body.right - 1, body.y, area.right - body.right, body.height)
    _triangle(target, lens, colour, -1)


def _picture(target: pygame.Surface, area: pygame.Rect, colour: Colour) -> None:
    """Draw a frame with hills."""
    pygame.draw.rect(target, colour, area, max(1, area.width // 8), border_radius=area.width // 6)
    low = area.bottom - area.height // 4
    hill = [(area.x + 2, low), (area.centerx, area.y + area.height // 3), (area.right - 3, low)]
    pygame.draw.polygon(target, colour, hill)


def _leave(target: pygame.Surface, area: pygame.Rect, colour: Colour) -> None:
    line = max(2, area.width // 6)
    pygame.draw.line(target, colour, area.topleft, (area.right - 1, area.bottom - 1), line)
    pygame.draw.line(target, colour, (area.right - 1, area.y), (area.x, area.bottom - 1), line)


_SIGNS: Mapping[int, Callable[[pygame.Surface, pygame.Rect, Colour], None]] = {
    pygame.K_COMMA: lambda target, area, colour: _mark(target, area, colour, -1),
    pygame.K_PERIOD: lambda target, area, colour: _mark(target, area, colour, 1),
    pygame.K_LEFT: lambda target, area, colour: _step(target, area, colour, -1),
    pygame.K_RIGHT: lambda target, area, colour: _step(target, area, colour, 1),
    pygame.K_END: _end,
    pygame.K_MINUS: lambda target, area, colour: _sum(target, area, colour, plus=False),
    pygame.K_PLUS: lambda target, area, colour: _sum(target, area, colour, plus=True),
    pygame.K_f: _follow,
    pygame.K_l: _log,
    pygame.K_g: _curve,
    pygame.K_i: lambda target, area, colour: _span(target, area, colour, 1),
    pygame.K_o: lambda target, area, colour: _span(target, area, colour, -1),
    pygame.K_v: _video,
    pygame.K_p: _picture,
    pygame.K_q: _leave,
}
