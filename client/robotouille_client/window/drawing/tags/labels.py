"""Labels over the kitchen: names, speech, reasons and tips."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import pygame

from robotouille_client.window.drawing.kitchen.spots import HEAD, Pose, player_area
from robotouille_client.window.drawing.tags.label_placement import (
    Place,
    PlacedLabel,
    nearest_point,
    place_labels,
)
from robotouille_client.window.drawing.tags.tips import Listing, Tip, Tips
from robotouille_client.window.drawing.window_layout import Layout, UiOverlay
from robotouille_client.window.pictures.appearance import Appearance
from robotouille_client.window.pictures.shapes import badge, box, pill, seat_fill, speech
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

_MAX_KEPT = 200
# Top of a name below the top of its player's tile, in tiles.
_FEET = 0.83

_REASON, _TIP, _SAID, _OWN_NAME, _NAME = 5, 4, 3, 2, 1


@dataclass(frozen=True, slots=True)
class _Words:
    """Label and its content."""

    label: PlacedLabel
    lines: tuple[str, ...]
    size: int
    bubble: Bubble | None = None
    body: pygame.Rect | None = None
    tag: pygame.Surface | None = None
    looks: tuple[Appearance, ...] = ()


@dataclass(frozen=True, slots=True)
class LabelSurroundings:
    """Subjects of labels, and the areas they must leave visible, as for `place_labels`.

    Attributes:
        hovered: Area of the object under the mouse.
        listed: Things in or on that object, or layers of a dish.
        blocked: Areas that no label may cover.
        avoided: Areas that labels cover only if no listed place is free.
        spared: Areas that labels cover only if no other place is within reach.
        pictures: Looks of the things that bubbles are about.
    """

    hovered: pygame.Rect | None = None
    listed: Listing = ()
    blocked: Sequence[pygame.Rect] = ()
    avoided: Sequence[pygame.Rect] = ()
    spared: Sequence[pygame.Rect] = ()
    pictures: Mapping[str, Appearance] = field(default_factory=dict)


class Labels:
    """Draws the labels of one view after another, and moves them as little as possible."""

    def __init__(self, text: Typesetter, sprites: Sprites) -> None:
        self._text = text
        self._sprites = sprites
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
        around: LabelSurroundings,
    ) -> None:
        """Draw all labels that find a place."""
        bubbles = self._bubbles(layout, view, poses, around.pictures)
        words = [*self._names(layout, view, poses), *bubbles]
        tips = list(self._tips_for(layout, view, poses, overlay, around))
        keys = overlay.keys or overlay.hints or overlay.prompt or overlay.queued
        below = layout.text * 2 if keys else 0  # The key strip.
        area = pygame.Rect(0, 0, layout.panel.left, layout.strip.top - below).inflate(-6, -6)
        labels = [*(each.label for each in words), *(tip.label for tip in tips)]
        self._places = place_labels(
            labels, area, around.blocked, around.avoided, around.spared, self._places
        )
        for each in words:
            place = self._places.get(each.label.key)
            if place is not None:
                self._write(target, layout, each, place.area)
        for tip in tips:
            place = self._places.get(tip.label.key)
            if place is not None:
                self._tips.draw(target, layout, tip, place.area)

    def places(self) -> dict[Hashable, pygame.Rect]:
        """Return the areas of the last view's labels."""
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
        side, top = _icon(layout), area.y + pad // 2 + 1 + len(words.lines) * step
        for i, look in enumerate(words.looks):
            target.blit(self._sprites.of(look, side), (area.x + pad + i * side, top))

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
            side_top = round(y + 0.45 * side)
            choices = (
                (middle, feet),
                (middle, above),
                (round(x - width + 0.18 * side), side_top),
                (round(x + 0.82 * side), side_top),
            )
            important = _OWN_NAME if player == view.me else _NAME
            reach, walks = round(0.7 * side), poses[player].walking
            label = PlacedLabel(
                ("name", player), (width, height), choices, important, reach, walks, fixed=True
            )
            yield _Words(label, (), size, tag=tag)

    def _tag(
        self, layout: Layout, view: View, index: int, player: str, seat: SeatView | None, size: int
    ) -> pygame.Surface:
        """Return the badge of a seat with the name of its participant."""
        name = player if seat is None else seat.plate
        here = seat is None or seat.connected or bool(seat.substitute)
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

    # Speech

    def _bubbles(
        self,
        layout: Layout,
        view: View,
        poses: dict[str, Pose],
        pictures: Mapping[str, Appearance],
    ) -> Iterator[_Words]:
        size, pad = max(11, round(layout.text * 0.88)), _pad(layout)
        most = max(110, min(round(layout.tile * 2.6), layout.kitchen.width * 2 // 3))
        for number, bubble in enumerate(view.bubbles):
            lines = self._text.wrap_evenly(bubble.text, size, most, 5)
            looks = tuple(pictures[name] for name in bubble.things if name in pictures)
            if bubble.player not in poses or not (lines or looks):
                continue
            written = max((self._text.width(line, size) for line in lines), default=0)
            width = max(24, max(written, len(looks) * _icon(layout)) + 2 * pad)
            height = self._text.height(size) * len(lines) + pad + bool(looks) * _icon(layout)
            x, y = layout.corner(poses[bubble.player].at)
            side, drop = layout.tile, _drop(layout)
            top, middle = round(y + HEAD * side - height - drop), round(x + side / 2)
            side_top = round(y + 0.2 * side)
            corners = (
                (middle - width // 2, top),
                (middle - width + 3 * pad, top),
                (middle - 3 * pad, top),
                (round(x + side), side_top),
                (round(x - width), side_top),
            )
            choices = tuple((_inside(layout, left, width), at) for left, at in corners)
            important = _REASON if bubble.kind == "rejected" else _SAID
            key = (bubble.player, bubble.kind, bubble.text, bubble.things, number)
            label = PlacedLabel(key, (width, height + drop), choices, important, 4 * side)
            body = pygame.Rect(round(x + 0.25 * side), round(y + HEAD * side), side // 2, side)
            yield _Words(label, lines, size, bubble, body, looks=looks)

    def _speech(
        self, target: pygame.Surface, layout: Layout, words: _Words, area: pygame.Rect
    ) -> tuple[int, int, int]:
        """Draw a bubble that points at the speaker. Return its ink."""
        assert words.bubble is not None and words.body is not None  # noqa: S101
        rejected = words.bubble.kind == "rejected"
        edge, ink = (REASON_EDGE, REASON) if rejected else (INK, INK)
        drop, (x, y) = _drop(layout), words.body.midtop
        size = (area.width, area.height - drop)
        if area.bottom <= y + drop and area.left <= x <= area.right:
            tail = min(area.width - 14, max(14, x - area.x))
            target.blit(speech(size, PAPER, edge, tail, drop), area)
        else:
            shown = pygame.Rect(area.topleft, size)
            start = nearest_point(shown, words.body.center)
            pygame.draw.line(
                target, edge, start, nearest_point(words.body, start), max(2, layout.text // 6)
            )
            target.blit(box(size, PAPER, _pad(layout), edge), shown)
        return ink

    # Tips

    def _tips_for(
        self,
        layout: Layout,
        view: View,
        poses: dict[str, Pose],
        overlay: UiOverlay,
        around: LabelSurroundings,
    ) -> Iterator[Tip]:
        """Yield the tip for what is under the mouse, and the one for the local player's work."""
        hovered, listed = around.hovered, around.listed
        if overlay.pointer is None:
            return
        if hovered is None:
            if overlay.tips:
                yield self._tips.at(layout, "tip", overlay.tips, overlay.pointer, _TIP, listed)
            return
        if overlay.tips or listed:
            key = ("tip", view.hover)
            yield self._tips.next_to(layout, key, overlay.tips, hovered, _TIP, listed)
        steps = view.state.busy_steps(view.me) if view.me is not None else 0
        if view.me in poses and steps:
            pose = poses[view.me]
            doing = "On your way" if pose.walking else "Busy"
            words = f"{doing}: {steps} more step{'s' * (steps > 1)}"
            own = player_area(layout, pose)
            yield self._tips.next_to(layout, "busy", (words,), own, _TIP)


def _inside(layout: Layout, left: int, width: int) -> int:
    """Return the left end of a bubble after it is moved into the kitchen."""
    kitchen = layout.kitchen
    return max(kitchen.left, min(left, kitchen.right - width))


def _pad(layout: Layout) -> int:
    return max(6, layout.text // 2)


def _icon(layout: Layout) -> int:
    return round(layout.tile * 0.42)


def _drop(layout: Layout) -> int:
    return max(5, layout.text // 2)
