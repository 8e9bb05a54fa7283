"""Forms that fill the window, one at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pygame

from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.repeats import Repeats
from robotouille_client.window.hands.commands import Command, KeyMap
from robotouille_client.window.hands.gamepad import Gamepads
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import ACCENT, BACKGROUND, FAINT
from robotouille_client.window.preferences import Preferences

__all__ = ["ClosedByOwnerError", "Screen", "text_size"]

FRAME_SECONDS = 1 / 60
HIGH = 30
"""Of a window that has room for more than a form, in letters' heights."""
QUIET_FRAMES = 6
"""Without an event, after which what may be late is done: nobody waits for it with a key."""


class ClosedByOwnerError(Exception):
    """The window was closed while something was asked."""


def text_size(size: tuple[int, int], scale: float) -> int:
    """The height of letters in a window of a size."""
    return max(11, round(min(size[1] / 40, size[0] / 54) * scale))


class Screen:
    """Asks forms in a display until each has a result."""

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
        """Draw and listen as they have it from now on."""
        self._preferences, self.keys = preferences, KeyMap(preferences.keys)

    def splash(self, words: str) -> None:
        """Words in an otherwise empty window, while something is loaded."""
        self.display.open()
        surface = self.display.surface
        if surface is not None:
            self._background(surface, words)
            self.display.flip()

    async def ask(self, form: Form, until: asyncio.Future[Any] | None = None) -> object:
        """Show a form until it has a result, or `until` is done: then None.

        Raises:
            ClosedByOwnerError: The window was closed.
        """
        self.display.open()
        shown: tuple[object, ...] = ()
        quiet, repeats = 0, Repeats()
        while form.result is None and not (until is not None and until.done()):
            events = pygame.event.get()
            for number, event in enumerate(events, 1):
                repeats.note(event)
                self._handle(event, form)
                if form.result is not None:
                    _give_back(events[number:])
                    return form.result
            again = repeats.due(self.gamepads.held)
            if again is not None:
                self._again(again, form)
            surface = self.display.surface
            quiet = 0 if events or again else quiet + 1
            late = quiet >= QUIET_FRAMES and form.idle()
            looks = (form.message, surface.get_size() if surface else None)
            if quiet == 0 or late or looks != shown:
                self.draw(form)
                shown = looks
            if form.result is None:
                await self._sleep(FRAME_SECONDS)
        return form.result

    def _handle(self, event: pygame.Event, form: Form) -> None:
        if event.type == pygame.QUIT:
            raise ClosedByOwnerError
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
        """Show a form as it is now."""
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
        foot = text.line("F11 fills the screen", max(10, size - 4), FAINT)
        if title.get_width() + 2 * (foot.get_width() + size) < width:
            surface.blit(foot, foot.get_rect(topright=(width - size, size)))

    def _typesetter(self) -> Typesetter:
        if self._text is None:
            self._text = Typesetter()
        self._text.strong = self._preferences.strong_contrast
        return self._text


def _give_back(events: list[pygame.Event]) -> None:
    """What was done after a form had its answer is for what comes next."""
    for event in events:
        pygame.event.post(event)
