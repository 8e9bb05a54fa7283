"""Input of a second person at the same window: the arrow keys or a gamepad."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import pygame

from robotouille_client.window.drawing.window_layout import ActionMark, KeyRows
from robotouille_client.window.input.commands import DIRECTIONS, Command, KeyMap, key_words
from robotouille_client.window.input.controls import Controls, use
from robotouille_client.window.input.input_controller import InputController
from robotouille_client.window.view import GameSource, View

COMPANION_KEYS: Mapping[str, Command] = {
    "left": Command.LEFT,
    "right": Command.RIGHT,
    "up": Command.UP,
    "down": Command.DOWN,
    "right shift": Command.USE,
    "right ctrl": Command.USE,
}
"""Keys of the second person. The first person walks with letters then."""


class CompanionInput:
    """Walks and work of the player `View.companion`."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._controller = InputController(KeyMap(), clock)

    def takes(self, event: pygame.Event, view: View) -> bool:
        """Return whether a key event is for the companion."""
        pressed = event.type in (pygame.KEYDOWN, pygame.KEYUP)
        return view.companion is not None and pressed and _name(event) in COMPANION_KEYS

    def handle(
        self, event: pygame.Event, controls: Controls, source: GameSource, view: View
    ) -> str:
        """Handle a key of the companion; return a notice, or ""."""
        command = COMPANION_KEYS[_name(event)]
        if event.type == pygame.KEYUP:
            self._controller.release(command)
            return ""
        return self.command(command, controls, source, view)

    def command(self, command: Command, controls: Controls, source: GameSource, view: View) -> str:
        """Run a command of the companion; return a notice, or ""."""
        own = _as_companion(view)
        if command in DIRECTIONS:
            return self._controller.walk(controls, command, source, own)
        if command is Command.USE:
            return self._controller.use(controls, "", source, own)
        return ""

    def release(self) -> None:
        """Let go of the direction that is held."""
        self._controller.release()

    def tick(self, source: GameSource, view: View) -> str:
        """Send the actions that are due; return a notice, or ""."""
        return "" if view.companion is None else self._controller.tick(source, _as_companion(view))

    def mark(self, view: View) -> ActionMark | None:
        """Return the mark of the companion's last action."""
        companion = view.companion
        return None if companion is None else self._controller.mark(view.state, companion)

    def hints(self, controls: Controls, view: View) -> KeyRows:
        """Return what the companion's key does now."""
        if view.companion is None or view.frozen or view.state.busy_steps(view.companion):
            return ()
        resolved = use(controls, view.state, view.companion)
        return ((key_words("right shift"), resolved.hint),) if resolved.valid else ()


def _as_companion(view: View) -> View:
    """Return a view in which the companion is the local player."""
    return dataclasses.replace(view, me=view.companion)


def _name(event: pygame.Event) -> str:
    return pygame.key.name(event.key).casefold()
