"""Key strip: meanings of keys, queued actions, the open list, the mark of the newest action."""

from __future__ import annotations

import pygame

from robotouille_client.window.drawing.window_layout import ActionMark, Layout, UiOverlay
from robotouille_client.window.pictures.appearance import SceneSprites
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    BAD,
    CARD,
    FAINT,
    GOOD,
    INK,
    PANEL,
    PAPER,
    TEXT,
    Colour,
)

_FATES: dict[str, Colour] = {"asked": PAPER, "done": GOOD, "rejected": BAD}


class KeyStrip:
    """Draws in the lines below the kitchen, and over the kitchen."""

    def __init__(self, text: Typesetter) -> None:
        self._text = text
        self._places: list[tuple[pygame.Rect, str]] = []

    def key_at(self, pos: tuple[int, int]) -> str:
        """Return the key drawn at a point, a digit for a row of the list, or an empty string."""
        return next((key for area, key in reversed(self._places) if area.collidepoint(pos)), "")

    def draw(
        self,
        target: pygame.Surface,
        layout: Layout,
        ui_overlay: UiOverlay,
        choices: pygame.Rect | None,
    ) -> None:
        """Draw the strip, and the list in the area `choices`. Typing a chat line hides the keys."""
        self._places = []
        if ui_overlay.typing is None:
            self._keys(target, layout, ui_overlay)
        if choices is not None:
            self._list(target, layout, ui_overlay, choices)

    def mark(
        self, target: pygame.Surface, layout: Layout, stage: SceneSprites, mark: ActionMark
    ) -> None:
        """Outline the station of the local player's last action."""
        placed = stage.placed.get(mark.station)
        if placed is None or placed.tile is None:
            return
        cell = layout.cell(placed.tile).inflate(-layout.tile // 10, -layout.tile // 10)
        width = max(2, layout.tile // 20)
        pygame.draw.rect(
            target, _FATES[mark.fate], cell, width=width, border_radius=layout.tile // 8
        )

    def _keys(self, target: pygame.Surface, layout: Layout, ui_overlay: UiOverlay) -> None:
        """Draw the prompt and the main key first, then the other keys of the moment.

        If room is short, the permanent keys are dropped, the last one last.
        """
        size = gap = layout.text
        middle = layout.strip.top - layout.text * 3 // 4
        x, right = gap, layout.panel.left - gap
        prompt = _prompt(ui_overlay)
        hints = [hint for hint in ui_overlay.hints if hint[1] != prompt]
        first = self._key_width(*hints[0], size) if hints else 0
        needed = first + (self._text.width(prompt, size) + gap if prompt else 0)
        keys = list(ui_overlay.keys)
        while keys and needed + sum(self._key_width(*k, size - 2) + gap for k in keys) > right - x:
            keys.pop(0)
        for key, words in reversed(keys):
            right -= self._key_width(key, words, size - 2)
            self._key(target, (right, middle), key, words, size - 2, FAINT)
            right -= gap
        if prompt:
            most = right - x - min(first + gap, (right - x) // 2) if hints else right - x
            x += self._words(target, (x, middle), prompt, size, most, ACCENT) + gap
        for number, (key, words) in enumerate(hints):
            cap = self._key_width(key, "", size)
            lines, _ = self._shrunk(words, size, right - x - cap)
            if number and (not lines or lines[-1].endswith("…")):
                break
            x += self._key(target, (x, middle), key, words, size, TEXT, right - x - cap) + gap

    def _shrunk(self, words: str, size: int, room: int) -> tuple[tuple[str, ...], int]:
        """Return words in one line, or in two smaller ones, cut if need be; and their size."""
        if self._text.width(words, size) <= room:
            return (words,), size
        small = max(9, size * 3 // 4)
        return self._text.wrap(words, small, max(small, room), 2), small

    def _words(
        self,
        target: pygame.Surface,
        at: tuple[int, int],
        words: str,
        size: int,
        room: int,
        ink: Colour,
    ) -> int:
        """Draw words from the middle of their left edge. Return their width."""
        lines, letters = self._shrunk(words, size, room)
        step = self._text.height(letters)
        y = at[1] - step * (len(lines) - 1) // 2
        for number, each in enumerate(lines):
            line = self._text.line(each, letters, ink)
            target.blit(line, line.get_rect(midleft=(at[0], y + number * step)))
        return max((self._text.width(each, letters) for each in lines), default=0)

    def _key_width(self, key: str, words: str, size: int) -> int:
        if not key:
            return self._text.width(words, size)
        cap = max(size * 3 // 2, self._text.width(key, size) + size * 2 // 3)
        return cap + size // 2 + self._text.width(words, size)

    def _key(
        self,
        target: pygame.Surface,
        at: tuple[int, int],
        key: str,
        words: str,
        size: int,
        ink: Colour,
        room: int | None = None,
    ) -> int:
        """Draw a key cap, if there is a key, with words to its right. Return the width.

        `at` is the middle of the left edge.
        """
        if not key:
            full = self._text.width(words, size)
            return self._words(target, at, words, size, full if room is None else room, ink)
        letters = self._text.line(key, size, ink)
        cap = pygame.Rect(0, 0, self._key_width(key, "", size) - size // 2, size * 3 // 2)
        cap.midleft = at
        target.blit(box(cap.size, CARD, size // 3, FAINT), cap)
        target.blit(letters, letters.get_rect(center=cap.center))
        start, full = (cap.right + size // 2, at[1]), self._text.width(words, size)
        wide = self._words(target, start, words, size, full if room is None else room, ink)
        whole = cap.inflate(size // 2 + wide, size // 2)
        self._places.append((whole.move((whole.width - cap.width) // 2, 0), key))
        return cap.width + size // 2 + wide

    def list_area(
        self,
        layout: Layout,
        ui_overlay: UiOverlay,
        free: pygame.Rect,
        own: pygame.Rect | None = None,
    ) -> pygame.Rect | None:
        """Return the area of the open list, or None if it is closed.

        The list goes to the `free` part of the panel if it fits there, else to the corner of the
        kitchen farthest from the local player (`own`).
        """
        if ui_overlay.choices is None:
            return None
        size, pad = layout.text, layout.text
        words, foot = self._list_words(layout, ui_overlay)
        widest = max(self._text.width(row, size) for row in (*words, foot)) + 4 * pad
        high = self._step(layout) * (len(words) + bool(foot)) + 2 * pad
        area = pygame.Rect(0, 0, min(widest, layout.panel.left - pad), high)
        room = free.inflate(-pad, -pad)
        if area.width <= room.width and area.height <= room.height:
            area.width = room.width
            area.bottomright = room.bottomright
            return area
        room = pygame.Rect(0, 0, layout.panel.left, layout.strip.top - 2 * pad).inflate(-pad, -pad)
        corners = []
        for corner in ("bottomright", "bottomleft", "topright", "topleft"):
            there = area.copy()
            setattr(there, corner, getattr(room, corner))
            corners.append(there.clamp(pygame.Rect((0, 0), layout.size)))
        return max(corners, key=lambda place: (0, 0) if own is None else _apart(place, own))

    def _list_words(self, layout: Layout, ui_overlay: UiOverlay) -> tuple[list[str], str]:
        """Return the rows of the list, and the line below them."""
        size, most = layout.text, layout.size[0] // 2
        rows = ui_overlay.choices or ("Nothing to do right now.",)
        return [self._text.fit(row, size, most) for row in rows], self._text.fit(
            ui_overlay.more, size - 2, most
        )

    def _step(self, layout: Layout) -> int:
        return layout.text * 7 // 4

    def _list(
        self, target: pygame.Surface, layout: Layout, ui_overlay: UiOverlay, area: pygame.Rect
    ) -> None:
        size, pad, step = layout.text, layout.text, self._step(layout)
        words, foot = self._list_words(layout, ui_overlay)
        target.blit(box(area.size, PANEL, pad, ACCENT), area)
        for i, row in enumerate(words):
            top = area.y + pad + i * step
            place = pygame.Rect(area.x + pad // 2, top, area.width - pad, step - 2)
            chosen = bool(ui_overlay.choices) and i == ui_overlay.chosen
            self._places.append((place, str(i + 1)))
            if chosen:
                target.blit(box(place.size, ACCENT, pad // 2), place)
            ink = INK if chosen else TEXT
            number = self._text.line(str(i + 1) if ui_overlay.choices else "", size, ink)
            target.blit(number, number.get_rect(midleft=(place.x + pad // 2, place.centery)))
            line = self._text.line(row, size, ink)
            target.blit(line, line.get_rect(midleft=(place.x + 2 * pad, place.centery)))
        if foot:
            line = self._text.line(foot, size - 2, FAINT)
            target.blit(line, line.get_rect(bottomleft=(area.x + pad, area.bottom - pad)))


def _prompt(ui_overlay: UiOverlay) -> str:
    """Return the prompt, or the actions that wait."""
    if ui_overlay.prompt or not ui_overlay.queued:
        return ui_overlay.prompt
    return f"Next: {', '.join(ui_overlay.queued)} (Esc cancels)"


def _apart(one: pygame.Rect, other: pygame.Rect) -> tuple[int, int]:
    """Return how far apart two rectangles are: the gap, then the distance of their middles."""
    across = max(0, one.left - other.right, other.left - one.right)
    down = max(0, one.top - other.bottom, other.top - one.bottom)
    (x, y), (u, v) = one.center, other.center
    return across * across + down * down, (x - u) ** 2 + (y - v) ** 2
