"""Places for tags, bubbles and tooltips, so that none covers another or what it must not.

Pure: rectangles in, rectangles out; the same ones for the same question. What is asked frame after
frame stays where it was for as long as it can, relative to what it belongs to.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import pygame

__all__ = ["Label", "Place", "place_labels"]

Point = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Label:
    """A rectangle that needs a place.

    `choices` are upper left corners, the best first; where none of them is free it is moved by at
    most `reach` pixels from the first along each axis (None: anywhere). The more important ones are
    placed first. One that `stays` is rather where it was than at a better choice.
    """

    key: Hashable
    size: Point
    choices: tuple[Point, ...]
    importance: int = 0
    reach: int | None = None
    stays: bool = True


@dataclass(frozen=True, slots=True)
class Place:
    """Where a label is, and how far that is from its first choice."""

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
        place = _place(label, area, taken, (avoided, spared), kept.offset if kept else None)
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


def _within(values: set[int], middle: int, reach: int | None, low: int, high: int) -> list[int]:
    if reach is not None:
        low, high = max(low, middle - reach), min(high, middle + reach)
    return [value for value in values if low <= value <= high]
