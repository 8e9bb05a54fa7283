"""Places for tags, bubbles and tooltips, so that none covers another or what it must not.

Pure: rectangles in, rectangles out; the same ones for the same question. What is asked frame after
frame stays where it was for as long as it can, relative to what it belongs to.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import pygame

__all__ = ["Label", "Place", "place_labels"]

Point = tuple[int, int]

_COVERS, _COVERS_SPARED = 2.0, 4.0
"""What it costs to cover a tile of what is avoided and of what is spared; a tile away costs 1."""
_ASIDE, _SIDEWAYS = 0.2, 0.15
"""What it costs to be a tile out of line with what a label is about, and to be neither above nor
below it."""
_STEPS = 5
"""How many places are tried on the way of a tile."""
_WORSE_SHAPE = 0.4
"""What it costs to take the next shape."""


@dataclass(frozen=True, slots=True)
class Label:
    """A rectangle that needs a place.

    `choices` are upper left corners, the best first; where none of them is free it is moved by at
    most `reach` pixels from the first along each axis (None: anywhere). The more important ones are
    placed first. One that `stays` is rather where it was than at a better choice.

    One that is `about` a thing has its place beside that, `gap` pixels away or up to a tile more,
    where it covers least; if need be in one of its other `shapes`, the best first.
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


@dataclass(frozen=True, slots=True)
class Place:
    """Where a label is, and how far that is from its first choice, or from what it is about."""

    area: pygame.Rect
    offset: Point


def place_labels(
    labels: Iterable[Label],
    area: pygame.Rect,
    blocked: Sequence[pygame.Rect] = (),
    avoided: Sequence[pygame.Rect] = (),
    spared: Sequence[pygame.Rect] = (),
    before: Mapping[Hashable, Place] | None = None,
) -> dict[Hashable, Place]:
    """A place for each label within an area; one that fits nowhere is left out.

    Args:
        blocked: What no label may cover.
        avoided: What labels cover only where they fit nowhere else among their choices.
        spared: What they cover only where they fit nowhere else within their reach.
        before: The places of the last frame.
    """
    taken = [rect for rect in blocked if rect.w and rect.h]
    places: dict[Hashable, Place] = {}
    for label in sorted(labels, key=lambda label: -label.importance):
        kept = before.get(label.key) if before and label.stays else None
        if label.about is None:
            place = _place(label, area, taken, (avoided, spared), kept.offset if kept else None)
        else:
            place = _beside(label, label.about, area, taken, (avoided, spared), kept)
        if place is not None:
            places[label.key] = place
            taken.append(place.area)
    return places


def _place(
    label: Label,
    area: pygame.Rect,
    taken: list[pygame.Rect],
    rather_not: tuple[Sequence[pygame.Rect], Sequence[pygame.Rect]],
    kept: Point | None,
) -> Place | None:
    if label.size[0] > area.width or label.size[1] > area.height or not label.choices:
        return None
    avoided, spared = rather_not
    with_spared = [*taken, *spared]
    return (
        _chosen(label, area, [*with_spared, *avoided], kept)
        or _chosen(label, area, with_spared, kept)
        or (next(_moved(label, area, with_spared), None) if spared else None)
        or _chosen(label, area, taken, kept)
        or next(_moved(label, area, taken), None)
    )


def _chosen(
    label: Label, area: pygame.Rect, obstacles: list[pygame.Rect], kept: Point | None
) -> Place | None:
    """The first choice that covers none of some obstacles."""
    for offset in _offsets(label, kept):
        rect = _at(label, offset).clamp(area)
        if rect.collidelist(obstacles) < 0:
            return Place(rect, offset)
    return None


def _offsets(label: Label, kept: Point | None) -> Iterator[Point]:
    """The choices relative to the first; before them the place that the label has had."""
    (x, y), *_ = label.choices
    if kept is not None:
        yield kept
    for left, top in label.choices:
        yield left - x, top - y


def _at(label: Label, offset: Point) -> pygame.Rect:
    x, y = label.choices[0]
    return pygame.Rect(x + offset[0], y + offset[1], *label.size)


def _moved(label: Label, area: pygame.Rect, taken: list[pygame.Rect]) -> Iterator[Place]:
    """Free places, the nearest first: a rectangle that fits anywhere also fits against edges."""
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


def _beside(
    label: Label,
    about: pygame.Rect,
    area: pygame.Rect,
    taken: list[pygame.Rect],
    rather_not: tuple[Sequence[pygame.Rect], Sequence[pygame.Rect]],
    kept: Place | None,
) -> Place | None:
    """Where a label covers least beside what it is about; if all of that is taken, the nearest free
    place."""
    blocked, tile = [*taken, about], about.width
    if kept is not None:
        rect = kept.area.move(
            about.x + kept.offset[0] - kept.area.x, about.y + kept.offset[1] - kept.area.y
        )
        if area.contains(rect) and rect.collidelist(blocked) < 0:
            return Place(rect, kept.offset)
    sizes = (label.size, *label.shapes)
    for reach in (tile, 2 * tile, max(area.size)):
        found = sorted(
            (_distance(rect, about) + _WORSE_SHAPE * rank, rect.x, rect.y, rank)
            for rank, size in enumerate(sizes)
            for rect in _around(about, size, area, blocked, label.gap, reach)
        )
        least, best = math.inf, None
        for far, x, y, rank in found:
            if far >= least:
                break
            rect = pygame.Rect(x, y, *sizes[rank])
            cost = far + _covered(rect, rather_not) / tile**2
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
    """Free places for a rectangle of a size, `gap` to `reach` pixels beside another: in line with
    it, or some way along."""
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
    """How far a place is from what a label is about, and out of line with it, in tiles."""
    across = max(0, rect.left - about.right, about.left - rect.right)
    down = max(0, rect.top - about.bottom, about.top - rect.bottom)
    (x, y), (u, v) = rect.center, about.center
    aside = min(abs(x - u), abs(y - v))
    return (_SIDEWAYS if across else 0.0) + (across + down + _ASIDE * aside) / about.width


def _covered(
    rect: pygame.Rect, rather_not: tuple[Sequence[pygame.Rect], Sequence[pygame.Rect]]
) -> float:
    """How bad it is what a place covers, in pixels."""
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
