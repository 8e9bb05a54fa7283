"""The open orders of a shift as paper slips, with their dishes and the patience that is left."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import pygame

from robotouille.planning.shift import DishPlanner, rules_of
from robotouille.world.shift import OpenOrder, Orders
from robotouille.world.world import State
from robotouille_client.window.drawing.kitchen.pops import Pop
from robotouille_client.window.drawing.tags.tips import Listing
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import Appearance, AppearanceResolver
from robotouille_client.window.pictures.dishes import Layer, dishes
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
# Heights in letters: of a layer's row on a slip, the best first; of the line with a dish's name.
_ROWS, _NAME = (1.7, 1.4, 1.2), 1.6
# Lines of chat for which slips with a row for each layer leave room.
_CHAT_LINES = 4
# Lines for the words of all layers on other slips.
_LINES = 2


@dataclass(frozen=True, slots=True)
class _Shape:
    """Height of a slip, and of a row for each layer; 0 for a small slip without such rows."""

    height: int
    row: int = 0


class OrderSlips:
    """Draws the orders of one shift in place of a ticket."""

    def __init__(
        self, view: View, resolver: AppearanceResolver, sprites: Sprites, text: Typesetter
    ) -> None:
        self._rules = rules_of(view.world)
        self._sprites = sprites
        self._text = text
        self._layers = {
            name: _layers(DishPlanner(view.world, name), resolver) for name in self._rules.menu
        }
        self._prose = view.world.task.goal_description
        self._rows: list[tuple[pygame.Rect, str]] = []
        self._before: Orders | None = None
        self.pops: dict[Hashable, Pop] = {}
        """Points of the last order, by their step."""

    def tooltip(self, point: tuple[int, int]) -> tuple[str, ...]:
        """Return what a dish is worth, or the purpose of the shift."""
        name = self._dish_at(point)
        if not name:
            return (self._prose,)
        dish = self._rules.menu[name]
        tip = f", up to {dish.tip} more if it is early" if dish.tip else ""
        lines = [f"{name.capitalize()}: {dish.points} points{tip}."]
        if dish.penalty:
            lines.append(f"If the guest leaves: {dish.penalty} points less.")
        return (*lines, self._prose)

    def listing(self, point: tuple[int, int]) -> Listing:
        """Return the layers of the dish at a point, from the top down."""
        layers = self._layers.get(self._dish_at(point), ())
        return tuple((layer.appearance, layer.words) for layer in layers)

    def _dish_at(self, point: tuple[int, int]) -> str:
        """Return the dish of the slip at a point, or an empty string."""
        return next((name for row, name in self._rows if row.collidepoint(point)), "")

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
        gap, shape = layout.text // 2, self._shape(layout, free - (y - area.y))
        room = max(shape.height, max(free, area.height * 2 // 5) - (y - area.y))
        most = max(1, (room + gap) // (shape.height + gap))
        for order in orders.open[:most]:
            slip = pygame.Rect(area.x, y, area.width, shape.height)
            if shape.row:
                slip.height -= self._spared(order, shape)
            self._slip(surface, slip, layout, order, orders, shape)
            self._rows.append((slip, self._rules.dish_name(order.number)))
            y += slip.height + gap
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

    def _shape(self, layout: Layout, free: int) -> _Shape:
        """Return the shape of the slips: with rows of layers if all orders fit at any time.

        A shape that depended on the open orders would change with each of them.
        """
        letter, gap = layout.text, layout.text // 2
        if layout.compact:
            return _Shape(round(letter * 2.6))
        free -= round(_CHAT_LINES * 1.2 * letter)
        most = max(len(layers) for layers in self._layers.values())
        for row in (round(letter * each) for each in _ROWS):
            height = round(letter * _NAME) + most * row + _thickness(letter) + gap
            if self._rules.most_open * (height + gap) <= free:
                return _Shape(height, row)
        words = _LINES * self._text.height(_small(letter))
        return _Shape(round(letter * _NAME) + words + _thickness(letter) + gap)

    def _spared(self, order: OpenOrder, shape: _Shape) -> int:
        """Return the height that a dish with few layers does not need."""
        most = max(len(layers) for layers in self._layers.values())
        return (most - len(self._layers[self._rules.dish_name(order.number)])) * shape.row

    def _slip(
        self,
        surface: pygame.Surface,
        slip: pygame.Rect,
        layout: Layout,
        order: OpenOrder,
        orders: Orders,
        shape: _Shape,
    ) -> None:
        """Draw one order: its dish in words and pictures, its worth now, and its patience."""
        name, pad = self._rules.dish_name(order.number), layout.text // 2
        share = self._bar(order, orders) / BAR_STEPS
        colour = _patience_colour(share)
        surface.blit(box(slip.size, PAPER, layout.text // 3), slip)
        surface.fill(colour, (slip.x, slip.y + 4, 4, slip.height - 8))
        thick = _thickness(layout.text)
        line = pygame.Rect(
            slip.x + pad, slip.bottom - thick - pad // 2, slip.width - 2 * pad, thick
        )
        bar(surface, line, share, colour, mixed(PAPER, INK, 0.18))
        inner = pygame.Rect(line.x, slip.y + 2, line.width, line.y - slip.y - 4)
        layers, left, whole = self._layers[name], inner.x, inner.copy()
        if not shape.row:
            left = self._draw_pictures(surface, whole, _pictures(layers)) + pad
        if shape.row or (not layout.compact and len(layers) > 1):
            inner.height = round(layout.text * _NAME) - 2
            below = pygame.Rect(left, inner.bottom, inner.right - left, whole.bottom - inner.bottom)
            if shape.row:
                self._draw_layers(surface, below, layout, layers, shape.row)
            else:
                self._draw_names(surface, below, layout, layers)
        worth = self._text.line(f"+{self._rules.worth(order, orders.time)}", layout.text, INK)
        surface.blit(worth, worth.get_rect(midright=(inner.right, inner.centery)))
        inner.width -= worth.get_width() + pad
        words = self._text.fit(name.capitalize(), max(10, layout.text - 1), inner.right - left)
        shown = self._text.line(words, max(10, layout.text - 1), INK)
        surface.blit(shown, shown.get_rect(midleft=(left, inner.centery)))

    def _draw_layers(
        self,
        surface: pygame.Surface,
        area: pygame.Rect,
        layout: Layout,
        layers: Sequence[Layer],
        row: int,
    ) -> None:
        """Draw the layers of a dish below each other, each with its words."""
        small = max(10, round(layout.text * 0.85))
        for number, layer in enumerate(layers):
            middle = area.top + number * row + row // 2
            picture = self._sprites.of(layer.appearance, row)
            surface.blit(picture, picture.get_rect(midleft=(area.x, middle)))
            words = self._text.fit(layer.words, small, area.width - row - 6)
            shown = self._text.line(words, small, INK)
            surface.blit(shown, shown.get_rect(midleft=(area.x + row + 6, middle)))

    def _draw_names(
        self,
        surface: pygame.Surface,
        area: pygame.Rect,
        layout: Layout,
        layers: Sequence[Layer],
    ) -> None:
        """Draw the words of a dish's layers one after the other, the lowest first."""
        small, y = _small(layout.text), area.y
        words = ", ".join(layer.words for layer in reversed(layers))
        for line in self._text.wrap(words, small, area.width, _LINES):
            surface.blit(self._text.line(line, small, INK), (area.x, y))
            y += self._text.height(small)

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


def _small(letter: int) -> int:
    """Return the size of the words of layers that share a line."""
    return max(10, round(letter * 0.75))


def _thickness(letter: int) -> int:
    """Return the height of a patience bar."""
    return max(4, letter // 3)


def _layers(planner: DishPlanner, resolver: AppearanceResolver) -> tuple[Layer, ...]:
    """Return the things of a dish as they look when it is ready, from the top down."""
    found = dishes(planner.world, resolver) or ()
    layers = [layer for dish in found for layer in dish.layers]
    return tuple(layer for layer in layers if layer.appearance.role != "station")


def _pictures(layers: Sequence[Layer]) -> tuple[Appearance, ...]:
    """Return the looks of layers, the lowest first."""
    return tuple(layer.appearance for layer in reversed(layers))


def _patience_colour(share: float) -> Colour:
    if share > 0.5:
        return mixed(AMBER, GOOD, 2 * share - 1)
    return mixed(BAD, AMBER, 2 * share)
