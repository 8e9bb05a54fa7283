"""The open orders of a shift as paper slips, with their dishes and the patience that is left."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import pygame

from robotouille.planning.shift import DishPlanner, rules_of
from robotouille.world.shift import OpenOrder, Orders
from robotouille.world.world import State
from robotouille_client.window.drawing.pops import Pop
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import Appearance, AppearanceResolver
from robotouille_client.window.pictures.dishes import dishes
from robotouille_client.window.pictures.shapes import bar, box
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    BAD,
    FAINT,
    GOOD,
    INK,
    PAPER,
    TEXT,
    Colour,
    mixed,
)
from robotouille_client.window.view import View

BAR_STEPS = 60
"""Lengths of a patience bar. A slip is drawn again only when its bar changes."""
AMBER: Colour = (214, 150, 44)


class OrderSlips:
    """Draws the orders of one shift in place of a ticket."""

    def __init__(
        self, view: View, resolver: AppearanceResolver, sprites: Sprites, text: Typesetter
    ) -> None:
        self._rules = rules_of(view.world)
        self._sprites = sprites
        self._text = text
        self._pictures = {
            name: _pictures(DishPlanner(view.world, name), resolver) for name in self._rules.menu
        }
        self._prose = view.world.task.goal_description
        self._rows: list[tuple[pygame.Rect, str]] = []
        self._before: Orders | None = None
        self.pops: dict[Hashable, Pop] = {}
        """Points of the last order, by their step."""

    def tooltip(self, point: tuple[int, int]) -> tuple[str, ...]:
        """Return what a dish is worth, or the purpose of the shift."""
        for row, name in self._rows:
            if row.collidepoint(point):
                dish = self._rules.menu[name]
                tip = f", up to {dish.tip} more if it is early" if dish.tip else ""
                lines = [f"{name.capitalize()}: {dish.points} points{tip}."]
                if dish.penalty:
                    lines.append(f"If the guest leaves: {dish.penalty} points less.")
                return (*lines, self._prose)
        return (self._prose,)

    def redraw_key(self, state: State) -> object:
        """Return the part of a state that the slips show."""
        orders = state.orders
        if orders is None:
            return None
        left = tuple((order.number, self._bar(order, orders)) for order in orders.open)
        return left, orders.score, orders.served, self._sprites.revision

    def _bar(self, order: OpenOrder, orders: Orders) -> int:
        left = max(0, order.due - orders.time)
        return round(BAR_STEPS * left / self._rules.patience(order.number))

    def draw(
        self, surface: pygame.Surface, area: pygame.Rect, layout: Layout, state: State, free: int
    ) -> int:
        """Draw the score and the slips at the top of an area. Return the height.

        Args:
            free: Height that nothing else needs. Orders that do not fit are counted in a line.
        """
        self._rows = []
        orders = state.orders
        if orders is None:
            return 0
        y = area.y + self._score(surface, area, layout, orders)
        gap, high = layout.text // 2, self._slip_height(layout)
        room = max(high, max(free, area.height * 2 // 5) - (y - area.y))
        most = max(1, (room + gap) // (high + gap))
        for order in orders.open[:most]:
            slip = pygame.Rect(area.x, y, area.width, high)
            self._slip(surface, slip, layout, order, orders)
            self._rows.append((slip, self._rules.dish_name(order.number)))
            y += high + gap
        small = max(10, layout.text - 3)
        if len(orders.open) > most:
            more = self._text.line(f"{len(orders.open) - most} more", small, FAINT)
            surface.blit(more, (area.x, y))
            y += more.get_height() + gap
        elif not orders.open:
            words = self._text.line("No orders at the moment", layout.text, FAINT)
            surface.blit(words, (area.x, y))
            y += words.get_height() + gap
        return y - gap - area.y

    def _score(
        self, surface: pygame.Surface, area: pygame.Rect, layout: Layout, orders: Orders
    ) -> int:
        points = self._text.line(f"{orders.score} points", layout.text + 4, TEXT)
        place = surface.blit(points, area.topleft)
        before, self._before = self._before, orders
        gain = 0 if before is None else orders.score - before.score
        if gain:
            words = self._text.line(f"{gain:+}", layout.text + 8, GOOD if gain > 0 else BAD)
            middle = (place.right + words.get_width(), place.centery)
            self.pops = {orders.time: Pop(words, middle, rises=True)}
        parts = [f"{orders.served} served"]
        if orders.expired:
            parts.append(f"{orders.expired} lost")
        counts = self._text.line(" · ".join(parts), max(10, layout.text - 3), FAINT)
        surface.blit(
            counts, counts.get_rect(bottomright=(area.right, area.y + points.get_height()))
        )
        return points.get_height() + layout.text // 2

    def _slip_height(self, layout: Layout) -> int:
        return round(layout.text * (2.6 if layout.compact else 3.6))

    def _slip(
        self,
        surface: pygame.Surface,
        slip: pygame.Rect,
        layout: Layout,
        order: OpenOrder,
        orders: Orders,
    ) -> None:
        """Draw one order: its dish in words and pictures, its worth now, and its patience."""
        name, pad = self._rules.dish_name(order.number), layout.text // 2
        share = self._bar(order, orders) / BAR_STEPS
        colour = _patience_colour(share)
        surface.blit(box(slip.size, PAPER, layout.text // 3), slip)
        surface.fill(colour, (slip.x, slip.y + 4, 4, slip.height - 8))
        thick = max(4, layout.text // 3)
        line = pygame.Rect(
            slip.x + pad, slip.bottom - thick - pad // 2, slip.width - 2 * pad, thick
        )
        bar(surface, line, share, colour, mixed(PAPER, INK, 0.18))
        inner = pygame.Rect(line.x, slip.y + 2, line.width, line.y - slip.y - 4)
        worth = self._text.line(f"{self._rules.worth(order, orders.time)}", layout.text, INK)
        surface.blit(worth, worth.get_rect(midright=(inner.right, inner.centery)))
        inner.width -= worth.get_width() + pad
        left = self._draw_pictures(surface, inner, self._pictures[name])
        words = self._text.fit(
            name.capitalize(), max(10, layout.text - 1), inner.right - left - pad
        )
        shown = self._text.line(words, max(10, layout.text - 1), INK)
        surface.blit(shown, shown.get_rect(midleft=(left + pad, inner.centery)))

    def _draw_pictures(
        self, surface: pygame.Surface, inner: pygame.Rect, pictures: Sequence[Appearance]
    ) -> int:
        """Draw a dish as one picture on the other, the lowest first. Return the right end."""
        count = max(1, len(pictures))
        size = round(inner.height * 0.72)
        rise = (inner.height - size) / max(1, count - 1)
        for i, appearance in enumerate(pictures):
            picture = self._sprites.of(appearance, size)
            top = inner.bottom - size - round(i * rise)
            surface.blit(picture, (inner.x, top))
        return inner.x + size


def _pictures(planner: DishPlanner, resolver: AppearanceResolver) -> tuple[Appearance, ...]:
    """Return the things of a dish as they look when it is ready, the lowest first."""
    found = dishes(planner.world, resolver) or ()
    layers = [layer for dish in found for layer in dish.layers]
    return tuple(
        layer.appearance for layer in reversed(layers) if layer.appearance.role != "station"
    )


def _patience_colour(share: float) -> Colour:
    if share > 0.5:
        return mixed(AMBER, GOOD, 2 * share - 1)
    return mixed(BAD, AMBER, 2 * share)
