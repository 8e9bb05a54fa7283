"""The lanes of a timeline: what each seat did with each step, and marks, on one picture."""

from __future__ import annotations

from collections import Counter

import pygame

from robotouille.episode.tallies import Activity
from robotouille_client.window.pictures.theme import (
    ACCENT,
    BAD,
    CARD,
    GOOD,
    INK,
    PAPER,
    TEXT,
    Colour,
    mixed,
)
from robotouille_client.window.replay.history.history import ACTIVITIES, EntryKind, History
from robotouille_client.window.replay.timeline.scale import Scale

__all__ = ["ACTIVITY_LOOKS", "ACTIVITY_WORDS", "MARK_COLOURS", "Lanes", "draw_mark"]

ACTIVITY_LOOKS: dict[Activity, tuple[Colour, float]] = {
    Activity.SUBSTITUTED: ((168, 128, 210), 0.72),
    Activity.AWAY: ((104, 96, 112), 0.1),
    Activity.ACTED: ((116, 206, 134), 1.0),
    Activity.BUSY: ((86, 148, 222), 0.72),
    Activity.WAITING: ((244, 164, 74), 0.46),
    Activity.IDLE: ((150, 140, 160), 0.2),
}
"""Colour and height of an activity: the heights say the same to those who see no colours."""
ACTIVITY_WORDS = {
    Activity.ACTED: "acted",
    Activity.BUSY: "working",
    Activity.WAITING: "waiting",
    Activity.IDLE: "idle",
    Activity.AWAY: "away",
    Activity.SUBSTITUTED: "stand-in",
}
MARK_COLOURS: dict[EntryKind, Colour] = {
    EntryKind.REJECTED: BAD,
    EntryKind.SAID: PAPER,
    EntryKind.REASONING: (196, 150, 240),
    EntryKind.PAUSED: ACCENT,
    EntryKind.RESTARTED: ACCENT,
    EntryKind.ANNOUNCED: ACCENT,
    EntryKind.ENDED: GOOD,
}
_WIDE = 5
"""Pixels a step from which on steps are drawn one by one, with a gap."""
_OUTLINED = 9
"""Pixels from which on a sign has an outline."""
_LOOKS = [*(ACTIVITY_LOOKS[activity] for activity in ACTIVITIES), (CARD, 0.0)]
"""By the byte of a lane; nothing is drawn of what was not seen."""


class Lanes:
    """Draws the lanes of a history, anew only when something in them has changed."""

    def __init__(self, history: History) -> None:
        self._history = history
        self._surface: pygame.Surface | None = None
        self._drawn: tuple[object, ...] = ()

    def draw(
        self,
        target: pygame.Surface,
        area: pygame.Rect,
        scale: Scale,
        rows: int,
        head: int,
        followed: int | None,
    ) -> None:
        """The lanes in an area, below the marks that are nobody's.

        Args:
            rows: The height of a lane, with room for its marks above it.
            head: The height of the marks that are nobody's.
            followed: The lane that is not faded; None: no lane is.
        """
        history = self._history
        drawn = (
            area.size, rows, scale.left - area.left, scale.width, scale.first, scale.shown,
            history.length, len(history.marks), followed,
        )  # fmt: skip
        if self._surface is None or drawn != self._drawn:
            self._surface, self._drawn = self._render(area, scale, rows, head, followed), drawn
        target.blit(self._surface, area)

    def _render(
        self, area: pygame.Rect, scale: Scale, rows: int, head: int, followed: int | None
    ) -> pygame.Surface:
        surface = pygame.Surface(area.size, pygame.SRCALPHA)
        left, marks = scale.left - area.left, rows * 2 // 5
        for place, lane in enumerate(self._history.lanes.values()):
            top = head + place * rows
            fade = 0.0 if followed in (None, place) else 0.6
            track = pygame.Rect(left, top + 1, scale.width, rows - 2)
            surface.fill(mixed(CARD, INK, 0.25), track)
            row = pygame.Rect(left, top + marks, scale.width, rows - marks - 2)
            if scale.width >= _WIDE * scale.shown:
                self._steps(surface, row, lane, scale, fade)
            else:
                self._columns(surface, row, lane, scale, fade)
        self._marks(surface, area.left, scale, rows, head, followed)
        return surface

    def _steps(
        self, surface: pygame.Surface, row: pygame.Rect, lane: bytearray, scale: Scale, fade: float
    ) -> None:
        """A block for each step."""
        shift = row.left - scale.left
        for step in range(int(scale.first), min(len(lane), int(scale.last) + 1)):
            colour, high = _LOOKS[lane[step]]
            left = max(row.left, scale.x(step) + shift)
            right = min(row.right, scale.x(step + 1) + shift) - 1
            height = max(2, round(row.height * high))
            if right > left and high:
                place = (left, row.bottom - height, right - left, height)
                surface.fill(mixed(colour, CARD, fade), place)

    def _columns(
        self, surface: pygame.Surface, row: pygame.Rect, lane: bytearray, scale: Scale, fade: float
    ) -> None:
        """A column of pixels for several steps: each activity has its share of the height."""
        for x in range(row.width):
            start = int(scale.first + x * scale.shown / row.width)
            end = max(start + 1, int(scale.first + (x + 1) * scale.shown / row.width))
            steps = lane[start:end]
            if not steps:
                break
            bottom = float(row.bottom)
            for code in _BY_HEIGHT:
                count = steps.count(code)
                if count:
                    colour, high = _LOOKS[code]
                    height = row.height * high * count / len(steps)
                    top = round(bottom - height)
                    place = (row.left + x, top, 1, max(1, round(bottom) - top))
                    surface.fill(mixed(colour, CARD, fade), place)
                    bottom -= height

    def _marks(
        self,
        surface: pygame.Surface,
        origin: int,
        scale: Scale,
        rows: int,
        head: int,
        followed: int | None,
    ) -> None:
        """The signs of marks, those of one place beside each other; lines where there are many."""
        places = {player: place for place, player in enumerate(self._history.lanes)}
        size = max(5, rows // 3)
        shown = [mark for mark in self._history.marks if scale.first <= mark.step <= scale.last]
        number = Counter(mark.player for mark in shown)
        drawn: set[tuple[int, EntryKind, str]] = set()
        taken: Counter[tuple[int, str]] = Counter()
        for mark in shown:
            place = places.get(mark.player)
            if followed is not None and place not in (None, followed):
                continue
            x = scale.x(mark.step) - origin
            if (x, mark.kind, mark.player) in drawn:
                continue
            drawn.add((x, mark.kind, mark.player))
            top = 1 if place is None else head + place * rows + 2
            if place is not None and number[mark.player] * size > scale.width // 2:
                beside = _LINE[mark.kind] * size // 6
                surface.fill(MARK_COLOURS[mark.kind], (x, top + beside, 1, max(2, size // 2)))
                continue
            draw_mark(surface, mark.kind, (x + taken[x, mark.player] * (size + 2), top), size)
            taken[x, mark.player] += 1


_LINE = {EntryKind.REJECTED: 0, EntryKind.REASONING: 2, EntryKind.SAID: 4}
"""How far down the lines of a kind begin, in sixths: they are seen side by side."""
_BY_HEIGHT = sorted(range(len(ACTIVITIES)), key=lambda code: -_LOOKS[code][1])


def draw_mark(surface: pygame.Surface, kind: EntryKind, top: tuple[int, int], size: int) -> None:
    """A small sign, in the middle below a point: each kind has a shape of its own."""
    x, y = float(top[0]), float(top[1])
    half, colour = size / 2, MARK_COLOURS[kind]
    middle = (x, y + half)
    match kind:
        case EntryKind.REJECTED:
            points = [(x - half, y), (x + half, y), (x, y + size)]
        case EntryKind.REASONING:
            points = [(x, y), (x + half, y + half), (x, y + size), (x - half, y + half)]
        case EntryKind.SAID:
            if size >= _OUTLINED:
                pygame.draw.circle(surface, INK, middle, half + 1)
            pygame.draw.circle(surface, colour, middle, half)
            return
        case EntryKind.PAUSED:
            bar = max(2, size // 3)
            for left in (x - half, x + half - bar):
                surface.fill(colour, (round(left), top[1], bar, size))
            return
        case EntryKind.RESTARTED:
            pygame.draw.circle(surface, colour, middle, half, max(2, size // 4))
            return
        case EntryKind.ENDED:
            surface.fill(TEXT, (top[0] - 1, top[1], 2, size * 2))
            points = [(x, y), (x - size * 1.4, y + half), (x, y + size)]
        case _:
            points = [(x, y), (x + half, y + size), (x - half, y + size)]
    pygame.draw.polygon(surface, colour, points)
    if size >= _OUTLINED:
        pygame.draw.polygon(surface, INK, points, 1)
