"""Forms that fill the window, one at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pygame

from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.form import Form
from robotouille_client.window.input.commands import Command, Gamepads, KeyMap
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, BACKGROUND, FAINT
from robotouille_client.window.preferences import Preferences

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
            self._background(surface, words)
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
        self._background(surface, "Robotouille" if height >= HIGH * size else "")
        above = 4 * size if height >= HIGH * size else size // 2
        below = size if height >= HIGH * size else size // 2
        area = pygame.Rect(0, 0, min(width - size, form.width(size)), height - above - below)
        area.midtop = (width // 2, above)
        form.draw(surface, area, self._typesetter(), size)
        self.display.flip()

    def _background(self, surface: pygame.Surface, words: str) -> None:
        surface.fill(BACKGROUND)
        width, height = surface.get_size()
        size = text_size((width, height), 1.0)
        text = self._typesetter()
        if not words:
            return
        title = text.line(words, size * 2, ACCENT)
        surface.blit(title, title.get_rect(midtop=(width // 2, size)))
        foot = text.line("F11: full screen", max(10, size - 4), FAINT)
        # In a narrow window, the hint would cover the title.
        if title.get_width() + 2 * (foot.get_width() + size) < width:
            surface.blit(foot, foot.get_rect(topright=(width - size, size)))

    def _typesetter(self) -> Typesetter:
        if self._text is None:
            self._text = Typesetter()
        self._text.strong = self._preferences.strong_contrast
        return self._text


def _give_back(events: list[pygame.Event]) -> None:
    """Post events again that came after a form's result, for whatever is shown next."""
    for event in events:
        pygame.event.post(event)
