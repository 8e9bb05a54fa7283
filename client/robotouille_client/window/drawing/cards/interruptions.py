"""Layers over the kitchen: lobby card, pauses, lost connections, lessons, outcome, help."""

from __future__ import annotations

from dataclasses import replace
from math import ceil

import pygame

from robotouille.domain.rendering import RenderingFile
from robotouille_client.window.drawing.cards.lobby_card import Ground, LobbyCard
from robotouille_client.window.drawing.window_layout import KeyRows, Layout, UiOverlay
from robotouille_client.window.pictures.shapes import DIAL_STEPS, box, dial, ellipse
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    BAD,
    FAINT,
    INK,
    PANEL,
    PAPER,
    TEXT,
    Colour,
    mixed,
)
from robotouille_client.window.view import FarewellView, PauseView, View

_SHADE = (*PANEL, 165)
_STALE = (*PANEL, 90)
# Seconds after which the length of a lost connection is shown.
_PATIENCE = 3.0
# Seconds after which the way out is shown.
_LONG = 20.0
# Fewest lines that a lesson reserves.
_LESSON_LINES = 2
# Smallest letters of the help, in pixels.
MIN_HELP = 7


class Interruptions:
    """Draws over the kitchen. Only the card before a game may also cover part of the panel."""

    def __init__(self, text: Typesetter) -> None:
        self._text = text
        self._lobby_card = LobbyCard(text)

    def draw(
        self, target: pygame.Surface, layout: Layout, view: View, ground: Ground = Ground()
    ) -> list[pygame.Rect]:
        """Draw the interruptions of a view. Return the areas that labels must not cover."""
        shown = []
        if view.lobby is not None and view.starts_in is None and not view.frozen:
            shown.append(self._lobby_card.draw(target, layout, view.lobby, ground))
        # Only the lobby card may cover the panel.
        target.set_clip((0, 0, layout.panel.left, layout.size[1]))
        shown += self._over_the_kitchen(target, layout, view)
        target.set_clip(None)
        return shown

    def _over_the_kitchen(
        self, target: pygame.Surface, layout: Layout, view: View
    ) -> list[pygame.Rect]:
        shown = []
        if view.farewell is not None:
            self._shade(target, layout, _SHADE)
            shown.append(self._farewell(target, layout, view.farewell))
        elif view.pause is not None:
            self._shade(target, layout, _SHADE)
            shown.append(self._pause(target, layout, view.pause))
        elif view.offline is not None:
            self._shade(target, layout, _STALE)
        y = _top(layout)
        if view.offline is not None and view.farewell is None:
            fill = self._text.ground(mixed(BAD, INK, 0.6))
            shown.append(self._banner(target, layout, y, _lost(view.offline), fill, PAPER))
            y = shown[-1].bottom + layout.text * 2 // 3
        if view.starts_in is not None:
            shown.append(self._countdown(target, layout, ceil(view.starts_in)))
        for words in (view.lesson, view.notice):
            if words:
                shown.append(self._banner(target, layout, y, words, ACCENT, INK))
                y = shown[-1].bottom + layout.text * 2 // 3
        return shown

    def _shade(self, target: pygame.Surface, layout: Layout, colour: tuple[int, ...]) -> None:
        target.blit(box((layout.panel.left, layout.size[1]), colour, 0), (0, 0))

    def _banner(
        self, target: pygame.Surface, layout: Layout, y: int, words: str, fill: Colour, ink: Colour
    ) -> pygame.Rect:
        """Draw words at the top, in as many lines as they need."""
        size, pad = _banner_text(layout), layout.text * 2 // 3
        lines = self._banner_lines(layout, words)
        step = self._text.height(size)
        width = max((self._text.width(line, size) for line in lines), default=0) + 3 * pad
        area = pygame.Rect(0, y, width, step * len(lines) + 2 * pad - 2)
        area.centerx = layout.panel.left // 2
        shadow = box(area.size, (*INK, 110), pad)
        target.blit(shadow, area.move(0, 3))
        target.blit(box(area.size, fill, pad, mixed(fill, INK, 0.35)), area)
        for i, line in enumerate(lines):
            drawn = self._text.line(line, size, ink)
            target.blit(drawn, drawn.get_rect(midtop=(area.centerx, area.y + pad + i * step)))
        return area

    def head_lines(self, layout: Layout, lesson: str) -> float:
        """Return the room that a lesson needs above the floor, as a multiple of the text size.

        Every lesson reserves a few lines, so that the kitchen does not move between lessons.
        Notices reserve no room, because they soon go away.
        """
        lines = max(_LESSON_LINES, len(self._banner_lines(layout, lesson)))
        high = self._text.height(_banner_text(layout)) * lines
        return (_top(layout) + high + layout.text * 2) / layout.text

    def _banner_lines(self, layout: Layout, words: str) -> tuple[str, ...]:
        size, pad = _banner_text(layout), layout.text * 2 // 3
        most = max(40, min(layout.panel.left - 4 * pad, size * 34))
        return self._text.wrap_evenly(words, size, most, 4)

    def _countdown(self, target: pygame.Surface, layout: Layout, left: int) -> pygame.Rect:
        side = layout.text * 6
        area = pygame.Rect(0, 0, side, side)
        area.center = layout.kitchen.center
        target.blit(ellipse((side + 8, side + 8), (*INK, 150)), area.move(-4, 0))
        target.blit(ellipse((side, side), PAPER), area)
        number = self._text.line(str(left), side // 2, INK)
        target.blit(number, number.get_rect(center=area.center))
        return area

    def _pause(self, target: pygame.Surface, layout: Layout, pause: PauseView) -> pygame.Rect:
        side = round(layout.text * 4.6)
        face = self._clock(pause, side, layout)
        return self._card(target, layout, face, pause.why, pause.detail)

    def _clock(self, pause: PauseView, side: int, layout: Layout) -> pygame.Surface:
        """Return a dial that runs out, or two bars if the pause has no known end."""
        if pause.left is None:
            face = ellipse((side, side), ACCENT).copy()
            bar = pygame.Rect(0, 0, side // 9, side // 3)
            for left in (0.41, 0.59):
                bar.center = (round(side * left), side // 2)
                face.blit(box(bar.size, INK, bar.width // 3), bar)
            return face
        colour = mixed(BAD, ACCENT, min(1.0, pause.share * 2))
        face = dial(side, round(pause.share * DIAL_STEPS), colour).copy()
        number = self._text.line(str(ceil(pause.left)), round(layout.text * 1.6), INK)
        face.blit(number, number.get_rect(center=(side // 2, side // 2 + 1)))
        return face

    def _farewell(
        self, target: pygame.Surface, layout: Layout, farewell: FarewellView
    ) -> pygame.Rect:
        text = f"{farewell.text} You can close this window."
        return self._card(target, layout, None, farewell.title, text)

    def _card(
        self,
        target: pygame.Surface,
        layout: Layout,
        face: pygame.Surface | None,
        title: str,
        text: str,
    ) -> pygame.Rect:
        """Draw a card in the middle: a picture on the left, a title and a few lines."""
        large, size, pad = round(layout.text * 1.5), round(layout.text * 1.05), layout.text * 3 // 2
        left = pad + (face.get_width() + pad if face is not None else 0)
        most = max(40, min(layout.panel.left - 3 * pad, round(layout.text * 36)) - left - pad)
        rows: list[tuple[str, int, Colour]] = [
            *((line, large, INK) for line in self._text.wrap(title, large, most, 3)),
            *(
                (line, size, mixed(INK, PAPER, 0.25))
                for line in self._text.wrap(text, size, most, 5)
            ),
        ]
        gap = layout.text // 2
        high = sum(self._text.height(height) for _, height, _ in rows) + gap
        wide = max((self._text.width(line, height) for line, height, _ in rows), default=0)
        body = max(high, face.get_height() if face is not None else 0)
        area = pygame.Rect(0, 0, left + wide + pad, body + 2 * pad)
        area.center = (layout.panel.left // 2, layout.kitchen.centery)
        radius = layout.text
        target.blit(box(area.size, (*INK, 120), radius), area.move(0, 5))
        target.blit(box(area.size, PAPER, radius, mixed(PAPER, INK, 0.3)), area)
        if face is not None:
            target.blit(face, face.get_rect(midleft=(area.x + pad, area.centery)))
        y = area.centery - high // 2
        for line, height, colour in rows:
            if height == size and gap:
                y, gap = y + gap, 0
            target.blit(self._text.line(line, height, colour), (area.x + left, y))
            y += self._text.height(height)
        return area


def _top(layout: Layout) -> int:
    return max(8, layout.text // 2)


def _banner_text(layout: Layout) -> int:
    return layout.text if layout.compact else round(layout.text * 1.15)


def visible_pause(pause: PauseView) -> PauseView:
    """Return a pause with its time rounded as the dial shows it."""
    if pause.left is None:
        return pause
    share = round(pause.share * DIAL_STEPS) / DIAL_STEPS
    return replace(pause, left=float(ceil(pause.left)), share=share)


def visible_offline(seconds: float) -> float:
    """Return the seconds without a connection, rounded as the banner shows them."""
    return float(int(seconds)) if seconds >= _PATIENCE else 0.0


def _lost(seconds: float) -> str:
    """Return the words for a lost connection. The running seconds show that the window is alive."""
    since = f" ({int(seconds)} s)" if seconds >= _PATIENCE else ""
    way_on = ". You can wait or press Esc to leave" if seconds >= _LONG else ""
    return f"Connection lost — trying again{since}{way_on}"


class Notices:
    """Topmost layer: the outcome, the chat line being typed and the help."""

    def __init__(self, rendering: RenderingFile, sprites: Sprites, text: Typesetter) -> None:
        self._rendering = rendering
        self._sprites = sprites
        self._text = text

    def draw(
        self,
        target: pygame.Surface,
        layout: Layout,
        view: View,
        ui_overlay: UiOverlay,
        ground: Ground = Ground(),
    ) -> None:
        """Draw the notices of a view."""
        if view.outcome:
            self._outcome(target, layout, view, ground)
        if ui_overlay.typing is not None:
            self._typing(target, layout, ui_overlay.typing)
        if ui_overlay.help:
            self._help(target, layout, ui_overlay.help)

    def reserved(
        self, layout: Layout, view: View, ui_overlay: UiOverlay, ground: Ground
    ) -> list[pygame.Rect]:
        """Return the areas of the outcome and the chat line."""
        areas = [self._typing_area(layout)] if ui_overlay.typing is not None else []
        if view.outcome:
            areas.append(self._band(layout, self._lines(layout, view.outcome), ground))
        return areas

    def _lines(self, layout: Layout, outcome: str) -> tuple[str, ...]:
        size = _large(layout)
        return self._text.wrap(outcome, size, layout.kitchen.width - size * 5, 3)

    def _band(self, layout: Layout, lines: tuple[str, ...], ground: Ground) -> pygame.Rect:
        """Return the place across the kitchen that covers least: players and dishes are to be seen.

        Among equal places, the highest one is taken.
        """
        size, kitchen = _large(layout), layout.kitchen
        high = self._text.height(size) * len(lines) + size * 2
        band = pygame.Rect(kitchen.x - 6, max(0, kitchen.y), kitchen.width + 12, high)
        tops = range(band.y, max(band.y, layout.strip.top - high) + 1, max(1, size // 2))
        # The ribbon's shadow is 8 pixels high.
        places = (band.move(0, top - band.y) for top in tops)
        return min(places, key=lambda place: ground.covered(place.inflate(0, 16)))

    def _outcome(self, target: pygame.Surface, layout: Layout, view: View, ground: Ground) -> None:
        """Draw a ribbon across the kitchen: gold with a star if the goal was reached, else grey."""
        fill, sign = (ACCENT, "goal") if view.won else (FAINT, "rejected")
        size, lines = _large(layout), self._lines(layout, view.outcome)
        band, step = self._band(layout, lines, ground), self._text.height(size)
        target.blit(box((band.width, band.height + 8), mixed(fill, INK, 0.45), 10), band)
        target.blit(box(band.size, fill, 10), band)
        edge = band.inflate(-10, -10)
        pygame.draw.rect(target, PAPER, edge, width=2, border_radius=7)
        icon = self._sprites.file(self._rendering.icons.get(sign), size * 2)
        widest = max((self._text.width(line, size) for line in lines), default=0)
        if icon is not None:
            left = band.centerx - widest // 2 - size * 2 - size * 2 // 3
            place = icon.get_rect(midleft=(max(band.x + 8, left), band.centery))
            plate = place.inflate(8, 8)
            target.blit(ellipse(plate.size, PAPER), plate)
            target.blit(icon, place)
        for i, line in enumerate(lines):
            words = self._text.line(line, size, INK)
            target.blit(words, words.get_rect(midtop=(band.centerx, band.y + size + i * step)))

    def _typing_area(self, layout: Layout) -> pygame.Rect:
        area = pygame.Rect(8, 0, layout.panel.left - 16, layout.text * 2 + 4)
        area.bottom = layout.strip.top - 8
        return area

    def _typing(self, target: pygame.Surface, layout: Layout, typed: str) -> None:
        size, area = layout.text, self._typing_area(layout)
        target.blit(box(area.size, PAPER, 8, INK), area)
        text = f"Say: {typed}|"
        # Of a long line the end is shown, where the cursor is.
        while self._text.width(text, size) > area.width - 2 * size and len(text) > 8:
            text = "…" + text[2:]
        words = self._text.line(text, size, INK)
        target.blit(words, words.get_rect(midleft=(area.x + size // 2, area.centery)))

    def _help(self, target: pygame.Surface, layout: Layout, rows: KeyRows) -> None:
        size = next(
            (s for s in range(layout.text, MIN_HELP, -1) if self._help_fits(layout, rows, s)),
            MIN_HELP,
        )
        wrapped, keys, area = self._help_page(layout, rows, size)
        pad, step = size, self._text.height(size)
        target.blit(box(layout.size, (0, 0, 0, 120), 0), (0, 0))
        target.blit(box(area.size, PANEL, 12, ACCENT), area)
        target.blit(self._text.line("How to play", size + 4, ACCENT), area.move(pad, pad - 4))
        y = area.y + 3 * pad
        for key, lines in wrapped:
            target.blit(self._text.line(key, size, ACCENT), (area.x + pad, y))
            for line in lines or ("",):
                target.blit(self._text.line(line, size, TEXT), (area.x + pad + keys, y))
                y += step
            y += size // 4

    def _help_fits(self, layout: Layout, rows: KeyRows, size: int) -> bool:
        return self._help_page(layout, rows, size)[2].height <= layout.size[1]

    def _help_page(
        self, layout: Layout, rows: KeyRows, size: int
    ) -> tuple[list[tuple[str, tuple[str, ...]]], int, pygame.Rect]:
        """Return the wrapped rows at a letter size, the width of the keys, and the page's area."""
        width = min(layout.size[0] - 2 * size, size * 44)
        keys = max(self._text.width(key, size) for key, _ in rows) + size
        wrapped = [
            (key, tuple(self._text.wrap(says, size, width - keys - 2 * size))) for key, says in rows
        ]
        lines = sum(max(1, len(each)) for _, each in wrapped)
        height = lines * self._text.height(size) + 4 * size + (len(rows) - 1) * (size // 4)
        area = pygame.Rect(0, 0, width, height)
        area.center = (layout.size[0] // 2, layout.size[1] // 2)
        return wrapped, keys, area


def _large(layout: Layout) -> int:
    return max(layout.text, min(round(layout.text * 1.8), layout.kitchen.width // 12))
