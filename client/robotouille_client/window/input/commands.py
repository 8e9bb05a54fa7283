"""Commands of the window, and the keys and gamepad buttons for them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import Any

import pygame

from robotouille.world.presentation.signals import Intent


class Command(StrEnum):
    """Command that a key or a gamepad button stands for."""

    LEFT = "left"
    RIGHT = "right"
    UP = "up"
    DOWN = "down"
    USE = "use"
    LIST = "list"
    CANCEL = "cancel"
    ENTER = "enter"
    CHAT = "chat"
    HELP = "help"
    FULLSCREEN = "fullscreen"
    SCREENSHOT = "screenshot"
    MENU = "menu"
    SOUND = "sound"
    NEED = "need"
    YOURS = "yours"
    LOOK = "look"
    WAIT = "wait"
    THANKS = "thanks"


DIRECTIONS: Mapping[Command, tuple[int, int]] = {
    Command.LEFT: (-1, 0),
    Command.RIGHT: (1, 0),
    Command.UP: (0, 1),
    Command.DOWN: (0, -1),
}
"""Unit vector of each direction; y points up, as in problem files."""

SIGNALS: Mapping[Command, Intent] = {
    Command.NEED: Intent.NEED,
    Command.YOURS: Intent.YOURS,
    Command.LOOK: Intent.LOOK,
    Command.WAIT: Intent.WAIT,
    Command.THANKS: Intent.THANKS,
}
"""Signal that each of these commands sends."""

DEFAULT_KEYS: Mapping[Command, tuple[str, ...]] = {
    Command.LEFT: ("a",),
    Command.RIGHT: ("d",),
    Command.UP: ("w",),
    Command.DOWN: ("s",),
    Command.USE: ("e", "space"),
    Command.LIST: ("tab",),
    Command.CHAT: ("t",),
    Command.HELP: ("h",),
    Command.SOUND: ("m",),
    Command.NEED: ("1",),
    Command.YOURS: ("2",),
    Command.LOOK: ("3",),
    Command.WAIT: ("4",),
    Command.THANKS: ("5",),
    Command.FULLSCREEN: ("f11",),
    Command.SCREENSHOT: ("f12",),
}
"""Keys that the player can change."""

FIXED: Mapping[str, Command] = {
    "left": Command.LEFT,
    "right": Command.RIGHT,
    "up": Command.UP,
    "down": Command.DOWN,
    "escape": Command.CANCEL,
    "esc": Command.CANCEL,
    "return": Command.ENTER,
    "enter": Command.ENTER,
}
"""Keys that cannot be changed, so that players cannot lock themselves out.

`esc` and `enter` are the labels of keys drawn in the window, which can be clicked.
"""

_SHORT = {"return": "Enter", "escape": "Esc"}


class KeyMap:
    """Keys of the commands: the defaults with the player's changes."""

    def __init__(self, changed: Mapping[str, Iterable[str]] | None = None) -> None:
        self._keys = {**DEFAULT_KEYS}
        for name, keys in (changed or {}).items():
            if name in set(DEFAULT_KEYS):
                self._keys[Command(name)] = tuple(k.casefold() for k in keys if k not in FIXED)
        # A key that the player has chosen loses its default command.
        chosen = {key for c, keys in self._keys.items() if keys != DEFAULT_KEYS[c] for key in keys}
        for command, keys in self._keys.items():
            if keys == DEFAULT_KEYS[command]:
                self._keys[command] = tuple(key for key in keys if key not in chosen)
        self._commands = {key: command for command, keys in self._keys.items() for key in keys}

    def command(self, key: str) -> Command | None:
        """Return the command of a key; None if it has none."""
        return FIXED.get(key) or self._commands.get(key)

    def keys(self, command: Command) -> tuple[str, ...]:
        return self._keys.get(command, ())

    def words(self, command: Command) -> str:
        """Return the label of a command's first key; empty if it has none."""
        keys = self.keys(command)
        return key_words(keys[0]) if keys else ""

    def with_key(self, command: Command, key: str) -> KeyMap:
        """Return a copy that assigns the key to this command alone."""
        changed = {c.value: tuple(k for k in keys if k != key) for c, keys in self._keys.items()}
        changed[command.value] = (key,)
        return KeyMap(changed)

    @property
    def changed(self) -> dict[str, list[str]]:
        """Keys that differ from the defaults, by command."""
        return {c.value: list(k) for c, k in self._keys.items() if k != DEFAULT_KEYS[c]}


def key_words(key: str) -> str:
    """Return a key's label, such as `E`, `Space` or `F11`."""
    short = len(key) == 1 or key[1:].isdigit()
    return _SHORT.get(key) or (key.upper() if short else key.capitalize())


_BUTTONS: dict[int, Command] = {
    pygame.CONTROLLER_BUTTON_A: Command.USE,
    pygame.CONTROLLER_BUTTON_B: Command.CANCEL,
    pygame.CONTROLLER_BUTTON_X: Command.LIST,
    pygame.CONTROLLER_BUTTON_Y: Command.HELP,
    pygame.CONTROLLER_BUTTON_BACK: Command.LOOK,
    pygame.CONTROLLER_BUTTON_RIGHTSHOULDER: Command.NEED,
    pygame.CONTROLLER_BUTTON_LEFTSHOULDER: Command.YOURS,
    pygame.CONTROLLER_BUTTON_LEFTSTICK: Command.WAIT,
    pygame.CONTROLLER_BUTTON_RIGHTSTICK: Command.THANKS,
    pygame.CONTROLLER_BUTTON_START: Command.MENU,
    pygame.CONTROLLER_BUTTON_DPAD_LEFT: Command.LEFT,
    pygame.CONTROLLER_BUTTON_DPAD_RIGHT: Command.RIGHT,
    pygame.CONTROLLER_BUTTON_DPAD_UP: Command.UP,
    pygame.CONTROLLER_BUTTON_DPAD_DOWN: Command.DOWN,
}
_AXES = {
    pygame.CONTROLLER_AXIS_LEFTX: (Command.LEFT, Command.RIGHT),
    pygame.CONTROLLER_AXIS_LEFTY: (Command.UP, Command.DOWN),
}
PRESSED, RELEASED = 20_000, 12_000
"""Stick positions, of 32,767, at which a direction starts and ends.

They differ so that a stick that trembles near one of them does not press repeatedly.
"""


class Gamepads:
    """All connected gamepads. Without a companion, they are treated as one."""

    def __init__(self) -> None:
        self._held: dict[int, Command] = {}
        self._open: dict[int, Any] = {}

    @property
    def held(self) -> Command | None:
        """The direction that is held, on any gamepad."""
        return next(iter(self._held.values()), None)

    @property
    def plugged(self) -> tuple[int, ...]:
        """Numbers of the connected gamepads, the first one first."""
        return tuple(self._open)

    def open(self) -> None:
        """Start listening to gamepads, if the system supports them."""
        # `_sdl2` is experimental, and some builds of pygame do not have it.
        with contextlib.suppress(pygame.error, ImportError):
            from pygame._sdl2 import controller

            controller.init()
            for index in range(controller.get_count()):
                self._plug(index)

    def read(self, event: pygame.Event) -> Command | None:
        """Return the command of a button or stick event; None for other events."""
        if event.type == pygame.CONTROLLERBUTTONDOWN:
            command = _BUTTONS.get(event.button)
            # Other buttons neither repeat nor end a direction that is still held.
            if command is not None and command in DIRECTIONS:
                self._held[_pad(event)] = command
            return command
        if event.type == pygame.CONTROLLERBUTTONUP:
            if _BUTTONS.get(event.button) == self._held.get(_pad(event)):
                self._held.pop(_pad(event), None)
        elif event.type == pygame.CONTROLLERAXISMOTION:
            return self._tilt(_pad(event), event.axis, event.value)
        return None

    def let_go(self, event: pygame.Event) -> bool:
        """Return whether the event released the last direction that its gamepad held."""
        released = (pygame.CONTROLLERBUTTONUP, pygame.CONTROLLERAXISMOTION)
        ended = event.type in (*released, pygame.CONTROLLERDEVICEREMOVED)
        return ended and _pad(event) not in self._held

    def for_companion(self, event: pygame.Event) -> bool:
        """Return whether an event comes from the companion's gamepad.

        The only gamepad is the companion's; of several, the first one is the first person's.
        """
        playing = (
            pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP, pygame.CONTROLLERAXISMOTION,
        )  # fmt: skip
        first = self.plugged[: len(self.plugged) > 1]
        return event.type in playing and _pad(event) not in first

    def notice(self, event: pygame.Event) -> str:
        """Return a message if a gamepad was connected or disconnected."""
        if event.type == pygame.CONTROLLERDEVICEADDED:
            with contextlib.suppress(pygame.error, ImportError):
                self._plug(event.device_index)
            return "Gamepad connected"
        if event.type == pygame.CONTROLLERDEVICEREMOVED:
            # A removed gamepad does not report that its buttons were released.
            self._open.pop(event.instance_id, None)
            self._held.pop(event.instance_id, None)
            return "Gamepad disconnected. Use the keyboard or mouse"
        return ""

    def _tilt(self, pad: int, axis: int, value: int) -> Command | None:
        sides = _AXES.get(axis)
        if sides is None:
            return None
        command, held = sides[value > 0], self._held.get(pad)
        if abs(value) >= PRESSED and held is not command:
            self._held[pad] = command
            return command
        if abs(value) < RELEASED and held in sides:
            self._held.pop(pad, None)
        return None

    def _plug(self, index: int) -> None:
        from pygame._sdl2 import controller

        if controller.is_controller(index):
            pad = controller.Controller(index)
            # SDL reports events of open controllers only, so each one is kept open.
            self._open[pad.as_joystick().get_instance_id()] = pad


def _pad(event: pygame.Event) -> int:
    """Return the number of the gamepad that an event comes from."""
    return int(getattr(event, "instance_id", 0))
