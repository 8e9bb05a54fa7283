"""What the pointer tells, on a card near it."""

from __future__ import annotations

from collections.abc import Sequence

import pygame

from robotouille.episode.tallies import Activity
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, INK, PAPER, TEXT, mixed
from robotouille_client.window.replay.history.history import History
from robotouille_client.window.replay.timeline.words import entry_words, name_of, time_words

__all__ = ["draw_tooltip", "told_at"]

MAX_TOLD = 5
"""Entries that the pointer tells of."""
MAX_WIDTH = 26
"""Of a card, as a multiple of the text size."""
_DOES = {
    Activity.ACTED: "acted",
    Activity.BUSY: "was working or walking",
    Activity.WAITING: "was waiting, or was refused something",
    Activity.IDLE: "did nothing",
    Activity.AWAY: "was away",
    Activity.SUBSTITUTED: "had a stand-in",
}


def told_at(history: History, step: int, player: str | None, left: str) -> list[str]:
    """Step and time, what a seat did in it, and what happened; without a player, to anybody.

    Args:
        left: What is known of the steps to go.
    """
    step = min(step, history.length)
    head = f"Step {step} · {time_words(history.times[step])}{f' · {left}' if left else ''}"
    if player is None:
        entries = history.entries(step)
        told = [_line(history, entry.player, step, entry_words(entry)) for entry in entries]
    else:
        entries = tuple(e for e in history.entries(step) if e.player in (player, ""))
        told = [f"{name_of(history, player, step)} {_does(history, player, step)}"]
        told += map(entry_words, entries)
    more = [f"and {len(told) - MAX_TOLD} more"] if len(told) > MAX_TOLD else []
    return [head, *told[:MAX_TOLD], *more]


def _does(history: History, player: str, step: int) -> str:
    if not step:
        return "has not begun"
    did = history.activity(player, step)
    return "was not seen" if did is None else _DOES[did]


def _line(history: History, player: str, step: int, words: str) -> str:
    return f"{name_of(history, player, step)}: {words}" if player else words


def draw_tooltip(
    target: pygame.Surface,
    room: pygame.Rect,
    at: tuple[int, int],
    told: Sequence[str],
    text: Typesetter,
    size: int,
) -> None:
    """A card above a point, within the room that there is; its first line is the heading."""
    small, pad = max(10, size - 1), size // 2
    most = max(size, min(room.width - 2 * size, MAX_WIDTH * size))
    lines = [line for words in told for line in text.wrap(words, small, most, 2)]
    high = text.height(small)
    width = max(text.width(line, small) for line in lines) + 2 * pad
    card = pygame.Rect(0, 0, width, high * len(lines) + pad)
    card.midbottom = at
    card.clamp_ip(room)
    target.blit(box(card.size, (*INK, 240), 6, mixed(INK, PAPER, 0.4)), card)
    for i, line in enumerate(lines):
        drawn = text.line(line, small, ACCENT if i == 0 else TEXT)
        target.blit(drawn, (card.x + pad, card.y + pad // 2 + i * high))
