"""Gamepads: a whole task by posted events, sticks, and what is told of plugs."""

from __future__ import annotations

from collections.abc import Iterator

import pygame
import pytest
from tests.support.window_play import SIZE, Script, Timer, goes_to, way

from robotouille import World
from robotouille.certification.certificate import load_certificate
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Button, Choice
from robotouille_client.window.hands.commands import Command
from robotouille_client.window.hands.gamepad import Gamepads
from robotouille_client.window.window import Window

PADS = {
    Command.LEFT: pygame.CONTROLLER_BUTTON_DPAD_LEFT,
    Command.RIGHT: pygame.CONTROLLER_BUTTON_DPAD_RIGHT,
    Command.UP: pygame.CONTROLLER_BUTTON_DPAD_UP,
    Command.DOWN: pygame.CONTROLLER_BUTTON_DPAD_DOWN,
}


class Pad:
    def __init__(self, task: str) -> None:
        self.timer = Timer()
        self.source = Script(World(task))
        self.window = Window(SIZE, headless=True, clock=self.timer, cards=Leave())
        self.window.frame(self.source)

    def press(self, *buttons: int) -> None:
        for button in buttons:
            for kind in (pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP):
                pygame.event.post(pygame.Event(kind, button=button, instance_id=0))
                self.window.frame(self.source)

    def tilt(self, axis: int, value: int) -> None:
        event = pygame.Event(pygame.CONTROLLERAXISMOTION, axis=axis, value=value, instance_id=0)
        pygame.event.post(event)
        self.window.frame(self.source)

    def overlay(self):  # type: ignore[no-untyped-def]
        return self.window.overlay(self.source.view())


class Leave:
    def over(self, view: object) -> Form | None:
        return Form("Over", [Button("Again", "again"), Button("Quit", "quit")])

    def leaving(self, view: object) -> Form:
        return Form("Leave?", [Button("Stay", "stay"), Button("Quit", "quit")], cancel="stay")

    def stay(self) -> None: ...
    def stand_still(self, still: bool) -> None: ...

    def news(self) -> str:
        return ""


@pytest.fixture
def pad() -> Iterator[Pad]:
    opened = Pad("training/01")
    yield opened
    opened.window.close()


@pytest.mark.parametrize("task", ["synchronous/01", "training/01"])
def test_a_whole_task_by_gamepad_alone(task: str) -> None:
    pad = Pad(task)
    source = pad.source
    for line in load_certificate(task).plan or ():
        action = source.world.parse(source.state, source.me, line)
        station = goes_to(action)
        if station is None:
            pad.press(pygame.CONTROLLER_BUTTON_A)
            assert source.acted[-1] == action
        else:
            pad.press(*[PADS[c] for c in way(source.state, source.me, station)])
    assert source.finished
    pad.window.close()


def test_a_stick_means_a_direction_once_and_again_while_it_is_held(pad: Pad) -> None:
    for value in (8_000, 21_000, 25_000, 19_000):
        pad.tilt(pygame.CONTROLLER_AXIS_LEFTX, -value)
    assert len(pad.source.acted) == 1
    pad.timer.now += 0.4
    pad.window.frame(pad.source)
    assert len(pad.source.acted) == 2
    pad.tilt(pygame.CONTROLLER_AXIS_LEFTX, -3_000)
    pad.timer.now += 1.0
    pad.window.frame(pad.source)
    walked = len(pad.source.acted)
    pad.window.frame(pad.source)
    assert len(pad.source.acted) == walked
    pad.tilt(pygame.CONTROLLER_AXIS_RIGHTX, 30_000)
    assert len(pad.source.acted) == walked


def test_the_list_help_and_what_closes_them(pad: Pad) -> None:
    pad.press(pygame.CONTROLLER_BUTTON_X, pygame.CONTROLLER_BUTTON_DPAD_DOWN)
    assert pad.overlay().chosen == 1
    pad.press(pygame.CONTROLLER_BUTTON_B)
    assert pad.overlay().choices is None
    pad.press(pygame.CONTROLLER_BUTTON_Y)
    assert pad.overlay().help
    pad.press(pygame.CONTROLLER_BUTTON_B, pygame.CONTROLLER_BUTTON_X, pygame.CONTROLLER_BUTTON_A)
    assert len(pad.source.acted) == 1


def test_start_asks_whether_to_leave(pad: Pad) -> None:
    pad.press(pygame.CONTROLLER_BUTTON_START, pygame.CONTROLLER_BUTTON_A)
    assert not pad.window.closed
    pad.press(pygame.CONTROLLER_BUTTON_START, PADS[Command.DOWN], pygame.CONTROLLER_BUTTON_A)
    assert pad.window.closed
    assert pad.window.answer == "quit"
    assert pad.source.acted == []


def test_plugs_are_told(pad: Pad) -> None:
    pygame.event.post(pygame.Event(pygame.CONTROLLERDEVICEREMOVED, instance_id=3))
    pad.window.frame(pad.source)
    assert "unplugged" in pad.overlay().prompt
    pygame.event.post(pygame.Event(pygame.CONTROLLERDEVICEADDED, device_index=99))
    pad.window.frame(pad.source)
    assert "plugged in" in pad.overlay().prompt


def test_a_direction_ends_when_the_gamepad_is_gone() -> None:
    pads = Gamepads()
    down = pygame.Event(pygame.CONTROLLERBUTTONDOWN, button=PADS[Command.LEFT], instance_id=0)
    assert pads.read(down) is Command.LEFT
    assert not pads.let_go(down)
    gone = pygame.Event(pygame.CONTROLLERDEVICEREMOVED, instance_id=0)
    assert pads.notice(gone)
    assert pads.let_go(gone)


def test_forms_follow_commands() -> None:
    choice = Choice("Pace", [("slow", 1), ("fast", 2)])
    form = Form("Play", [choice, Button("Start", "start")])
    for command in (Command.RIGHT, Command.DOWN, Command.USE):
        form.command(command)
    assert (choice.value, form.result) == (2, "start")
