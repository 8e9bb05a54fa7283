"""The ticket: dishes of the goal as columns of pictures that are ticked off, and their progress."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import pygame

from robotouille.world.grounding.atoms import bits_of
from robotouille.world.grounding.goal import Fit, Order
from robotouille.world.presentation.work import work_towards
from robotouille.world.scene import scene
from robotouille.world.world import State
from robotouille_client.window.drawing.kitchen.pops import Pop
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import AppearanceResolver
from robotouille_client.window.pictures.dishes import Dish, Layer, Variable, dishes
from robotouille_client.window.pictures.shapes import RING_STEPS, box, share_disc, tick
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import DONE, INK, PAPER, TICKED, mixed
from robotouille_client.window.view import View


@dataclass(frozen=True, slots=True)
class LayerProgress:
    """Progress of a layer: the share of its work that is done, and whether it is `settled`.

    A settled layer is as the goal wants it, with everything below, so that nothing must be undone.
    A layer that was right from the start, such as a plate on a table, is settled as soon as
    another layer of its dish is.
    """

    share: float
    settled: bool


def progress(
    dish: Dish, holding: Sequence[bool], at_first: Sequence[bool], shares: Sequence[float] = ()
) -> tuple[LayerProgress, ...]:
    """Return the progress of each layer of a dish.

    A layer without goal terms is settled with the whole dish.

    Args:
        holding: Goal terms that hold now.
        at_first: Goal terms that held at the start of the game.
        shares: Shares of the terms that are being worked on.
    """
    now = [each.holding(holding) for each in dish.layers]
    first = [each.holding(at_first) for each in dish.layers]
    right = [
        bool(each.terms) and all(done) and all(holding[n] for n in each.below)
        for each, done in zip(dish.layers, now, strict=True)
    ]
    # Without this, a plate that stands on a table anyway would be ticked off before the first
    # step.
    begun = any(fine and not all(before) for fine, before in zip(right, first, strict=True))
    whole = all(map(all, now))
    found = []
    for layer, fine, done, before in zip(dish.layers, right, now, first, strict=True):
        rows = zip(layer.terms, done, before, strict=True)
        to_do = [(n, held) for n, held, already in rows if not already]
        share = sum(1.0 if held else shares[n] if shares else 0.0 for n, held in to_do)
        settled = whole or (fine and (bool(to_do) or begun))
        found.append(LayerProgress(1.0 if settled else share / max(1, len(to_do)), settled))
    return tuple(found)


def fit(dishes: Sequence[Dish], state: State) -> Fit:
    """Return which goal terms hold, and which objects stand for the goal's variables.

    Objects in their place count first: the tomato on a burger belongs to that burger, even if
    another burger could use it too. A place counts only if its base holds. An object that could
    serve several dishes counts for the dish with which most of the goal holds.
    """
    goal, facts = state.world.goal, state.facts
    # One order is not enough: a bowl of soup fits the first dish with a bowl of soup, whatever
    # else is in the soup, and then nothing that is in it fits its own dish.
    return max(
        (goal.fit(facts, _fit_order(each)) for each in _dish_orders(dishes)),
        key=lambda found: sum(found.holding),
    )


# Largest number of dishes that are tried in every order.
_MAX_ORDERED = 4


def _dish_orders(dishes: Sequence[Dish]) -> Iterator[Sequence[Dish]]:
    """Yield orders of dishes, the problem's first, so that it wins if several fit equally."""
    ordered = sorted(
        dishes, key=lambda dish: min((n for x in dish.layers for n in x.terms), default=0)
    )
    if len(ordered) <= _MAX_ORDERED:
        yield from permutations(ordered)
    else:
        yield from (ordered[n:] + ordered[:n] for n in range(len(ordered)))


def _fit_order(dishes: Sequence[Dish]) -> Order:
    """Return the order in which terms are tried: places with their base, then facts."""
    layers = [(rank, layer) for rank, dish in enumerate(dishes) for layer in dish.layers]
    places = [(len(x.base) > 0, rank, n, x.base) for rank, x in layers for n in x.places]
    facts = sorted((rank, n) for rank, x in layers for n in x.terms if n not in x.places)
    return (*((n, base) for _, _, n, base in sorted(places)), *((n, ()) for _, n in facts))


def shares(state: State, holding: Sequence[bool]) -> tuple[float, ...]:
    """Return the share of work done for each goal term.

    The share is 0 for terms that hold, that nobody works on, or that are about several objects.
    Work on one object counts for the first of several equal terms.
    """
    under_way: dict[tuple[str, str], dict[str, float]] = {}
    for atom, share in work_towards(state):
        if len(atom) == 2:
            things = under_way.setdefault((atom[0], state.world.thing(atom[1]).kind), {})
            things[atom[1]] = max(share, things.get(atom[1], 0.0))
    rest = {about: sorted(things.values()) for about, things in under_way.items()}
    found = []
    for term, held in zip(state.world.goal.terms, holding, strict=True):
        waiting = [] if held or len(term.ids) > 1 else rest.get((term.predicate, term.args[0]), [])
        found.append(waiting.pop() if waiting else 0.0)
    return tuple(found)


def as_at_first(state: State, now: Fit, at_first: Sequence[bool]) -> tuple[bool, ...]:
    """Return which goal terms held at the start, without those that players have achieved again.

    Bread that a player has put on another table is progress, even if the table where it lay at
    first would do as well. Each new fact counts for the first of several equal terms.
    """
    table, start = state.world.table, state.world.initial
    new = Counter(
        (predicate, *(state.world.thing(name).kind for name in names))
        for predicate, *names in map(table.atoms.__getitem__, bits_of(state.facts & ~start.facts))
    )
    found = []
    for term, held, before in zip(state.world.goal.terms, now.holding, at_first, strict=True):
        about = (term.predicate, *term.args)
        again = held and before and new[about] > 0
        new[about] -= again
        found.append(before and not again)
    return tuple(found)


def stack_levels(state: State, fit: Fit) -> dict[Variable, int]:
    """Return how many objects lie below each object that is in its place."""
    placed = scene(state)
    found: dict[Variable, int] = {}
    for term, held in zip(state.world.goal.terms, fit.holding, strict=True):
        if held and len(term.ids) == 2:
            for one, other in (term.ids, term.ids[::-1]):
                there = placed.get(fit.chosen[one])
                if there is not None and there.host == fit.chosen[other]:
                    found[one] = there.level
    return found


def kept_in_place(
    dishes: Sequence[Dish], chosen: Mapping[Variable, str], before: Mapping[int, str]
) -> tuple[tuple[Dish, ...], dict[int, str]]:
    """Order dishes so that each stays where the same object carried it before.

    The goal may match two burgers in another order once one of them is further along.

    Args:
        chosen: Objects that stand for the goal's variables.
        before: Object that carried the dish at each place.

    Returns:
        The dishes in order, and the object that now carries the dish at each place.
    """
    placed: dict[int, Dish] = {}
    for dish in dishes:
        root = chosen.get(dish.root)
        places = (
            place
            for place, other in enumerate(dishes)
            if place not in placed and before.get(place) == root and other.shape == dish.shape
        )
        if root is not None and (place := next(places, None)) is not None:
            placed[place] = dish
    for place, other in enumerate(dishes):
        if place not in placed:
            rest = [each for each in dishes if each not in placed.values()]
            placed[place] = next(each for each in rest if each.shape == other.shape)
    order = tuple(placed[place] for place in range(len(dishes)))
    now = {n: chosen[dish.root] for n, dish in enumerate(order) if dish.root in chosen}
    return order, {**before, **now}


# Largest and smallest side of a picture, as multiples of the text size.
_ICON, _MIN_ICON = 2.5, 1.4

# Distance between two pictures, as a share of their size, which most do not fill.
_STEP = 0.8

# Largest share of the panel's height for a ticket: usual, and in a compact panel.
_SHARE, _COMPACT_SHARE = 0.5, 0.4

# Arrangements of objects for which the dishes are cached.
_MAX_KNOWN = 16


class Ticket:
    """Draws the goal of one world; in words if it cannot be drawn or does not fit."""

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
        self._fitted: tuple[State, Fit] | None = None
        self._at_start = self._fit(view.world.initial).holding
        self._at_first = self._at_start
        self._rows: list[tuple[pygame.Rect, Layer, LayerProgress]] = []
        self.pops: dict[Hashable, Pop] = {}
        """Ticks by dish and layer, with their places in the ticket."""
        self._holding: tuple[bool, ...] = ()
        self._shares: tuple[float, ...] = ()
        self._prose = view.world.task.goal_description or "This game has no goal."

    def tooltip(self, point: tuple[int, int]) -> tuple[str, ...]:
        """Return what is done and what is not for the layer at a point, then the goal in words."""
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
            lines.append("Not yet: everything below it.")
        return tuple(lines)

    def redraw_key(self, state: State) -> object:
        """Return the part of a state that the ticket shows."""
        now = self._fit(state)
        done = tuple(round(share * RING_STEPS) for share in shares(state, now.holding))
        levels, before = stack_levels(state, now), as_at_first(state, now, self._at_start)
        return now.holding, done, tuple(levels.items()), before, self._sprites.revision

    def _fit(self, state: State) -> Fit:
        """Return the fit of a state, which is computed once for all its frames."""
        if self._fitted is None or self._fitted[0] is not state:
            self._fitted = state, fit(self._dishes, state)
        return self._fitted[1]

    def draw(
        self, surface: pygame.Surface, area: pygame.Rect, layout: Layout, state: State, free: int
    ) -> int:
        """Draw the ticket of a state at the top of an area. Return its height.

        Args:
            free: Height that nothing else needs; up to that, dishes go below each other.
        """
        now = self._arrange(state)
        shape = self._shape(area, layout, free)
        self._rows, self.pops = [], {}
        if shape is None:
            return self._in_words(surface, area, layout)
        below, size = shape
        pad, step = layout.text // 2, round(size * _STEP)
        counts = [len(dish.layers) for dish in self._dishes]
        high = sum(counts) * step + (len(counts) - 1) * pad if below else max(counts) * step
        self._holding = now.holding
        self._at_first = as_at_first(state, now, self._at_start)
        self._shares = shares(state, now.holding)
        surface.blit(box((area.width, high + 2 * pad), PAPER, layout.text // 2), area.topleft)
        column = pygame.Rect(area.x + pad, area.y + pad, area.width - 2 * pad, high)
        column.width //= 1 if below else len(counts)
        for number in range(len(self._dishes)):
            if below:
                column.height = counts[number] * step
            if number:
                self._seam(surface, column, pad, below=below)
            self._column(surface, column, step, number, size, layout.text)
            column.move_ip((0, column.height + pad) if below else (column.width, 0))
        return high + 2 * pad

    def _arrange(self, state: State) -> Fit:
        """Order the pictures as the objects lie, each dish at its old place. Return the fit."""
        now = self._fit(state)
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
        """Return whether dishes go below each other, and the picture size; None if too small.

        Dishes below each other leave room for words.
        """
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
        """Draw a dashed line between a dish and the one before."""
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
        number: int,
        size: int,
        text: int,
    ) -> None:
        dish = self._dishes[number]
        top = column.bottom - len(dish.layers) * step
        small, mark = max(10, round(text * 0.85)), max(8, min(round(text * 0.95), step - 4))
        room = column.width - size - 16 - mark
        in_words = all(self._text.width(layer.words, small) <= room for layer in dish.layers)
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
                place = surface.blit(sign, sign.get_rect(midright=(row.right - 2, row.centery)))
                if far.settled:
                    self.pops[number, i] = Pop(sign, place.center)
            if in_words:
                words = self._text.line(layer.words, small, INK)
                surface.blit(words, words.get_rect(midleft=(row.x + size + 6, row.centery)))

    def _sign(self, far: LayerProgress, side: int) -> pygame.Surface:
        """Return a tick, or a disc that fills up with the work."""
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
