"""The pygame window of a process, and the loop that shows one form after another in it."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pygame

from robotouille.files.writing import replace_file
from robotouille.installation import data_folder
from robotouille_client.window.forms.form import Form
from robotouille_client.window.input.commands import Command, Gamepads, KeyMap
from robotouille_client.window.pictures.fonts import printable
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, BACKGROUND, FAINT
from robotouille_client.window.preferences import Preferences

if TYPE_CHECKING:
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
        self._caption = printable(caption)
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
        # A server chooses codes and names, and SDL accepts neither NUL nor lone surrogates.
        self._caption = printable(words)
        if self._surface is not None:
            pygame.display.set_caption(self._caption)

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

    def save(self, path: Path) -> None:
        """Save the contents as a picture, which replaces a link at the path."""
        if self._surface is not None:
            content = BytesIO()
            pygame.image.save(self._surface, content, path.name)
            replace_file(path, content.getvalue())

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


TITLE = "title.svg"
"""Picture of the name of the game, in the assets."""
FIRST, NEXT = 24, 3
"""Frames until a held key repeats for the first time, and between later repetitions."""
_KEYS = (
    pygame.K_LEFT, pygame.K_RIGHT, pygame.K_UP, pygame.K_DOWN, pygame.K_PAGEUP,
    pygame.K_PAGEDOWN, pygame.K_BACKSPACE, pygame.K_DELETE,
)  # fmt: skip
"""Keys that repeat. Enter and Escape do not: holding them must not answer the next form."""


class KeyRepeat:
    """Repetition of a held key or gamepad direction, counted in frames."""

    def __init__(self) -> None:
        self._key: pygame.Event | None = None
        self._pad: Command | None = None
        self._frames = 0

    def track(self, event: pygame.Event) -> None:
        """Track which key is held; losing the keyboard focus releases it."""
        if event.type == pygame.KEYDOWN:
            self._key = event if event.key in _KEYS else None
            self._frames = 0
        elif event.type in (pygame.KEYUP, pygame.WINDOWFOCUSLOST):
            self._key = None

    def due(self, pad: Command | None) -> pygame.Event | Command | None:
        """Return the key or direction `pad` that repeats in this frame."""
        if pad is not self._pad:
            self._pad, self._frames = pad, 0
        held = self._key or self._pad
        if held is None:
            return None
        self._frames += 1
        late = self._frames - FIRST
        return held if late >= 0 and late % NEXT == 0 else None


FRAME_SECONDS = 1 / 60
HIGH = 30
"""Height of a window, in text heights, from which the title is shown above a form."""
QUIET_FRAMES = 6
"""Frames without an event until slow work, such as loading pictures, is done."""


class WindowClosedError(Exception):
    """The player closed the window while a form was shown."""


def text_size(size: tuple[int, int], scale: float) -> int:
    """Return the text height for a window size."""
    return max(11, round(min(size[1] / 40, size[0] / 54) * scale))


class Screen:
    """Display that shows forms until each has a result."""

    def __init__(
        self,
        display: Display,
        *,
        preferences: Preferences = Preferences(),
        gamepads: Gamepads | None = None,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self.display = display
        self.prefer(preferences)
        self.gamepads = gamepads or Gamepads()
        self._sleep = sleep
        self._text: Typesetter | None = None

    def prefer(self, preferences: Preferences) -> None:
        self._preferences, self.keys = preferences, KeyMap(preferences.keys)

    def splash(self, words: str) -> None:
        """Show a few words in an otherwise empty window while something loads."""
        self.display.open()
        surface = self.display.surface
        if surface is not None:
            self._background(surface, titled=True)
            line = self._typesetter().line(words, 2 * text_size(surface.get_size(), 1.0), ACCENT)
            surface.blit(line, line.get_rect(center=surface.get_rect().center))
            self.display.flip()

    async def ask(self, form: Form, until: asyncio.Future[Any] | None = None) -> object:
        """Show a form until it has a result, or return None when `until` is done.

        Raises:
            WindowClosedError: The player closed the window.
        """
        self.display.open()
        shown: tuple[object, ...] = ()
        quiet, repeats = 0, KeyRepeat()
        while form.result is None and not (until is not None and until.done()):
            events = pygame.event.get()
            for number, event in enumerate(events, 1):
                repeats.track(event)
                self._handle(event, form)
                if form.result is not None:
                    _give_back(events[number:])
                    return form.result
            again = repeats.due(self.gamepads.held)
            if again is not None:
                self._again(again, form)
            surface = self.display.surface
            quiet = 0 if events or again else quiet + 1
            # Loading a picture may take longer than a frame; a held key would stutter.
            late = quiet >= QUIET_FRAMES and form.idle()
            looks = (form.message, surface.get_size() if surface else None)
            # Drawing only after changes keeps an idle menu from using the processor.
            if quiet == 0 or late or looks != shown:
                self.draw(form)
                shown = looks
            if form.result is None:
                await self._sleep(FRAME_SECONDS)
        return form.result

    def _handle(self, event: pygame.Event, form: Form) -> None:
        if event.type == pygame.QUIT:
            raise WindowClosedError
        if self.display.handle(event):
            return
        pressed = self.gamepads.read(event)
        form.message = self.gamepads.notice(event) or form.message
        if pressed is not None:
            form.command(pressed)
        elif form.handle(event, self.keys) is Command.FULLSCREEN:
            self.display.toggle_fullscreen()

    def _again(self, held: pygame.Event | Command, form: Form) -> None:
        if isinstance(held, Command):
            form.command(held)
        else:
            form.handle(held, self.keys)

    def draw(self, form: Form) -> None:
        surface = self.display.surface
        if surface is None:
            return
        width, height = surface.get_size()
        size = text_size((width, height), self._preferences.text_scale)
        self._background(surface, titled=height >= HIGH * size)
        above = 4 * size if height >= HIGH * size else size // 2
        below = size if height >= HIGH * size else size // 2
        area = pygame.Rect(0, 0, min(width - size, form.width(size)), height - above - below)
        area.midtop = (width // 2, above)
        form.draw(surface, area, self._typesetter(), size)
        self.display.flip()

    def _background(self, surface: pygame.Surface, *, titled: bool) -> None:
        surface.fill(BACKGROUND)
        width, height = surface.get_size()
        size = text_size((width, height), 1.0)
        text = self._typesetter()
        if not titled:
            return
        title = _title(size * 3) or text.line("Robotouille", size * 2, ACCENT)
        surface.blit(title, title.get_rect(midtop=(width // 2, size // 2)))
        foot = text.line("F11: full screen", max(10, size - 4), FAINT)
        # In a narrow window, the hint would cover the title.
        if title.get_width() + 2 * (foot.get_width() + size) < width:
            surface.blit(foot, foot.get_rect(topright=(width - size, size)))

    def _typesetter(self) -> Typesetter:
        if self._text is None:
            self._text = Typesetter()
        self._text.strong = self._preferences.strong_contrast
        return self._text


# The picture is drawn again only when the size of the window changes.
@lru_cache(maxsize=4)
def _title(height: int) -> pygame.Surface | None:
    """Return the name of the game as a picture; None if the installation is incomplete."""
    try:
        return pygame.image.load_sized_svg(data_folder("assets") / TITLE, (20 * height, height))
    except (pygame.error, OSError):
        return None


def _give_back(events: list[pygame.Event]) -> None:
    """Post events again that came after a form's result, for whatever is shown next."""
    for event in events:
        pygame.event.post(event)
