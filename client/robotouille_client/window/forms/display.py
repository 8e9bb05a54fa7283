"""The pygame window of a process: opened once, made larger or full by its owner, closed once."""

from __future__ import annotations

import os
from pathlib import Path

import pygame

__all__ = ["DESKTOPS", "Display"]


DESKTOPS = ("XDG_CURRENT_DESKTOP", "DESKTOP_SESSION", "WINDOWMANAGER", "WAYLAND_DISPLAY")
"""Variables of which one is set where a desktop manages windows."""


class Display:
    """A window on the screen, or the same without one (`headless`).

    `size` is that of the window while it does not fill the screen.
    """

    def __init__(
        self,
        size: tuple[int, int] = (1280, 720),
        *,
        caption: str = "Robotouille",
        headless: bool = False,
        fullscreen: bool = False,
    ) -> None:
        self.size = size
        self.headless = headless
        self.fullscreen = fullscreen
        self._caption = caption
        self._surface: pygame.Surface | None = None
        self._place: tuple[int, int] | None = None

    @property
    def is_open(self) -> bool:
        """Whether there is anything to draw on."""
        return self._surface is not None

    @property
    def caption(self) -> str:
        """The words in the window's title."""
        return self._caption

    @caption.setter
    def caption(self, words: str) -> None:
        self._caption = words
        if self._surface is not None:
            pygame.display.set_caption(words)

    @property
    def surface(self) -> pygame.Surface | None:
        """What is drawn on; another one after each change of size."""
        if self._surface is not None:
            self._surface = pygame.display.get_surface() or self._surface
        return self._surface

    def open(self, icon: pygame.Surface | None = None) -> None:
        """Open the window, unless it is."""
        if self._surface is not None:
            return
        if self.headless:
            os.environ["SDL_VIDEODRIVER"] = "dummy"
        pygame.display.init()
        if pygame.display.get_driver() == "x11":
            # Else SDL gives each picture to OpenGL, which may well be software and costs more.
            os.environ.setdefault("SDL_FRAMEBUFFER_ACCELERATION", "0")
        pygame.font.init()
        if icon is not None:
            pygame.display.set_icon(icon)
        self._set_mode()
        pygame.display.set_caption(self._caption)

    def flip(self) -> None:
        """Show what was drawn."""
        if self._surface is not None:
            pygame.display.flip()

    def toggle_fullscreen(self) -> None:
        """Fill the screen, or no longer."""
        self.fullscreen = not self.fullscreen
        if self._surface is not None:
            self._set_mode()

    def handle(self, event: pygame.Event) -> bool:
        """Whether an event was for the display: Alt+Enter fills the screen."""
        if event.type == pygame.VIDEORESIZE and not self.fullscreen:
            self._resized((event.w, event.h))
        if event.type != pygame.KEYDOWN or event.key != pygame.K_RETURN:
            return False
        if not event.mod & pygame.KMOD_ALT:
            return False
        self.toggle_fullscreen()
        return True

    def save(self, path: Path | str) -> None:
        """Save what is shown as a picture."""
        if self._surface is not None:
            pygame.image.save(self._surface, path)

    def close(self) -> None:
        """Close the window."""
        if self._surface is not None:
            self._surface = None
            pygame.display.quit()

    def _set_mode(self) -> None:
        """Open the window, or change its size."""
        if self.fullscreen and _is_managed():
            self._surface = pygame.display.set_mode((0, 0), pygame.FULLSCREEN)
        elif self.fullscreen:
            if self._surface is None:  # What is not open cannot be moved.
                pygame.display.set_mode(self.size, pygame.RESIZABLE)
            self._place = pygame.display.get_window_position()
            desktop = pygame.display.get_desktop_sizes()[0]
            self._surface = pygame.display.set_mode(desktop, pygame.NOFRAME)
            pygame.display.set_window_position((0, 0))
        else:
            self._surface = pygame.display.set_mode(self.size, pygame.RESIZABLE)
            if self._place is not None:
                pygame.display.set_window_position(self._place)
                self._place = None

    def _resized(self, size: tuple[int, int]) -> None:
        """Note the size that the owner has given the window; that of the whole screen may be told
        late, when it is left."""
        if size not in pygame.display.get_desktop_sizes():
            self.size = size


def _is_managed() -> bool:
    """Whether there is a window manager, which alone can fill an X screen with a window: asked to,
    SDL waits for one, and leaves the window where it is. Desktops say that they are there."""
    return pygame.display.get_driver() != "x11" or any(map(os.environ.get, DESKTOPS))
