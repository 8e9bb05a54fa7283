"""Words over the kitchen: names, what is said, reasons, and what the mouse points at."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass

import pygame

from robotouille_client.window.drawing.kitchen.motion import Pose
from robotouille_client.window.drawing.kitchen.spots import HEAD, player_area
from robotouille_client.window.drawing.ui_overlay import UiOverlay
from robotouille_client.window.drawing.window_layout import Layout
from robotouille_client.window.drawing.words.placement import Label, Place, place_labels
from robotouille_client.window.drawing.words.tips import Listing, Tip, Tips
from robotouille_client.window.pictures.badges import badge, seat_fill
from robotouille_client.window.pictures.shapes import box, pill, speech
from robotouille_client.window.pictures.sprites import Sprites
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ABSENT,
    FAINT,
    INK,
    PAPER,
    REASON,
    REASON_EDGE,
)
from robotouille_client.window.view import Bubble, SeatView, View

__all__ = ["Labels"]

_MAX_KEPT = 200
_FEET = 0.83
"""Where a name begins below the upper edge of its player's tile, in tiles."""

_REASON, _TIP, _SAID, _OWN_NAME, _NAME = 5, 4, 3, 2, 1


@dataclass(frozen=True, slots=True)
class _Words:
    """A label and what is written on it."""

    label: Label
    lines: tuple[str, ...]
    size: int
    bubble: Bubble | None = None
    body: pygame.Rect | None = None
    tag: pygame.Surface | None = None


class Labels:
    """Draws the words of one view after the other, and moves them as little as it can."""

    def __init__(self, text: Typesetter, sprites: Sprites) -> None:
        self._text = text
        self._tips = Tips(text, sprites)
        self._places: dict[Hashable, Place] = {}
        self._tags: dict[tuple[object, ...], pygame.Surface] = {}

    def draw(
        self,
        target: pygame.Surface,
        layout: Layout,
        view: View,
        poses: dict[str, Pose],
        overlay: UiOverlay,
        *,
        hovered: pygame.Rect | None,
        listed: Listing,
        blocked: Sequence[pygame.Rect],
        avoided: Sequence[pygame.Rect],
        spared: Sequence[pygame.Rect],
    ) -> None:
        """All words that fit beside what is `blocked`, as `place_labels` has it; the tips and what
        is `listed` are about what is `hovered`."""
        words = [*self._names(layout, view, poses), *self._bubbles(layout, view, poses)]
        tips = list(self._told(layout, view, poses, overlay, hovered, listed))
        told = overlay.keys or overlay.hints or overlay.prompt or overlay.queued
        below = layout.text * 2 if told else 0  # The strip of keys.
        area = pygame.Rect(0, 0, layout.panel.left, layout.strip.top - below).inflate(-6, -6)
        labels = [*(each.label for each in words), *(tip.label for tip in tips)]
        self._places = place_labels(labels, area, blocked, avoided, spared, self._places)
        for each in words:
            place = self._places.get(each.label.key)
            if place is not None:
                self._write(target, layout, each, place.area)
        for tip in tips:
            place = self._places.get(tip.label.key)
            if place is not None:
                self._tips.draw(target, layout, tip, place.area)

    def places(self) -> dict[Hashable, pygame.Rect]:
        """Where the words of the last view are."""
        return {key: place.area for key, place in self._places.items()}

    def _write(
        self, target: pygame.Surface, layout: Layout, words: _Words, area: pygame.Rect
    ) -> None:
        if words.tag is not None:
            target.blit(words.tag, area)
            return
        pad, ink = _pad(layout), self._speech(target, layout, words, area)
        step = self._text.height(words.size)
        for i, line in enumerate(words.lines):
            drawn = self._text.line(line, words.size, ink)
            target.blit(drawn, (area.x + pad, area.y + pad // 2 + 1 + i * step))

    # Names

    def _names(self, layout: Layout, view: View, poses: dict[str, Pose]) -> Iterator[_Words]:
        size = max(9, min(layout.text, layout.tile // 6))
        seats = {seat.player: seat for seat in view.seats}
        for index, player in enumerate(view.world.players):
            if player not in poses:
                continue
            tag = self._tag(layout, view, index, player, seats.get(player), size)
            width, height = tag.get_size()
            x, y = layout.corner(poses[player].at)
            side, middle = layout.tile, round(x + layout.tile / 2 - width / 2)
            feet, above = round(y + _FEET * side), round(y + HEAD * side - height)
            beside = round(y + 0.45 * side)
            choices = (
                (middle, feet),
                (middle, above),
                (round(x - width + 0.18 * side), beside),
                (round(x + 0.82 * side), beside),
            )
            important = _OWN_NAME if player == view.me else _NAME
            reach, walks = round(0.7 * side), poses[player].walking
            label = Label(("name", player), (width, height), choices, important, reach, walks)
            yield _Words(label, (), size, tag=tag)

    def _tag(
        self,
        layout: Layout,
        view: View,
        index: int,
        player: str,
        seat: SeatView | None,
        size: int,
    ) -> pygame.Surface:
        """The badge of a seat and the name of whom it belongs to."""
        name = player if seat is None else seat.plate
        here = seat is None or seat.connected or bool(seat.stand_in)
        waited = player in view.waits_for
        key = (name, here, waited, index, size, layout.tile)
        if key not in self._tags:
            if len(self._tags) >= _MAX_KEPT:
                self._tags.clear()
            words = self._text.fit(name, size, round(layout.tile * 1.5)) + ("  …" if waited else "")
            self._tags[key] = self._draw_tag(words, index, size, here)
        return self._tags[key]

    def _draw_tag(self, words: str, index: int, size: int, here: bool) -> pygame.Surface:
        letters = self._text.line(words, size, PAPER)
        plate = pill(letters, self._text.ground(seat_fill(index) if here else ABSENT))
        side = round(plate.get_height() * 1.15)
        surface = pygame.Surface(
            (plate.get_width() + side * 2 // 3, max(side, plate.get_height())), pygame.SRCALPHA
        )
        surface.blit(plate, plate.get_rect(midright=(surface.get_width(), side // 2)))
        surface.blit(badge(index, side, None if here else FAINT), (0, 0))
        return surface

    # What is said

    def _bubbles(self, layout: Layout, view: View, poses: dict[str, Pose]) -> Iterator[_Words]:
        size, pad = max(11, round(layout.text * 0.88)), _pad(layout)
        most = max(110, min(round(layout.tile * 2.6), layout.kitchen.width * 2 // 3))
        for number, bubble in enumerate(view.bubbles):
            lines = self._text.wrap_evenly(bubble.text, size, most, 5)
            if bubble.player not in poses or not lines:
                continue
            width = max(24, max(self._text.width(line, size) for line in lines) + 2 * pad)
            height = self._text.height(size) * len(lines) + pad
            x, y = layout.corner(poses[bubble.player].at)
            side, drop = layout.tile, _drop(layout)
            top, middle = round(y + HEAD * side - height - drop), round(x + side / 2)
            beside = round(y + 0.2 * side)
            choices = (
                (middle - width // 2, top),
                (middle - width + 3 * pad, top),
                (middle - 3 * pad, top),
                (round(x + side), beside),
                (round(x - width), beside),
            )
            important = _REASON if bubble.kind == "rejected" else _SAID
            key = (bubble.player, bubble.kind, bubble.text, number)
            label = Label(key, (width, height + drop), choices, important, 4 * side)
            body = pygame.Rect(round(x + 0.25 * side), round(y + HEAD * side), side // 2, side)
            yield _Words(label, lines, size, bubble, body)

    def _speech(
        self, target: pygame.Surface, layout: Layout, words: _Words, area: pygame.Rect
    ) -> tuple[int, int, int]:
        """A bubble that points at who speaks; its ink."""
        assert words.bubble is not None and words.body is not None  # noqa: S101
        refused = words.bubble.kind == "rejected"
        edge, ink = (REASON_EDGE, REASON) if refused else (INK, INK)
        drop, (x, y) = _drop(layout), words.body.midtop
        size = (area.width, area.height - drop)
        if area.bottom <= y + drop and area.left <= x <= area.right:
            tail = min(area.width - 14, max(14, x - area.x))
            target.blit(speech(size, PAPER, edge, tail, drop), area)
        else:
            shown = pygame.Rect(area.topleft, size)
            start = _nearest(shown, words.body.center)
            pygame.draw.line(
                target, edge, start, _nearest(words.body, start), max(2, layout.text // 6)
            )
            target.blit(box(size, PAPER, _pad(layout), edge), shown)
        return ink

    # What the mouse points at

    def _told(
        self,
        layout: Layout,
        view: View,
        poses: dict[str, Pose],
        overlay: UiOverlay,
        hovered: pygame.Rect | None,
        listed: Listing,
    ) -> Iterator[Tip]:
        """What is under the mouse, beside it; and what one is busy with oneself."""
        if overlay.pointer is None:
            return
        if hovered is None:
            if overlay.tips:
                yield self._tips.at(layout, "tip", overlay.tips, overlay.pointer, _TIP)
            return
        if overlay.tips or listed:
            key = ("tip", view.hover)
            yield self._tips.beside(layout, key, overlay.tips, hovered, _TIP, listed)
        steps = view.state.busy_steps(view.me) if view.me is not None else 0
        if view.me in poses and steps:
            pose = poses[view.me]
            doing = "You are on your way" if pose.walking else "You are at work"
            words = f"{doing}: {steps} more step{'s' * (steps > 1)}"
            own = player_area(layout, pose)
            yield self._tips.beside(layout, "busy", (words,), own, _TIP)


def _pad(layout: Layout) -> int:
    return max(6, layout.text // 2)


def _drop(layout: Layout) -> int:
    """How long the tail of a bubble is."""
    return max(5, layout.text // 2)


def _nearest(area: pygame.Rect, point: tuple[int, int]) -> tuple[int, int]:
    """The point of a rectangle that is nearest to another."""
    x, y = point
    return max(area.left, min(x, area.right)), max(area.top, min(y, area.bottom))
