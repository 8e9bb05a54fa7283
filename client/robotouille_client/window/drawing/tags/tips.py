"""Tips: explanations next to what is under the mouse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import pygame

from robotouille_client.window.drawing.tags.label_placement import PlacedLabel, nearest_point
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.pictures.appearance import Appearance
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import INK, PAPER, TEXT

# Objects from the top down, each with its picture and words.
Listing = tuple[tuple[Appearance | None, str], ...]

# Width of narrow lines, as a share of the usual width.
_NARROW = 0.6
_MIN_COLUMNS = 4
_FILL = (*INK, 240)


@dataclass(frozen=True, slots=True)
class _Shape:
    """Lines of a tip, with the list below in words, or in rows of `columns` pictures."""

    lines: tuple[str, ...]
    columns: int = 0


@dataclass(frozen=True, slots=True)
class Tip:
    """Label with its shape for each size, and the list in it."""

    label: PlacedLabel
    listed: Listing = ()
    shapes: dict[tuple[int, int], _Shape] = field(default_factory=dict)


class Tips:
    """Makes tips, and draws them once they have a place."""

    def __init__(self, text: Typesetter, sprites: Sprites) -> None:
        self._text = text
        self._sprites = sprites

    def next_to(
        self,
        layout: Layout,
        key: object,
        tips: Sequence[str],
        about: pygame.Rect,
        importance: int,
        listed: Listing = (),
    ) -> Tip:
        """Return a tip next to an area of the kitchen, with words and a list of objects."""
        shapes = self._shapes(layout, tips, listed)
        (size, _), *others = shapes.items()
        label = PlacedLabel(
            (key, tuple(tips), listed), size, (about.topleft,), importance,
            about=about, shapes=tuple(other for other, _ in others), gap=_notch(layout),
        )  # fmt: skip
        return Tip(label, listed, shapes)

    def at(
        self,
        layout: Layout,
        key: object,
        tips: Sequence[str],
        point: tuple[int, int],
        rank: int,
        listed: Listing = (),
    ) -> Tip:
        """Return a tip at a point, with words and a list of objects."""
        shapes = self._shapes(layout, tips, listed)
        (width, height), gap = next(iter(shapes)), layout.text
        x, y = point
        choices = (
            (x + gap, y + gap),
            (x - gap - width, y + gap),
            (x + gap, y - height - gap // 2),
            (x - gap - width, y - height - gap // 2),
        )
        return Tip(PlacedLabel(key, (width, height), choices, rank), listed, shapes)

    def _shapes(
        self, layout: Layout, tips: Sequence[str], listed: Listing
    ) -> dict[tuple[int, int], _Shape]:
        """Return shapes by size, the best first.

        These are: everything in words; the list as pictures; only the last line, in narrow lines.
        """
        most = max(120, layout.size[0] // 3)
        long = self._wrapped(layout, tips, most)
        short = self._wrapped(layout, tips[-1:], round(most * _NARROW))
        shown = sum(appearance is not None for appearance, _ in listed)
        rows = [_Shape(long), _Shape(short)]
        if shown:
            columns = [self._columns(layout, lines, shown) for lines in (long, short)]
            rows = [_Shape(long), _Shape(long, columns[0]), _Shape(short, columns[1])]
        shapes: dict[tuple[int, int], _Shape] = {}
        for shape in rows:
            shapes.setdefault(self._size(layout, shape, listed), shape)
        return shapes

    def _columns(self, layout: Layout, lines: tuple[str, ...], shown: int) -> int:
        """Return the number of pictures in a row, so that rows are no wider than the lines."""
        wide = max((self._text.width(line, layout.text) for line in lines), default=0)
        return min(shown, max(_MIN_COLUMNS, wide // _row(layout)))

    def _wrapped(self, layout: Layout, tips: Sequence[str], most: int) -> tuple[str, ...]:
        return tuple(line for tip in tips for line in self._text.wrap(tip, layout.text, most, 6))

    def _size(self, layout: Layout, shape: _Shape, listed: Listing) -> tuple[int, int]:
        size, pad, row = layout.text, _pad(layout), _row(layout)
        widths = [self._text.width(line, size) for line in shape.lines]
        rows = len(listed)
        if shape.columns:
            shown = sum(appearance is not None for appearance, _ in listed)
            widths.append(shape.columns * row)
            rows = -(-shown // shape.columns)
        else:
            widths += [self._text.width(name, size) + row + 4 for _, name in listed]
        height = self._text.height(size) * len(shape.lines) + row * rows + pad
        return max(widths, default=0) + 2 * pad, height

    def draw(self, target: pygame.Surface, layout: Layout, tip: Tip, area: pygame.Rect) -> None:
        """Draw a placed tip, with a notch towards what it is about."""
        shape, pad = tip.shapes[area.size], _pad(layout)
        if tip.label.about is not None:
            _point(target, layout, area, tip.label.about)
        target.blit(box(area.size, _FILL, pad), area)
        x, y = area.x + pad, area.y + pad // 2 + 1
        for line in shape.lines:
            target.blit(self._text.line(line, layout.text, TEXT), (x, y))
            y += self._text.height(layout.text)
        if shape.columns:
            self._pictures(target, layout, tip.listed, shape.columns, (x, y))
        else:
            self._list(target, layout, tip.listed, (x, y))

    def _list(
        self, target: pygame.Surface, layout: Layout, listed: Listing, at: tuple[int, int]
    ) -> None:
        step, (x, y) = _row(layout), at
        for appearance, name in listed:
            if appearance is not None:
                target.blit(self._sprites.of(appearance, step), (x, y))
            drawn = self._text.line(name, layout.text, TEXT)
            target.blit(drawn, drawn.get_rect(midleft=(x + step + 4, y + step // 2)))
            y += step

    def _pictures(
        self,
        target: pygame.Surface,
        layout: Layout,
        listed: Listing,
        columns: int,
        at: tuple[int, int],
    ) -> None:
        side = _row(layout)
        shown = [appearance for appearance, _ in listed if appearance is not None]
        size = (columns * side, -(-len(shown) // columns) * side)
        target.blit(box(size, PAPER, side // 4), at)
        for number, appearance in enumerate(shown):
            row, column = divmod(number, columns)
            target.blit(
                self._sprites.of(appearance, side), (at[0] + column * side, at[1] + row * side)
            )


def _point(target: pygame.Surface, layout: Layout, area: pygame.Rect, about: pygame.Rect) -> None:
    """Draw a notch from a tip towards what it is about."""
    inner = about.inflate(-about.width // 4, -about.height // 4)
    half = max(3, layout.text // 3)
    edge = area.inflate(-4 * half, -2 * half)
    end = nearest_point(inner, area.center)
    foot = nearest_point(edge, end)
    tip = nearest_point(about.inflate(-8, -8), foot)
    if math.dist(foot, tip) > layout.tile // 2:  # A long notch is a thin spike.
        return
    if area.left <= end[0] <= area.right:
        ends = (foot[0] - half, foot[1]), (foot[0] + half, foot[1])
    else:
        ends = (foot[0], foot[1] - half), (foot[0], foot[1] + half)
    pygame.draw.polygon(target, INK, (*ends, tip))


def _row(layout: Layout) -> int:
    return round(layout.text * 1.7)


def _pad(layout: Layout) -> int:
    return max(6, layout.text // 2)


def _notch(layout: Layout) -> int:
    """Return the length of the shortest notch."""
    return max(4, layout.text // 3)
