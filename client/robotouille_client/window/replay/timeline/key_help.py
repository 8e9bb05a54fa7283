"""The page of keys over the window."""

from __future__ import annotations

from collections.abc import Sequence

import pygame

from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, INK, PANEL, TEXT

__all__ = ["draw_key_help"]


def draw_key_help(
    target: pygame.Surface, text: Typesetter, size: int, rows: Sequence[tuple[str, str]]
) -> None:
    """Rows of (key, what it does) on a card, smaller where there is little room."""
    width, height = target.get_size()
    while size > 8 and (len(rows) + 3) * text.height(size) + 2 * size > height:
        size -= 1
    pad, step = size, text.height(size)
    keys = max(text.width(key, size) for key, _ in rows) + pad
    words = max(text.width(says, size) for _, says in rows)
    area = pygame.Rect(0, 0, keys + words + 3 * pad, (len(rows) + 1) * step + 5 * pad // 2)
    area.width = min(area.width, width - pad)
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
