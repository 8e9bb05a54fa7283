"""A form beside the kitchen, and what of all that is pressed in a game is meant for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import pygame

from robotouille_client.window.forms.form import Form
from robotouille_client.window.hands.commands import Command, KeyMap

__all__ = ["QUIET_SECONDS", "ShownCard"]

QUIET_SECONDS = 0.7
"""Without a key of the game, after which a card that came by itself listens: who plays is still
pressing keys."""
_WINDOW_COMMANDS = (Command.FULLSCREEN, Command.SCREENSHOT, Command.SOUND)
"""What is the window's, whatever it shows."""
_NOT_REPEATED = (Command.ENTER, Command.CANCEL)
"""What does nothing in a game that would be pressed again and again."""


class ShownCard:
    """A `form` that one has asked for, or that came `by_itself`, at the end of a game.

    Letters and the space bar, which play, are never for it: it takes arrows, Enter and Esc, the
    mouse and gamepads. One that came by itself is not for those who still play, or type: what is
    pressed before it `listens` does nothing, and makes it wait again, as letters always do. A key
    that is held since before, one of `held`, is not pressed.

    Args:
        at_once: Whether it listens from the beginning, e.g. since one comes back to it.
    """

    def __init__(
        self,
        form: Form,
        clock: Callable[[], float],
        *,
        by_itself: bool = False,
        at_once: bool = False,
        held: Iterable[int] = (),
    ) -> None:
        self.form = form
        self.by_itself = by_itself
        self._clock = clock
        self._held = set(held)
        patience = QUIET_SECONDS if by_itself and not at_once else 0.0
        self._mouse_from = self._keys_from = clock() + patience

    @property
    def listens(self) -> bool:
        """Whether keys and buttons are for the form."""
        return self._clock() >= self._keys_from

    def wait(self) -> None:
        """Something was pressed that is not for the form: who did that may not be done."""
        if self.by_itself:
            self._keys_from = max(self._keys_from, self._clock() + QUIET_SECONDS)

    def handle(self, event: pygame.Event, pressed: Command | None, keys: KeyMap) -> Command | None:
        """Follow an event, which a gamepad may have `pressed` a command with; a command that is
        not for the form comes back."""
        if event.type == pygame.KEYUP:
            self._held.discard(event.key)
        elif event.type == pygame.WINDOWFOCUSLOST:
            self._held.clear()
        if pressed is not None:
            return self.form.command(pressed) if self._hears(pressed) else None
        if event.type == pygame.KEYDOWN:
            return self._key(event, keys)
        heard = self._clock() >= self._mouse_from and event.type != pygame.TEXTINPUT
        return self.form.handle(event, keys) if heard else None

    def _key(self, event: pygame.Event, keys: KeyMap) -> Command | None:
        name = pygame.key.name(event.key).casefold()
        asked, letter = keys.command(name), len(name) == 1 or name == "space"
        if event.key in self._held:
            return None
        if asked in _WINDOW_COMMANDS and (self.listens or not letter):
            return asked
        if letter:
            self.wait()
            return None
        return self.form.handle(event, keys) if self._hears(asked) else None

    def _hears(self, asked: Command | None) -> bool:
        """Whether what is pressed now is for the form; who plays presses more."""
        listens = self.listens
        if not (listens or asked in _NOT_REPEATED):
            self.wait()
        return listens
