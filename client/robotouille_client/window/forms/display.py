"""The pygame window of a process."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pygame

if TYPE_CHECKING:
    from robotouille_client.window.input.commands import Gamepads
    from robotouille_client.window.input.sounds import Sounds

DESKTOPS = ("XDG_CURRENT_DESKTOP", "DESKTOP_SESSION", "WINDOWMANAGER", "WAYLAND_DISPLAY")
"""Environment variables; desktops with a window manager set at least one of them."""


class Display:
    """Window on the screen, or an invisible one (`headless`).

    `size` is the size while the window does not fill the screen.
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
        """True if there is a surface to draw on."""
        return self._surface is not None

    @property
    def caption(self) -> str:
        """Title of the window."""
        return self._caption

    @caption.setter
    def caption(self, words: str) -> None:
        self._caption = words
        if self._surface is not None:
            pygame.display.set_caption(words)

    @property
    def surface(self) -> pygame.Surface | None:
        """Surface to draw on. It changes with the size of the window."""
        if self._surface is not None:
            # pygame replaces the surface when the window is resized.
            self._surface = pygame.display.get_surface() or self._surface
        return self._surface

    def open(self, icon: pygame.Surface | None = None) -> None:
        """Open the window if it is not open."""
        if self._surface is not None:
            return
        if self.headless:
            # SDL reads the variable in `init`, so it must be set before.
            os.environ["SDL_VIDEODRIVER"] = "dummy"
        pygame.display.init()
        if pygame.display.get_driver() == "x11":
            # Otherwise SDL draws through OpenGL, which is slower where it runs in software.
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
        """Enter or leave full screen."""
        self.fullscreen = not self.fullscreen
        if self._surface is not None:
            self._set_mode()

    def handle(self, event: pygame.Event) -> bool:
        """Handle Alt+Enter and changes of size; return whether the event was Alt+Enter."""
        if event.type == pygame.VIDEORESIZE and not self.fullscreen:
            self._resized((event.w, event.h))
        if event.type != pygame.KEYDOWN or event.key != pygame.K_RETURN:
            return False
        if not event.mod & pygame.KMOD_ALT:
            return False
        self.toggle_fullscreen()
        return True

    def save(self, path: Path | str) -> None:
        """Save the contents as a picture."""
        if self._surface is not None:
            pygame.image.save(self._surface, path)

    def close(self) -> None:
        if self._surface is not None:
            self._surface = None
            pygame.display.quit()

    def _set_mode(self) -> None:
        """Open the window, or change its size."""
        if self.fullscreen and _is_managed():
            self._surface = pygame.display.set_mode((0, 0), pygame.FULLSCREEN)
        elif self.fullscreen:
            if self._surface is None:  # A window must be open before it can be moved.
                pygame.display.set_mode(self.size, pygame.RESIZABLE)
            self._place = pygame.display.get_window_position()
            # Without a window manager, nothing enlarges the window, so a window without a frame
            # covers the screen.
            desktop = pygame.display.get_desktop_sizes()[0]
            self._surface = pygame.display.set_mode(desktop, pygame.NOFRAME)
            pygame.display.set_window_position((0, 0))
        else:
            self._surface = pygame.display.set_mode(self.size, pygame.RESIZABLE)
            if self._place is not None:
                pygame.display.set_window_position(self._place)
                self._place = None

    def _resized(self, size: tuple[int, int]) -> None:
        """Remember the new size.

        The size of the whole screen is ignored: it can be reported late, after leaving full screen.
        """
        if size not in pygame.display.get_desktop_sizes():
            self.size = size


def _is_managed() -> bool:
    """Return whether a window manager is likely to run.

    On X, only a window manager can make a window full screen. SDL waits for one in vain and
    leaves the window as it is. Desktops announce themselves in the environment.
    """
    return pygame.display.get_driver() != "x11" or any(map(os.environ.get, DESKTOPS))


@dataclass(frozen=True, slots=True)
class Devices:
    """Devices that several windows share. A shared display stays open when a window closes."""

    display: Display | None = None
    gamepads: Gamepads | None = None
    sounds: Sounds | None = None
