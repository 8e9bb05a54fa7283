"""Topmost layer: the outcome, the chat line being typed and the help."""

from __future__ import annotations

import pygame

from robotouille.domain.rendering import RenderingFile
from robotouille_client.window.drawing.window_layout import KeyRows, Layout, UiOverlay
from robotouille_client.window.pictures.shapes import box, ellipse
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, FAINT, INK, PANEL, PAPER, TEXT, mixed
from robotouille_client.window.view import View

# Smallest letters of the help, in pixels.
MIN_HELP = 7


class Notices:
    """Draws over all other layers."""

    def __init__(self, rendering: RenderingFile, sprites: Sprites, text: Typesetter) -> None:
        self._rendering = rendering
        self._sprites = sprites
        self._text = text

    def draw(
        self, target: pygame.Surface, layout: Layout, view: View, ui_overlay: UiOverlay
    ) -> None:
        """Draw the notices of a view."""
        if view.outcome:
            self._outcome(target, layout, view.outcome, won=view.won)
        if ui_overlay.typing is not None:
            self._typing(target, layout, ui_overlay.typing)
        if ui_overlay.help:
            self._help(target, layout, ui_overlay.help)

    def reserved(self, layout: Layout, view: View, ui_overlay: UiOverlay) -> list[pygame.Rect]:
        """Return the areas of the outcome and the chat line."""
        areas = [self._typing_area(layout)] if ui_overlay.typing is not None else []
        if view.outcome:
            areas.append(self._band(layout, self._lines(layout, view.outcome)))
        return areas

    def _lines(self, layout: Layout, outcome: str) -> tuple[str, ...]:
        size = _large(layout)
        return self._text.wrap(outcome, size, layout.kitchen.width - size * 5, 3)

    def _band(self, layout: Layout, lines: tuple[str, ...]) -> pygame.Rect:
        size, kitchen = _large(layout), layout.kitchen
        high = self._text.height(size) * len(lines) + size * 2
        band = pygame.Rect(kitchen.x - 6, 0, kitchen.width + 12, high)
        band.centery = kitchen.centery
        return band

    def _outcome(self, target: pygame.Surface, layout: Layout, outcome: str, *, won: bool) -> None:
        """Draw a ribbon across the kitchen: gold with a star if the goal was reached, else grey."""
        fill, sign = (ACCENT, "goal") if won else (FAINT, "rejected")
        size, kitchen = _large(layout), layout.kitchen
        lines = self._lines(layout, outcome)
        band, step = self._band(layout, lines), self._text.height(size)
        shade = box((kitchen.width, kitchen.height), (*INK, 90), 0)
        target.blit(shade, kitchen)
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
