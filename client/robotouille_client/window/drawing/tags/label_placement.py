"""Placement of tags, bubbles and tips, so that none covers another or anything important.

Pure: rectangles in, rectangles out, always the same for the same input. From frame to frame a label
keeps its place relative to its object while it can.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import pygame

Point = tuple[int, int]

# Cost of covering a tile of avoided and of spared area. A tile of distance costs 1.
_COVERS, _COVERS_SPARED = 2.0, 4.0
# Cost of being a tile out of line with the object, and of being neither above nor below.
_ASIDE, _SIDEWAYS = 0.2, 0.15
# Places that are tried along a tile.
_STEPS = 5
# Cost of taking the next shape.
_WORSE_SHAPE = 0.4


@dataclass(frozen=True, slots=True)
class PlacedLabel:
    """Rectangle that needs a place.

    Attributes:
        choices: Upper left corners, the best first. If none is free, the label moves from the first
            one, by at most `reach` pixels along each axis (None: anywhere).
        importance: Labels of greater importance are placed first.
        stays: True to prefer the old place to a better choice.
        about: Area of an object that the label is placed next to, where it covers least.
        shapes: Other sizes that such a label may take, the best first.
        gap: Distance from the object in pixels; up to a tile more if need be.
        fixed: True to take the first choice that covers no blocked area and no label, even if it
            covers an avoided or spared area.
    """

    key: Hashable
    size: Point
    choices: tuple[Point, ...]
    importance: int = 0
    reach: int | None = None
    stays: bool = True
    about: pygame.Rect | None = None
    shapes: tuple[Point, ...] = ()
    gap: int = 0
    fixed: bool = False


@dataclass(frozen=True, slots=True)
class Place:
    """Area of a label, and its offset from its first choice or from its object."""

    area: pygame.Rect
    offset: Point


def place_labels(
    labels: Iterable[PlacedLabel],
    area: pygame.Rect,
    blocked: Sequence[pygame.Rect] = (),
    avoided: Sequence[pygame.Rect] = (),
    spared: Sequence[pygame.Rect] = (),
    before: Mapping[Hashable, Place] | None = None,
) -> dict[Hashable, Place]:
    """Return a place for each label; labels that fit nowhere are left out.

    Args:
        area: Area for all labels.
        blocked: Areas that no label may cover.
        avoided: Areas that labels cover only if none of their choices is free.
        spared: Areas that labels cover only if no place within reach is free.
        before: Places in the last frame.
    """
    # Empty rectangles would collide with every label around them.
    taken = [rect for rect in blocked if rect.w and rect.h]
    places: dict[Hashable, Place] = {}
    for label in sorted(labels, key=lambda label: -label.importance):
        kept = before.get(label.key) if before and label.stays else None
        if label.about is None:
            place = _place(label, area, taken, (avoided, spared), kept.offset if kept else None)
        else:
            place = _next_to(label, label.about, area, taken, (avoided, spared), kept)
        if place is not None:
            places[label.key] = place
            taken.append(place.area)
    return places


def _place(
    label: PlacedLabel,
    area: pygame.Rect,
    taken: list[pygame.Rect],
    rather_not: tuple[Sequence[pygame.Rect], Sequence[pygame.Rect]],
    kept: Point | None,
) -> Place | None:
    if label.size[0] > area.width or label.size[1] > area.height or not label.choices:
        return None
    avoided, spared = rather_not
    # Tried in this order: cover nothing, cover avoided areas, move, cover spared areas, move
    # there.
    with_spared = [*taken, *spared]
    if label.fixed and (place := _chosen(label, area, taken, kept)) is not None:
        return place
    return (
        _chosen(label, area, [*with_spared, *avoided], kept)
        or _chosen(label, area, with_spared, kept)
        or (next(_moved(label, area, with_spared), None) if spared else None)
        or _chosen(label, area, taken, kept)
        or next(_moved(label, area, taken), None)
    )


def _chosen(
    label: PlacedLabel, area: pygame.Rect, obstacles: list[pygame.Rect], kept: Point | None
) -> Place | None:
    for offset in _offsets(label, kept):
        rect = _at(label, offset).clamp(area)
        if rect.collidelist(obstacles) < 0:
            return Place(rect, offset)
    return None


def _offsets(label: PlacedLabel, kept: Point | None) -> Iterator[Point]:
    """Yield the label's old place, then its choices, all relative to the first choice."""
    (x, y), *_ = label.choices
    if kept is not None:
        yield kept
    for left, top in label.choices:
        yield left - x, top - y


def _at(label: PlacedLabel, offset: Point) -> pygame.Rect:
    x, y = label.choices[0]
    return pygame.Rect(x + offset[0], y + offset[1], *label.size)


def _moved(label: PlacedLabel, area: pygame.Rect, taken: list[pygame.Rect]) -> Iterator[Place]:
    """Yield free places, the nearest first.

    A rectangle that fits anywhere also fits against the edges of the obstacles.
    """
    x, y = label.choices[0]
    width, height = label.size
    lefts = {x, area.left, area.right - width}
    tops = {y, area.top, area.bottom - height}
    for rect in taken:
        lefts.update((rect.left - width, rect.right))
        tops.update((rect.top - height, rect.bottom))
    across = _within(lefts, x, label.reach, area.left, area.right - width)
    down = _within(tops, y, label.reach, area.top, area.bottom - height)
    steps = sorted(
        ((left - x, top - y) for left in across for top in down),
        key=lambda step: (step[0] ** 2 + step[1] ** 2, step),
    )
    for offset in steps:
        rect = _at(label, offset)
        if rect.collidelist(taken) < 0:
            yield Place(rect, offset)


def _next_to(
    label: PlacedLabel,
    about: pygame.Rect,
    area: pygame.Rect,
    taken: list[pygame.Rect],
    rather_not: tuple[Sequence[pygame.Rect], Sequence[pygame.Rect]],
    kept: Place | None,
) -> Place | None:
    """Return where a label next to its object covers least, else the nearest free place."""
    tile = about.width
    # The stations around an object must stay visible, even if the label is far away then.
    stations = [rect for rect in rather_not[0] if not rect.colliderect(about)]
    return _beside(
        label, about, area, [*taken, about, *stations], rather_not, kept, (tile, 2 * tile)
    ) or _beside(
        label, about, area, [*taken, about], rather_not, kept, (tile, 2 * tile, max(area.size))
    )


def _beside(
    label: PlacedLabel,
    about: pygame.Rect,
    area: pygame.Rect,
    blocked: list[pygame.Rect],
    rather_not: tuple[Sequence[pygame.Rect], Sequence[pygame.Rect]],
    kept: Place | None,
    reaches: tuple[int, ...],
) -> Place | None:
    """Return the best free place within the first reach in which there is one."""
    if kept is not None:
        # Labels that jump from frame to frame cannot be read, so that the old place comes first.
        rect = kept.area.move(
            about.x + kept.offset[0] - kept.area.x, about.y + kept.offset[1] - kept.area.y
        )
        if area.contains(rect) and rect.collidelist(blocked) < 0:
            return Place(rect, kept.offset)
    sizes = (label.size, *label.shapes)
    for reach in reaches:
        found = sorted(
            (_distance(rect, about) + _WORSE_SHAPE * rank, rect.x, rect.y, rank)
            for rank, size in enumerate(sizes)
            for rect in _around(about, size, area, blocked, label.gap, reach)
        )
        least, best = math.inf, None
        for far, x, y, rank in found:
            # Places are sorted by distance, which is part of the cost: none of the rest is
            # better.
            if far >= least:
                break
            rect = pygame.Rect(x, y, *sizes[rank])
            cost = far + _covered(rect, rather_not) / about.width**2
            if cost < least:
                least, best = cost, rect
        if best is not None:
            return Place(best, (best.x - about.x, best.y - about.y))
    return None


def _around(
    about: pygame.Rect,
    size: Point,
    area: pygame.Rect,
    blocked: Sequence[pygame.Rect],
    gap: int,
    reach: int,
) -> Iterator[pygame.Rect]:
    """Yield free places `gap` to `reach` pixels from an area: in line with it or further along."""
    width, height = size
    room = about.inflate(2 * (reach + width), 2 * (reach + height)).clip(area)
    blocked = [about.inflate(2 * gap, 2 * gap), *(r for r in blocked if r.colliderect(room))]
    step = max(4, min(reach, 2 * about.width) // _STEPS)
    lefts = {about.left, about.centerx - width // 2, about.right - width}
    tops = {about.top, about.centery - height // 2, about.bottom - height}
    lefts |= {about.left - gap - width, about.right + gap, room.right - width}
    tops |= {about.top - gap - height, about.bottom + gap, room.bottom - height}
    lefts.update(range(room.left, room.right - width, step))
    tops.update(range(room.top, room.bottom - height, step))
    for left in lefts:
        if room.left <= left <= room.right - width:
            for top in tops:
                if room.top <= top <= room.bottom - height:
                    rect = pygame.Rect(left, top, width, height)
                    if rect.collidelist(blocked) < 0:
                        yield rect


def _distance(rect: pygame.Rect, about: pygame.Rect) -> float:
    """Return how far in tiles a place is from an object and out of line with it."""
    across = max(0, rect.left - about.right, about.left - rect.right)
    down = max(0, rect.top - about.bottom, about.top - rect.bottom)
    (x, y), (u, v) = rect.center, about.center
    aside = min(abs(x - u), abs(y - v))
    return (_SIDEWAYS if across else 0.0) + (across + down + _ASIDE * aside) / about.width


def _covered(
    rect: pygame.Rect, rather_not: tuple[Sequence[pygame.Rect], Sequence[pygame.Rect]]
) -> float:
    """Return the cost of what a place covers, in pixels."""
    covered = 0.0
    for others, cost in zip(rather_not, (_COVERS, _COVERS_SPARED), strict=True):
        for number in rect.collidelistall(others):
            part = rect.clip(others[number])
            covered += cost * part.width * part.height
    return covered


def _within(values: set[int], middle: int, reach: int | None, low: int, high: int) -> list[int]:
    if reach is not None:
        low, high = max(low, middle - reach), min(high, middle + reach)
    return [value for value in values if low <= value <= high]


def nearest_point(area: pygame.Rect, point: Point) -> Point:
    """Return the point of a rectangle nearest to another point."""
    x, y = point
    return max(area.left, min(x, area.right)), max(area.top, min(y, area.bottom))
