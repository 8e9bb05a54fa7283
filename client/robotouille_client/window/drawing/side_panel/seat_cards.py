"""Seat cards: badge, participant and progress of each seat."""

from __future__ import annotations

from itertools import islice

import pygame

from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.pictures.shapes import badge, box, ellipse, seat_colour
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    BAD,
    CARD,
    FAINT,
    GOOD,
    TEXT,
    Colour,
    mixed,
)
from robotouille_client.window.sources.texts import joined_names
from robotouille_client.window.view import SeatView, View

# Share of a player's picture that is shown, from the top: the part that identifies it.
_FACE = 0.68

# Width of a card, in letter heights, above which more than a name fits.
_WIDE = 13
# Latency above which it is shown: most of a step at the usual five a second.
_SLOW_MS = 150

# Spectators who are named.
_MAX_NAMED = 3


class SeatCards:
    """Draws the seats of a view below each other."""

    def __init__(self, resolver: AppearanceResolver, sprites: Sprites, text: Typesetter) -> None:
        self._resolver = resolver
        self._sprites = sprites
        self._text = text

    def height(self, layout: Layout, count: int) -> int:
        """Return the height of some cards with the room below them."""
        return count * sum(_card_height(layout)) + (0 if layout.compact else layout.text * 3)

    def draw(self, surface: pygame.Surface, area: pygame.Rect, layout: Layout, view: View) -> int:
        """Draw the cards that fit, from the top of an area. Return where they end."""
        size, y = layout.text, area.y
        height, gap = _card_height(layout)
        reserved = 0 if layout.compact else size * 3  # For the chat.
        room = max(1, (area.height - reserved) // (height + gap))
        if len(view.seats) > room > 1:
            room -= 1  # For the line "and 3 more".
        for seat in view.seats[:room]:
            if y + height > area.bottom:
                return y
            card = pygame.Rect(area.x, y, area.width, height)
            self._card(surface, card, seat, layout, view)
            y += height + gap
        if len(view.seats) > room:
            small = max(10, size - 3)
            more = self._text.line(f"and {len(view.seats) - room} more", small, FAINT)
            surface.blit(more, (area.x, y))
            y += self._text.height(small)
        if view.watching:
            y = self._watching(surface, area, y, layout, view)
        return y + size // 3

    def _watching(
        self, surface: pygame.Surface, area: pygame.Rect, y: int, layout: Layout, view: View
    ) -> int:
        """Draw who watches, on at most two lines. Return where that ends."""
        small = max(10, layout.text - 3)
        readable = (name for name in view.spectator_names if self._text.is_readable(name))
        named = islice(readable, _MAX_NAMED)  # Lazily: is_readable is slow.
        names = [self._text.fit(name, small, area.width // 2) for name in named]
        lines: tuple[str, ...] = ()
        for count in range(len(names), -1, -1):
            words = watching_words(names[:count], view.watching)
            lines = self._text.wrap(words, small, area.width)
            if len(lines) <= (1 if layout.compact else 2):
                break
        for line in lines:
            surface.blit(self._text.line(line, small, FAINT), (area.x, y))
            y += self._text.height(small)
        return y

    def _card(
        self, surface: pygame.Surface, card: pygame.Rect, seat: SeatView, layout: Layout, view: View
    ) -> None:
        size, small = layout.text, max(10, round(layout.text * 0.78))
        players = view.world.players
        index = players.index(seat.player) if seat.player in players else 0
        mine = seat.player == view.me
        edge = mixed(seat_colour(index), TEXT, 0.25) if mine else None
        surface.blit(box(card.size, CARD, size // 2, edge), card)
        side = round(size * 1.3)
        mark = badge(index, side, None if seat.connected or seat.substitute else FAINT)
        x = card.x + size // 3
        surface.blit(mark, mark.get_rect(midleft=(x, card.centery)))
        x += side + size // 4
        wide = card.width >= _WIDE * size and not layout.compact
        face = self._face(seat, index, card.height - 4, view) if wide else None
        if face is not None:
            surface.blit(face, face.get_rect(midleft=(x, card.centery)))
            self._lamp(surface, seat, x + face.get_width(), card)
            x += face.get_width() + size // 3
        # Players retry walks and lose races all the time, so only those who watch see the number.
        rejected = seat.rejected if view.me is None else 0
        counts = self._counts(surface, card, seat, rejected, small) if wide else card.right
        bottom = counts if wide and rejected else card.right - size // 2
        if seat.latency_ms >= _SLOW_MS:
            counts = self._latency(surface, card, seat, min(counts, card.right - 6), layout)
        name = (seat.name or seat.player) + (" (you)" if mine else "")
        name = self._text.fit(name, size, counts - x - 6)
        ink = TEXT if seat.connected else FAINT
        words, colour = status(seat, view)
        if layout.compact:
            line = pygame.Rect(x, card.y, counts - size // 2 - x, card.height)
            self._line(surface, line, (name, words), (ink, colour), layout)
            return
        top = card.centery - (self._text.height(size) + self._text.height(small)) // 2 + 1
        surface.blit(self._text.line(name, size, ink), (x, top))
        words = self._text.fit(words, small, bottom - x - 6)
        surface.blit(self._text.line(words, small, colour), (x, top + self._text.height(size)))

    def _line(
        self,
        surface: pygame.Surface,
        line: pygame.Rect,
        words: tuple[str, str],
        inks: tuple[Colour, Colour],
        layout: Layout,
    ) -> None:
        """Draw a name and, if there is room, what holds the player up."""
        size, small = layout.text, max(10, round(layout.text * 0.78))
        drawn = self._text.line(words[0], size, inks[0])
        surface.blit(drawn, drawn.get_rect(midleft=line.midleft))
        x = line.x + drawn.get_width() + size // 2
        room = line.right - x
        if inks[1] != FAINT and room > 3 * size:
            drawn = self._text.line(self._text.fit(words[1], small, room), small, inks[1])
            surface.blit(drawn, drawn.get_rect(midleft=(x, line.centery)))

    def _latency(
        self, surface: pygame.Surface, card: pygame.Rect, seat: SeatView, right: int, layout: Layout
    ) -> int:
        """Draw a participant's latency before `right`. Return its left edge."""
        words = self._text.line(
            latency_words(seat.latency_ms), max(10, round(layout.text * 0.78)), FAINT
        )
        place = words.get_rect(midright=(right - layout.text // 3, card.centery))
        if not layout.compact:
            place.top = card.y + layout.text // 2
        surface.blit(words, place)
        return place.left

    def _lamp(self, surface: pygame.Surface, seat: SeatView, x: int, card: pygame.Rect) -> None:
        light = _light(seat)
        if light is None:
            return
        side = max(6, card.height // 5)
        spot = pygame.Rect(0, 0, side + 4, side + 4)
        spot.bottomright = (x + side // 3, card.bottom - 3)
        surface.blit(ellipse(spot.size, CARD), spot)
        surface.blit(ellipse((side, side), light), spot.move(2, 2))

    def _face(self, seat: SeatView, index: int, side: int, view: View) -> pygame.Surface | None:
        """Return the upper part of a player's picture."""
        if seat.player not in view.world.players:
            return None
        appearance = self._resolver.player(view.world.thing(seat.player).kind, index, "front")
        whole = round(side / _FACE)
        away = not seat.connected and appearance.asset
        picture = (
            self._sprites.faded(appearance.asset, whole) if away
            else self._sprites.of(appearance, whole)
        )  # fmt: skip
        if picture is None:
            return None
        left = round(whole * 0.1)
        return picture.subsurface((left, 0, whole - 2 * left, min(side, whole)))

    def _counts(
        self, surface: pygame.Surface, card: pygame.Rect, seat: SeatView, rejected: int, size: int
    ) -> int:
        """Draw how many actions were applied and rejected. Return their left edge."""
        right = card.right - size // 2
        words = self._text.line(f"{seat.actions} done", size, GOOD)
        place = words.get_rect(topright=(right, card.y + size // 2))
        surface.blit(words, place)
        if not rejected:
            return place.left
        words = self._text.line(f"{rejected} rejected", size, BAD)
        below = words.get_rect(topright=(right, place.bottom + 3))
        surface.blit(words, below)
        return min(place.left, below.left)


def status(seat: SeatView, view: View) -> tuple[str, Colour]:
    """Return who moves a player, or what holds it up, with a colour."""
    if seat.substitute or not seat.connected:
        return seat.moved_by, mixed(_light(seat) or FAINT, TEXT, 0.3)
    names = {one.player: one.name or one.player for one in view.seats}
    for waiting, station, blocking in view.blocked:
        if seat.player == waiting and blocking != waiting:
            return f"waiting for {'you' if blocking == view.me else names[blocking]}", ACCENT
        if seat.player == blocking != waiting:
            return _delay(blocking, waiting, station, view), ACCENT
    if seat.player in view.waits_for:
        return "your turn" if seat.player == view.me else _deciding(seat), ACCENT
    if seat.player in view.thinking:
        return "thinking", ACCENT
    words = seat.moved_by if seat.name == seat.player else f"{seat.player} · {seat.moved_by}"
    return words, FAINT


def _delay(blocking: str, waiting: str, station: str, view: View) -> str:
    """Return how a player holds another one up, or what the local player can do about it."""
    name = next((seat.name for seat in view.seats if seat.player == waiting), "") or waiting
    if blocking == view.me:
        return f"step aside for {name}" if station else f"do what {name} asks"
    if waiting == view.me:
        return "in your way" if station else "keeps you waiting"
    return f"in {name}'s way" if station else f"keeps {name} waiting"


def _card_height(layout: Layout) -> tuple[int, int]:
    return round(layout.text * (1.7 if layout.compact else 2.8)), max(4, layout.text // 3)


def watching_words(names: list[str], count: int) -> str:
    """Return who watches, some by name, such as `Ada, Ben and 4 more are watching`."""
    if not names:
        return f"{count} watching"
    shown = [*names, f"{count - len(names)} more"] if count > len(names) else names
    return f"{joined_names(shown)} {'is' if count == 1 else 'are'} watching"


def latency_words(milliseconds: int) -> str:
    """Return a latency as `250 ms` or `1.5 s`."""
    return f"{milliseconds} ms" if milliseconds < 1000 else f"{milliseconds / 1000:.1f} s"


def _deciding(seat: SeatView) -> str:
    return "deciding" if seat.kind == "human" else "thinking"


def _light(seat: SeatView) -> Colour | None:
    """Return green for a present participant, amber for a substitute, red for an absent one."""
    if seat.substitute:
        return ACCENT
    if seat.connected:
        return GOOD
    return BAD if seat.name else None
