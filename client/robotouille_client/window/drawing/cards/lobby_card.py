"""Card over a kitchen before its game: who is here, who is ready and what to press."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import pygame

from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.shapes import box, ellipse, tick
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, BAD, GOOD, INK, PAPER, Colour, mixed
from robotouille_client.window.view import LobbyRow, LobbyView

_QUIET = mixed(INK, PAPER, 0.3)
_READY = mixed(GOOD, INK, 0.4)
# Widths of the card in letters. The first that covers least is taken.
_WIDTHS = (30, 22, 17)
# Places that are tried along each edge of the kitchen.
_TRIED = 12
# Lines of chat that stay free below the card.
_CHAT_LINES = 6
_WORDS = {"ready": "ready", "here": "not ready yet", "away": "away", "free": "free seat"}


@dataclass(frozen=True, slots=True)
class Ground:
    """Areas that a card may cover: stations first, then objects in use, then players.

    `own` is the local player, which is covered last. `free` is the part of the panel with nothing
    but chat.
    """

    own: pygame.Rect | None = None
    players: Sequence[pygame.Rect] = ()
    used: Sequence[pygame.Rect] = ()
    stations: Sequence[pygame.Rect] = ()
    free: pygame.Rect | None = None

    def covered(self, card: pygame.Rect) -> tuple[int, int, int, int]:
        """Return the covered pixels of each kind, the most important first."""
        own = () if self.own is None else (self.own,)
        return (
            _overlap(card, own),
            _overlap(card, self.players),
            _overlap(card, self.used),
            _overlap(card, self.stations),
        )


@dataclass(frozen=True, slots=True)
class _Shape:
    """Lines and size of the card at one width."""

    title: tuple[str, ...]
    code: tuple[str, ...]
    below: tuple[str, ...]
    size: tuple[int, int]


class LobbyCard:
    """Draws the card over the kitchen or next to it, where it covers least."""

    def __init__(self, text: Typesetter) -> None:
        self._text = text

    def draw(
        self, target: pygame.Surface, layout: Layout, lobby: LobbyView, ground: Ground
    ) -> pygame.Rect:
        """Draw the card. Return the area that labels must not cover."""
        size = layout.text
        large, button, pad, line = self._sizes(layout)
        shape, area = self._place(layout, lobby, ground)
        target.blit(box(area.size, (*INK, 120), pad), area.move(0, 5))
        target.blit(box(area.size, PAPER, pad, mixed(PAPER, INK, 0.3)), area)
        y = self._lines(target, shape.title, large, INK, area.centerx, area.y + pad) + pad // 2
        for row in lobby.rows:
            place = pygame.Rect(area.x + pad, y, area.width - 2 * pad, line)
            self._row(target, row, size, place)
            y += line
        self._lines(target, shape.code, size, INK, area.centerx, y + pad // 2)
        if shape.below:
            self._button(target, shape.below, lobby, button, area)
        return area

    def _sizes(self, layout: Layout) -> tuple[int, int, int, int]:
        """Return the letters of the title and the button, the margin and the height of a row."""
        size = layout.text
        return round(size * 1.45), round(size * 1.1), size, round(self._text.height(size) * 1.3)

    def _shape(self, layout: Layout, lobby: LobbyView, width: int) -> _Shape:
        text, size = self._text, layout.text
        large, button, pad, line = self._sizes(layout)
        inner = max(60, width - 2 * pad)
        title = text.wrap(_title(lobby), large, inner, 2)
        below = text.wrap(_hint(lobby), button, inner - pad, 2)
        code = text.wrap(_invitation(lobby), size, inner, 2)
        high = (
            2 * pad
            + len(title) * text.height(large)
            + len(lobby.rows) * line
            + (len(code) * text.height(size) + pad // 2 if code else 0)
            + (len(below) * text.height(button) + pad if below else 0)
            + pad // 2
        )
        return _Shape(title, code, below, (inner + 2 * pad, high))

    def _place(
        self, layout: Layout, lobby: LobbyView, ground: Ground
    ) -> tuple[_Shape, pygame.Rect]:
        """Place the card where it covers nothing, else in the panel, else where it covers least."""
        size, most = layout.text, layout.panel.left - 2 * layout.text
        shapes = [self._shape(layout, lobby, min(most, size * wide)) for wide in _WIDTHS]
        found = [(shape, _least(shape.size, layout, ground)) for shape in shapes]
        best = min(found, key=lambda one: ground.covered(one[1]))
        # A narrow card in the panel is better than one that hides players.
        if any(ground.covered(best[1])) and ground.free is not None:
            narrow = self._shape(layout, lobby, ground.free.width - size)
            area = pygame.Rect(0, 0, *narrow.size)
            area.midtop = ground.free.centerx, ground.free.top + size // 2
            if ground.free.bottom - area.bottom >= _CHAT_LINES * size and area.w <= ground.free.w:
                return narrow, area
        return best

    def _lines(
        self, target: pygame.Surface, lines: tuple[str, ...], size: int, ink: Colour, x: int, y: int
    ) -> int:
        """Draw centred lines. Return the top of the next one."""
        for line in lines:
            drawn = self._text.line(line, size, ink)
            target.blit(drawn, drawn.get_rect(midtop=(x, y)))
            y += self._text.height(size)
        return y

    def _row(self, target: pygame.Surface, row: LobbyRow, size: int, area: pygame.Rect) -> None:
        """Draw a seat: its mark, who has it, and whether they are ready."""
        side = max(8, area.height * 2 // 3)
        mark = pygame.Rect(0, 0, side, side)
        mark.midleft = area.midleft
        if row.state == "ready":
            target.blit(ellipse(mark.size, _READY), mark)
            sign = tick(side * 2 // 3, PAPER)
            target.blit(sign, sign.get_rect(center=mark.center))
        else:
            colour = BAD if row.state == "away" else _QUIET
            target.blit(ellipse(mark.size, colour), mark)
            hole = mark.inflate(-max(2, side // 4), -max(2, side // 4))
            target.blit(ellipse(hole.size, PAPER), hole)
        words = _WORDS[row.state]
        drawn = self._text.line(words, size, INK if row.state == "ready" else _QUIET)
        target.blit(drawn, drawn.get_rect(midright=area.midright))
        room = area.width - side - drawn.get_width() - 2 * size
        name = self._text.fit(row.name, size, max(20, room))
        ink = _QUIET if row.state == "free" else INK
        drawn = self._text.line(name, size, ink)
        target.blit(drawn, drawn.get_rect(midleft=(mark.right + size // 2, area.centery)))

    def _button(
        self,
        target: pygame.Surface,
        lines: tuple[str, ...],
        lobby: LobbyView,
        size: int,
        card: pygame.Rect,
    ) -> None:
        """Draw what to press at the lower edge. It stands out until the player is ready."""
        high = len(lines) * self._text.height(size) + size // 2
        area = pygame.Rect(0, 0, card.width - size, high)
        area.midbottom = (card.centerx, card.bottom - size // 2)
        if not lobby.ready:
            target.blit(box(area.size, ACCENT, size // 2, mixed(ACCENT, INK, 0.35)), area)
        ink = _QUIET if lobby.ready else INK
        self._lines(target, lines, size, ink, area.centerx, area.y + size // 4)


def _least(size: tuple[int, int], layout: Layout, ground: Ground) -> pygame.Rect:
    """Return the place that covers least; among equal ones, the nearest to the middle."""
    room = pygame.Rect(0, 0, layout.panel.left, layout.strip.top - 2 * layout.text)
    aside = room.inflate(-layout.text, -layout.text)
    middle = (room.centerx, layout.kitchen.centery)
    whole = pygame.Rect(0, 0, *layout.size)
    places = [pygame.Rect(middle[0] - size[0] // 2, middle[1] - size[1] // 2, *size)]
    across, down = max(0, aside.width - size[0]), max(0, aside.height - size[1])
    places += [
        pygame.Rect(aside.left + across * x // _TRIED, aside.top + down * y // _TRIED, *size)
        for x in range(_TRIED + 1)
        for y in range(_TRIED + 1)
    ]
    places = [place.clamp(whole) for place in places]
    places.sort(key=lambda place: math.dist(place.center, middle))
    # Most often a place near the middle covers nothing, and the others need not be measured.
    best, least = places[0], ground.covered(places[0])
    for place in places[1:]:
        if not any(least):
            break
        covered = ground.covered(place)
        if covered < least:
            best, least = place, covered
    return best


def _overlap(place: pygame.Rect, others: Sequence[pygame.Rect]) -> int:
    area = 0
    for number in place.collidelistall(others):
        part = place.clip(others[number])
        area += part.width * part.height
    return area


def _title(lobby: LobbyView) -> str:
    if lobby.ready is False:
        return "Are you ready?"
    if lobby.ready is None:
        return "The game has not started yet"
    return "You are ready. Waiting for the others …"


def _hint(lobby: LobbyView) -> str:
    if lobby.ready is None:
        return ""
    return "Press Enter if you need more time" if lobby.ready else "Press Enter when you are ready"


def _invitation(lobby: LobbyView) -> str:
    free = any(row.state == "free" for row in lobby.rows)
    return f"Friends can join with the code {lobby.code}" if free and lobby.code else ""
