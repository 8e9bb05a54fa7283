"""What the lanes are drawn with: a colour, a height and a pattern for each activity, a sign for
each kind of mark; and what they are called."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import pygame

from robotouille.episode.tallies import Activity
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    BAD,
    CARD,
    FAINT,
    GOOD,
    INK,
    PAPER,
    TEXT,
    Colour,
    mixed,
)
from robotouille_client.window.replay.history.history import ACTIVITIES, EntryKind

__all__ = [
    "ACTIVITY_LOOKS",
    "MARK_COLOURS",
    "MARK_WORDS",
    "TRACK",
    "ActivityLook",
    "draw_legend",
    "draw_mark",
    "textured",
]

TRACK: Colour = mixed(CARD, INK, 0.25)
"""Behind the lanes."""


class ActivityLook(NamedTuple):
    """How an activity is drawn: `height` is a share of the lane's; `pattern` the rows of a small
    picture that is repeated, in which `#` is darker. Colours, heights and patterns each say the
    same."""

    colour: Colour
    height: float
    words: str
    pattern: tuple[str, ...] = ()

    @property
    def darker(self) -> Colour:
        """The colour of the pattern."""
        return mixed(self.colour, INK, 0.55)


ACTIVITY_LOOKS: dict[Activity, ActivityLook] = {
    Activity.ACTED: ActivityLook((148, 240, 160), 1.0, "acting"),
    Activity.BUSY: ActivityLook((84, 98, 240), 0.72, "working", ("#...", "...#", "..#.", ".#..")),
    Activity.WAITING: ActivityLook((200, 106, 56), 0.46, "waiting", ("#..", "#..", "#..")),
    Activity.IDLE: ActivityLook((172, 168, 178), 0.2, "idle"),
    Activity.AWAY: ActivityLook((84, 78, 92), 0.1, "away", ("##...",)),
    Activity.SUBSTITUTED: ActivityLook(
        (180, 146, 232), 0.72, "stand-in", ("....", "##..", "##..", "....")
    ),
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
MARK_WORDS: dict[EntryKind, str] = {
    EntryKind.REJECTED: "rejected",
    EntryKind.SAID: "said",
    EntryKind.REASONING: "reasoning",
    EntryKind.PAUSED: "pause",
    EntryKind.RESTARTED: "restart",
    EntryKind.ANNOUNCED: "announced",
    EntryKind.ENDED: "the end",
}
OUTLINED = 9
"""Pixels from which on a sign has an outline."""


@lru_cache(maxsize=128)
def textured(look: ActivityLook, size: tuple[int, int], fade: float = 0.0) -> pygame.Surface:
    """An area in the look of an activity, mixed with so much of the ground; do not draw on it, it
    is shared."""
    surface = pygame.Surface(size)
    surface.fill(mixed(look.colour, CARD, fade))
    if not look.pattern:
        return surface
    high, wide = len(look.pattern), len(look.pattern[0])
    tile = pygame.Surface((wide, high))
    tile.fill(mixed(look.colour, CARD, fade))
    for y, row in enumerate(look.pattern):
        for x, dot in enumerate(row):
            if dot == "#":
                tile.set_at((x, y), mixed(look.darker, CARD, fade))
    for y in range(size[1] - high, -high, -high):
        surface.blits([(tile, (x, y)) for x in range(0, size[0], wide)], doreturn=False)
    return surface


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
            if size >= OUTLINED:
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
    if size >= OUTLINED:
        pygame.draw.polygon(surface, INK, points, 1)


def draw_legend(target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int) -> int:
    """What blocks and marks mean, in as many lines as fit; how high all of them would be."""
    line = text.height(size) + 2
    x, y = area.x, area.y
    signs: list[Activity | EntryKind] = [*_SHOWN, *MARK_WORDS]
    for sign in signs:
        words = MARK_WORDS[sign] if isinstance(sign, EntryKind) else ACTIVITY_LOOKS[sign].words
        drawn = text.line(words, size, FAINT)
        wide = size * 3 // 2 + drawn.get_width() + size
        if x + wide - size > area.right and x > area.x:
            x, y = area.x, y + line
        if y + line <= area.bottom:
            _sign(target, sign, pygame.Rect(x, y, size, size))
            target.blit(drawn, (x + size * 3 // 2, y))
        x += wide
    return y + line - area.y


_SHOWN = sorted(ACTIVITIES, key=lambda activity: -ACTIVITY_LOOKS[activity].height)


def _sign(target: pygame.Surface, sign: Activity | EntryKind, area: pygame.Rect) -> None:
    if isinstance(sign, EntryKind):
        size = max(6, area.height * 2 // 3)
        draw_mark(target, sign, (area.centerx, area.centery - size // 2), size)
        return
    look = ACTIVITY_LOOKS[sign]
    high = max(2, round(area.height * look.height))
    target.fill(TRACK, area)
    target.blit(textured(look, (area.width, high)), (area.x, area.bottom - high))
