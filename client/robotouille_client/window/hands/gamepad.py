"""Gamepads with SDL's mappings: sticks and buttons as commands."""

from __future__ import annotations

import contextlib
from typing import Any

import pygame

from robotouille_client.window.hands.commands import DIRECTIONS, Command

__all__ = ["Gamepads"]

_BUTTONS: dict[int, Command] = {
    pygame.CONTROLLER_BUTTON_A: Command.USE,
    pygame.CONTROLLER_BUTTON_B: Command.CANCEL,
    pygame.CONTROLLER_BUTTON_X: Command.LIST,
    pygame.CONTROLLER_BUTTON_Y: Command.HELP,
    pygame.CONTROLLER_BUTTON_BACK: Command.HELP,
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
"""Of 32,767: where a stick begins to mean a direction, and where it no longer does."""


class Gamepads:
    """All gamepads that are plugged in, as one.

    `held` is the direction that is held, until it is released.
    """

    def __init__(self) -> None:
        self.held: Command | None = None
        self._open: dict[int, Any] = {}

    def open(self) -> None:
        """Listen to gamepads; nothing happens where the system has none."""
        with contextlib.suppress(pygame.error, ImportError):
            from pygame._sdl2 import controller

            controller.init()
            for index in range(controller.get_count()):
                self._plug(index)

    def read(self, event: pygame.Event) -> Command | None:
        """The command that a button or stick asks for; None for all else."""
        if event.type == pygame.CONTROLLERBUTTONDOWN:
            command = _BUTTONS.get(event.button)
            self.held = command if command in DIRECTIONS else self.held
            return command
        if event.type == pygame.CONTROLLERBUTTONUP:
            if _BUTTONS.get(event.button) == self.held:
                self.held = None
        elif event.type == pygame.CONTROLLERAXISMOTION:
            return self._tilt(event.axis, event.value)
        return None

    def let_go(self, event: pygame.Event) -> bool:
        """Whether an event, which was read, left no direction held."""
        released = (pygame.CONTROLLERBUTTONUP, pygame.CONTROLLERAXISMOTION)
        return self.held is None and event.type in (*released, pygame.CONTROLLERDEVICEREMOVED)

    def notice(self, event: pygame.Event) -> str:
        """What is told of a gamepad that comes or goes."""
        if event.type == pygame.CONTROLLERDEVICEADDED:
            with contextlib.suppress(pygame.error, ImportError):
                self._plug(event.device_index)
            return "A gamepad is plugged in"
        if event.type == pygame.CONTROLLERDEVICEREMOVED:
            self._open.pop(event.instance_id, None)
            self.held = None
            return "The gamepad is unplugged: go on with keys or mouse"
        return ""

    def _tilt(self, axis: int, value: int) -> Command | None:
        sides = _AXES.get(axis)
        if sides is None:
            return None
        command = sides[value > 0]
        if abs(value) >= PRESSED and self.held is not command:
            self.held = command
            return command
        if abs(value) < RELEASED and self.held in sides:
            self.held = None
        return None

    def _plug(self, index: int) -> None:
        from pygame._sdl2 import controller

        if controller.is_controller(index):
            pad = controller.Controller(index)
            self._open[pad.as_joystick().get_instance_id()] = pad
