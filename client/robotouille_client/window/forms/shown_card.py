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
_WINDOWS = (Command.FULLSCREEN, Command.SCREENSHOT, Command.SOUND)
"""What is the window's, whatever it shows."""
_NEVER_PLAYS = (Command.ENTER, Command.CANCEL)
"""What does nothing in a game that would be pressed again and again."""


class ShownCard:
    """A `form` that one has asked for, or that came `by_itself`, at the end of a game.

    The latter is not for those who still play, or type: what is pressed before it `listens` does
    nothing and, as letters and the space bar always do, makes it wait again. A key that is held
    since before, one of `held`, is not pressed.

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
        self._keys_from = max(self._keys_from, self._clock() + QUIET_SECONDS)

    def handle(self, event: pygame.Event, pressed: Command | None, keys: KeyMap) -> Command | None:
        """Follow an event, which a gamepad may have `pressed` a command with; a command that is
        not for the form comes back."""
        if not self.by_itself:
            return self._follow(event, pressed, keys)
        if event.type == pygame.KEYUP:
            self._held.discard(event.key)
        if pressed is None and event.type != pygame.KEYDOWN:
            heard = self._clock() >= self._mouse_from and event.type != pygame.TEXTINPUT
            return self._follow(event, pressed, keys) if heard else None
        if pressed is None and event.key in self._held:
            return None
        name = "" if pressed else pygame.key.name(event.key).casefold()
        asked, letter = pressed or keys.command(name), len(name) == 1 or name == "space"
        listens = self.listens
        if letter or (not listens and asked not in (*_NEVER_PLAYS, *_WINDOWS)):
            self.wait()
        if asked in _WINDOWS and (listens or not letter):
            return asked
        return self._follow(event, pressed, keys) if listens and not letter else None

    def _follow(self, event: pygame.Event, pressed: Command | None, keys: KeyMap) -> Command | None:
        return self.form.handle(event, keys) if pressed is None else self.form.command(pressed)
