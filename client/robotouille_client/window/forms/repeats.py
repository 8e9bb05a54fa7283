"""What is held goes on: arrows, pages and erasing in forms, a direction of a gamepad."""

from __future__ import annotations

import pygame

from robotouille_client.window.hands.commands import Command

__all__ = ["Repeats"]

FIRST, NEXT = 24, 3
"""Frames from a press to its first repetition, and from one to the next."""
_KEYS = (
    pygame.K_LEFT, pygame.K_RIGHT, pygame.K_UP, pygame.K_DOWN, pygame.K_PAGEUP,
    pygame.K_PAGEDOWN, pygame.K_BACKSPACE, pygame.K_DELETE,
)  # fmt: skip
"""Not Enter, nor Escape: who holds them does not mean the next form."""


class Repeats:
    """Counts the frames for which a key, or a direction of a gamepad, is held."""

    def __init__(self) -> None:
        self._key: pygame.Event | None = None
        self._pad: Command | None = None
        self._frames = 0

    def note(self, event: pygame.Event) -> None:
        """Follow a key down and up; a window that nobody types into has none down."""
        if event.type == pygame.KEYDOWN:
            self._key = event if event.key in _KEYS else None
            self._frames = 0
        elif event.type in (pygame.KEYUP, pygame.WINDOWFOCUSLOST):
            self._key = None

    def due(self, pad: Command | None) -> pygame.Event | Command | None:
        """What is pressed once more in this frame; `pad` is the direction that is held there."""
        if pad is not self._pad:
            self._pad, self._frames = pad, 0
        held = self._key or self._pad
        if held is None:
            return None
        self._frames += 1
        late = self._frames - FIRST
        return held if late >= 0 and late % NEXT == 0 else None
