"""The card over a kitchen whose game has not begun: who is here, who is ready, what to press."""

from __future__ import annotations

import pygame

from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.shapes import box, ellipse, tick
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, BAD, GOOD, INK, PAPER, Colour, mixed
from robotouille_client.window.view import LobbyRow, LobbyView

__all__ = ["LobbyCard"]

_QUIET = mixed(INK, PAPER, 0.3)
_READY = mixed(GOOD, INK, 0.4)
_WORDS = {"ready": "ready", "here": "not ready yet", "away": "away", "free": "nobody yet"}


class LobbyCard:
    """Draws it in the middle of the kitchen."""

    def __init__(self, text: Typesetter) -> None:
        self._text = text

    def draw(
        self,
        target: pygame.Surface,
        layout: Layout,
        lobby: LobbyView,
        own: pygame.Rect | None = None,
    ) -> pygame.Rect:
        """The card, beside the `own` player; what must not be covered."""
        text, size = self._text, layout.text
        large, button, pad = round(size * 1.45), round(size * 1.1), size
        line = round(text.height(size) * 1.3)
        inner = max(60, min(layout.panel.left - 2 * pad, size * 30) - 2 * pad)
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
        area = pygame.Rect(0, 0, inner + 2 * pad, high)
        area = _beside(area, layout, own)
        target.blit(box(area.size, (*INK, 120), pad), area.move(0, 5))
        target.blit(box(area.size, PAPER, pad, mixed(PAPER, INK, 0.3)), area)
        y = self._lines(target, title, large, INK, area.centerx, area.y + pad) + pad // 2
        for row in lobby.rows:
            self._row(target, row, size, pygame.Rect(area.x + pad, y, inner, line))
            y += line
        self._lines(target, code, size, INK, area.centerx, y + pad // 2)
        if below:
            self._button(target, below, lobby, button, area)
        return area

    def _lines(
        self, target: pygame.Surface, lines: tuple[str, ...], size: int, ink: Colour, x: int, y: int
    ) -> int:
        """Lines around a middle; where the next would be."""
        for line in lines:
            drawn = self._text.line(line, size, ink)
            target.blit(drawn, drawn.get_rect(midtop=(x, y)))
            y += self._text.height(size)
        return y

    def _row(self, target: pygame.Surface, row: LobbyRow, size: int, area: pygame.Rect) -> None:
        """A seat: its mark, who has it, and how far they are."""
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
        """What to press, at the lower edge; it stands out for as long as it was not."""
        high = len(lines) * self._text.height(size) + size // 2
        area = pygame.Rect(0, 0, card.width - size, high)
        area.midbottom = (card.centerx, card.bottom - size // 2)
        if not lobby.ready:
            target.blit(box(area.size, ACCENT, size // 2, mixed(ACCENT, INK, 0.35)), area)
        ink = _QUIET if lobby.ready else INK
        self._lines(target, lines, size, ink, area.centerx, area.y + size // 4)


def _beside(card: pygame.Rect, layout: Layout, own: pygame.Rect | None) -> pygame.Rect:
    """A card in the middle; if that hides one's own player, where it hides least of them."""
    room = pygame.Rect(0, 0, layout.panel.left, layout.strip.top - 2 * layout.text)
    middle = card.move(room.centerx - card.centerx, layout.kitchen.centery - card.centery)
    aside = room.inflate(-layout.text, -layout.text)
    places = [middle]
    for x in (room.centerx, aside.left + card.width // 2, aside.right - card.width // 2):
        for y in (aside.top + card.height // 2, aside.bottom - card.height // 2):
            places.append(card.move(x - card.centerx, y - card.centery))
    whole = pygame.Rect(0, 0, *layout.size)
    places = [place.clamp(whole) for place in places]
    return min(places, key=lambda place: 0 if own is None else _area(place.clip(own)))


def _area(part: pygame.Rect) -> int:
    return part.width * part.height


def _title(lobby: LobbyView) -> str:
    if lobby.ready is False:
        return "Are you ready?"
    if lobby.ready is None:
        return "The game has not begun"
    return "You are ready. Waiting for the others …"


def _hint(lobby: LobbyView) -> str:
    if lobby.ready is None:
        return ""
    return "Enter: wait, not yet" if lobby.ready else "Press Enter when you are ready"


def _invitation(lobby: LobbyView) -> str:
    free = any(row.state == "free" for row in lobby.rows)
    return f"Others join with the code {lobby.code}" if free and lobby.code else ""
