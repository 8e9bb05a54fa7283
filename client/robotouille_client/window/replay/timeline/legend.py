"""Legend of the lanes: a colour, height and pattern for each activity, a sign for each mark."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import pygame

from robotouille.episode.tallies import Activity
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import (
    ACCENT,
    BAD,
    CARD,
    FAINT,
    GOOD,
    INK,
    PANEL,
    PAPER,
    TEXT,
    Colour,
    mixed,
)
from robotouille_client.window.replay.histories.history import ACTIVITIES, EntryKind

# Ground of the lanes.
TRACK: Colour = mixed(CARD, INK, 0.25)


class ActivityLook(NamedTuple):
    """Look of an activity. Colour, height and pattern each identify it alone.

    Attributes:
        height: Share of the lane's height.
        pattern: Rows of a small repeated picture, in which `#` is darker.
    """

    colour: Colour
    height: float
    words: str
    pattern: tuple[str, ...] = ()

    @property
    def darker(self) -> Colour:
        """Colour of the pattern."""
        return mixed(self.colour, INK, 0.55)


ACTIVITY_LOOKS: dict[Activity, ActivityLook] = {
    Activity.ACTED: ActivityLook((148, 240, 160), 1.0, "acting"),
    Activity.BUSY: ActivityLook((84, 98, 240), 0.72, "busy", ("#...", "...#", "..#.", ".#..")),
    Activity.WAITING: ActivityLook((200, 106, 56), 0.46, "waiting", ("#..", "#..", "#..")),
    Activity.IDLE: ActivityLook((172, 168, 178), 0.2, "idle"),
    Activity.AWAY: ActivityLook((84, 78, 92), 0.1, "away", ("##...",)),
    Activity.SUBSTITUTED: ActivityLook(
        (180, 146, 232), 0.72, "substitute", ("....", "##..", "##..", "....")
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
    EntryKind.SAID: "chat",
    EntryKind.REASONING: "reasoning",
    EntryKind.PAUSED: "pause",
    EntryKind.RESTARTED: "restart",
    EntryKind.ANNOUNCED: "announcement",
    EntryKind.ENDED: "the end",
}
# Pixels from which a sign has an outline.
OUTLINED = 9


@lru_cache(maxsize=128)
def textured(look: ActivityLook, size: tuple[int, int], fade: float = 0.0) -> pygame.Surface:
    """Return an area in the look of an activity, faded towards the ground.

    The surface is shared: do not draw on it.
    """
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
    """Draw a small sign, centred below a point. Each kind has its own shape."""
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
    """Draw the meanings of blocks and marks that fit. Return the height that all would need."""
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


MIN_SIZE = 7


def draw_key_help(
    target: pygame.Surface, text: Typesetter, size: int, rows: Sequence[tuple[str, str]]
) -> None:
    """Draw a card with rows of keys and the legend, smaller if room is short."""
    width, height = target.get_size()
    while size > MIN_SIZE and _height(text, size, rows, width) > height:
        size -= 1
    pad, step = size, text.height(size)
    wide, keys = _width(text, size, rows, width)
    area = pygame.Rect(0, 0, wide, min(height, _height(text, size, rows, width)))
    area.center = (width // 2, height // 2)
    target.blit(box((width, height), (*INK, 130), 0), (0, 0))
    target.blit(box(area.size, PANEL, 12, ACCENT), area)
    target.blit(text.line("Keys", size + 3, ACCENT), area.move(pad, pad // 2))
    y = area.y + pad + step * 3 // 2
    for key, says in rows:
        target.blit(text.line(key, size, ACCENT), (area.x + pad, y))
        room = area.width - keys - 2 * pad
        target.blit(text.line(text.fit(says, size, room), size, TEXT), (area.x + pad + keys, y))
        y += step
    y += step // 2
    target.blit(text.line("Colours and signs", size, ACCENT), (area.x + pad, y))
    legend = pygame.Rect(area.x + pad, y + step, area.width - 2 * pad, area.bottom - y - step)
    draw_legend(target, legend, text, size)


def _width(
    text: Typesetter, size: int, rows: Sequence[tuple[str, str]], most: int
) -> tuple[int, int]:
    """Return the width of the card, and of its keys."""
    keys = max(text.width(key, size) for key, _ in rows) + size
    words = max(text.width(says, size) for _, says in rows)
    return min(keys + words + 3 * size, most - size), keys


def _height(text: Typesetter, size: int, rows: Sequence[tuple[str, str]], most: int) -> int:
    wide, _ = _width(text, size, rows, most)
    inside = pygame.Rect(0, 0, wide - 2 * size, 0)
    legend = draw_legend(pygame.Surface((1, 1)), inside, text, size)
    return (len(rows) + 3) * text.height(size) + 2 * size + legend + size
