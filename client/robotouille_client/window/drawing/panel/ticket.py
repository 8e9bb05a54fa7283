"""The ticket: each dish of the goal as a column of pictures that are ticked off, and their
names where they fit."""

from __future__ import annotations

import pygame

from robotouille.world.grounding.goal import Fit
from robotouille.world.world import State
from robotouille_client.window.drawing.panel.dish_progress import (
    LayerProgress,
    fit,
    kept_in_place,
    progress,
    shares,
    stack_levels,
)
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.pictures.dishes import Dish, Layer, dishes
from robotouille_client.window.pictures.shapes import RING_STEPS, box, share_disc, tick
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import DONE, INK, PAPER, TICKED, mixed
from robotouille_client.window.view import View

__all__ = ["Ticket"]

_ICON, _MIN_ICON = 2.5, 1.4
"""The side of a picture, as a multiple of the text size."""

_STEP = 0.8
"""The distance from one picture to the next, as a share of their size: most fill less of it."""

_SHARE, _COMPACT_SHARE = 0.5, 0.4
"""How much of the panel's height a ticket may take."""

_MAX_KNOWN = 16
"""For how many ways in which things lie their pictures are kept."""


class Ticket:
    """Draws the goal of one world; in words where it cannot be drawn, or does not fit."""

    def __init__(
        self, view: View, resolver: AppearanceResolver, sprites: Sprites, text: Typesetter
    ) -> None:
        self._resolver = resolver
        self._rendering = resolver.rendering
        self._sprites = sprites
        self._text = text
        self._known: dict[tuple[tuple[int | str, int], ...], tuple[Dish, ...]] = {}
        self._roots: dict[int, str] = {}
        self._dishes = dishes(view.world, resolver) or ()
        self._at_first = fit(self._dishes, view.world.initial).holding
        self._rows: list[tuple[pygame.Rect, Layer, LayerProgress]] = []
        self._holding: tuple[bool, ...] = ()
        self._shares: tuple[float, ...] = ()
        self._prose = view.world.task.goal_description or "No goal is set."

    def told(self, point: tuple[int, int]) -> tuple[str, ...]:
        """What is so and what is not of the layer at a point; and the goal in words."""
        for row, layer, far in self._rows:
            if row.collidepoint(point):
                return (*self._conditions(layer, far), self._prose)
        return (self._prose,)

    def _conditions(self, layer: Layer, far: LayerProgress) -> tuple[str, ...]:
        lines = []
        now = layer.holding(self._holding)
        for number, held, says in zip(layer.terms, now, layer.conditions, strict=True):
            done = "Done" if far.settled or not self._at_first[number] else "Ready"
            lines.append(f"{done if held else 'Not yet'}: {says}.")
        if all(now) and not all(self._holding[n] for n in layer.below):
            lines.append("Not yet: all that belongs below it.")
        return tuple(lines)

    def seen(self, state: State) -> object:
        """What can be seen of a state."""
        now = fit(self._dishes, state)
        done = tuple(round(share * RING_STEPS) for share in shares(state, now.holding))
        return now.holding, done, tuple(stack_levels(state, now).items())

    def draw(
        self,
        surface: pygame.Surface,
        area: pygame.Rect,
        layout: Layout,
        state: State,
        free: int,
    ) -> int:
        """Draw the ticket at the top of an area, as a state has it; its height.

        Args:
            free: The height that nothing else needs: in that, dishes stand below each other.
        """
        now = self._arrange(state)
        shape = self._shape(area, layout, free)
        self._rows = []
        if shape is None:
            return self._in_words(surface, area, layout)
        below, size = shape
        pad, step = layout.text // 2, round(size * _STEP)
        counts = [len(dish.layers) for dish in self._dishes]
        high = sum(counts) * step + (len(counts) - 1) * pad if below else max(counts) * step
        self._holding = now.holding
        self._shares = shares(state, now.holding)
        surface.blit(box((area.width, high + 2 * pad), PAPER, layout.text // 2), area.topleft)
        column = pygame.Rect(area.x + pad, area.y + pad, area.width - 2 * pad, high)
        column.width //= 1 if below else len(counts)
        for number, dish in enumerate(self._dishes):
            if below:
                column.height = counts[number] * step
            if number:
                self._seam(surface, column, pad, below=below)
            self._column(surface, column, step, dish, size, layout.text)
            column.move_ip((0, column.height + pad) if below else (column.width, 0))
        return high + 2 * pad

    def _arrange(self, state: State) -> Fit:
        """Order the pictures as the things lie that are there, and leave each dish at its place;
        what of the goal holds."""
        now = fit(self._dishes, state)
        levels = stack_levels(state, now)
        key = tuple(levels.items())
        if key not in self._known:
            if len(self._known) >= _MAX_KNOWN:
                self._known.clear()
            self._known[key] = dishes(state.world, self._resolver, levels) or ()
        found = self._known[key]
        self._dishes, self._roots = kept_in_place(found, now.chosen, self._roots)
        return now

    def _shape(self, area: pygame.Rect, layout: Layout, free: int) -> tuple[bool, int] | None:
        """Whether each dish is below the one before it, where it has room for words, or else beside
        it; and how large the pictures are. None where they would be too small."""
        if not self._dishes:
            return None
        counts = [len(dish.layers) for dish in self._dishes]
        room = area.height * (_COMPACT_SHARE if layout.compact else _SHARE)
        gaps = (len(counts) + 1) * layout.text // 2
        most = room if len(counts) == 1 else min(room, free - gaps)
        for below, high, wide in (
            (True, most / sum(counts), area.width),
            (False, room / max(counts), area.width / len(counts)),
        ):
            size = int(min(layout.text * _ICON, high / _STEP, wide / 2))
            if size >= layout.text * _MIN_ICON:
                return below, size
        return None

    def _seam(self, surface: pygame.Surface, column: pygame.Rect, gap: int, *, below: bool) -> None:
        """A dashed line between a dish and the one before it."""
        ink = mixed(PAPER, INK, 0.35)
        if below:
            for x in range(column.left, column.right, 6):
                surface.fill(ink, (x, column.top - gap // 2 - 1, 3, 1))
        else:
            for y in range(column.top, column.bottom, 6):
                surface.fill(ink, (column.x - 1, y, 1, 3))

    def _column(
        self,
        surface: pygame.Surface,
        column: pygame.Rect,
        step: int,
        dish: Dish,
        size: int,
        text: int,
    ) -> None:
        top = column.bottom - len(dish.layers) * step
        small, mark = max(10, round(text * 0.85)), max(8, min(round(text * 0.95), step - 4))
        room = column.width - size - 16 - mark
        told = all(self._text.width(layer.words, small) <= room for layer in dish.layers)
        for i, far in enumerate(progress(dish, self._holding, self._at_first, self._shares)):
            layer, row = dish.layers[i], pygame.Rect(column.x, top + i * step, column.width, step)
            self._rows.append((row.copy(), layer, far))
            row = row.inflate(-4, 0)
            if far.settled:
                surface.blit(box((row.width, row.height - 1), TICKED, text // 3), row)
            side = step - 2 if layer.appearance.role == "station" else size
            picture = self._sprites.of(layer.appearance, side)
            surface.blit(picture, picture.get_rect(center=(row.x + 2 + size // 2, row.centery)))
            if layer.terms:
                sign = self._sign(far, mark)
                surface.blit(sign, sign.get_rect(midright=(row.right - 2, row.centery)))
            if told:
                words = self._text.line(layer.words, small, INK)
                surface.blit(words, words.get_rect(midleft=(row.x + size + 6, row.centery)))

    def _sign(self, far: LayerProgress, side: int) -> pygame.Surface:
        """A tick, or a disc that fills up with what is done."""
        if far.settled:
            return tick(side, DONE)
        return share_disc(side * 7 // 8, round(far.share * RING_STEPS), DONE, PAPER)

    def _in_words(self, surface: pygame.Surface, area: pygame.Rect, layout: Layout) -> int:
        size, pad = layout.text, layout.text * 2 // 3
        icon = self._sprites.file(self._rendering.icons.get("goal"), size * 2)
        left = pad + (icon.get_width() + pad // 2 if icon else 0)
        step = self._text.height(size)
        most = max(3, area.height // 3 // step)
        lines = self._text.wrap(self._prose, size, area.width - left - pad, most)
        height = max(len(lines) * step, size * 2 if icon else 0) + 2 * pad
        surface.blit(box((area.width, height), PAPER, layout.text // 2), area.topleft)
        if icon is not None:
            surface.blit(icon, (area.x + pad, area.y + pad))
        for i, line in enumerate(lines):
            words = self._text.line(line, size, INK)
            surface.blit(words, (area.x + left, area.y + pad + i * step))
        return height
