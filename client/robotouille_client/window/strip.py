"""A strip along the lower edge of the window, below the kitchen, that somebody else fills."""

from __future__ import annotations

from typing import Protocol

import pygame

from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.view import View

__all__ = ["Strip"]


class Strip(Protocol):
    """What draws in the strip, and is asked first about what its owner does."""

    @property
    def lines(self) -> float:
        """Its height, as a multiple of the window's text size."""

    def draw(
        self, target: pygame.Surface, area: pygame.Rect, text: Typesetter, size: int, view: View
    ) -> None:
        """Fill an area of the window; `size` is that of the window's text."""

    def tick(self) -> None:
        """A frame passes: what goes on by itself, such as a key that is held, goes on."""

    def seen(self) -> object:
        """What can be seen of it, as a value: while that is equal, it looks the same."""

    def handle(self, event: pygame.Event, area: pygame.Rect) -> bool:
        """Whether an event was for the strip, which is the area that it was drawn in."""

    def covers(self, position: tuple[int, int]) -> bool:
        """Whether a pixel of what it was drawn on last shows it, and nothing of the kitchen."""
