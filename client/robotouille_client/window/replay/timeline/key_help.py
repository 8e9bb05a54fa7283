"""The page over the window: the viewer's keys, and what colours and signs mean."""

from __future__ import annotations

from collections.abc import Sequence

import pygame

from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, INK, PANEL, TEXT
from robotouille_client.window.replay.timeline.legend import draw_legend

__all__ = ["draw_key_help"]

MIN_SIZE = 7


def draw_key_help(
    target: pygame.Surface, text: Typesetter, size: int, rows: Sequence[tuple[str, str]]
) -> None:
    """Rows of (key, what it does) on a card with the legend below, smaller where there is little
    room."""
    width, height = target.get_size()
    while size > MIN_SIZE and _height(text, size, rows, width) > height:
        size -= 1
    pad, step = size, text.height(size)
    wide, keys = _width(text, size, rows, width)
    area = pygame.Rect(0, 0, wide, min(height, _height(text, size, rows, width)))
    area.center = (width // 2, height // 2)
    target.blit(box((width, height), (*INK, 130), 0), (0, 0))
    target.blit(box(area.size, PANEL, 12, ACCENT), area)
    target.blit(text.line("Keys of the viewer", size + 3, ACCENT), area.move(pad, pad // 2))
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
    """How wide the card is, and the keys on it."""
    keys = max(text.width(key, size) for key, _ in rows) + size
    words = max(text.width(says, size) for _, says in rows)
    return min(keys + words + 3 * size, most - size), keys


def _height(text: Typesetter, size: int, rows: Sequence[tuple[str, str]], most: int) -> int:
    wide, _ = _width(text, size, rows, most)
    inside = pygame.Rect(0, 0, wide - 2 * size, 0)
    legend = draw_legend(pygame.Surface((1, 1)), inside, text, size)
    return (len(rows) + 3) * text.height(size) + 2 * size + legend + size
