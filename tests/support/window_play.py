"""A window driven by posted events and a manual clock, without a screen."""

from __future__ import annotations

import asyncio
import dataclasses
import functools
from collections import deque
from collections.abc import Iterator
from typing import Any

import pygame

from robotouille import GroundAction, State, World
from robotouille.world.presentation.signals import Signal
from robotouille.world.scene import scene
from robotouille_client.window.drawing.window_layout import layout
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.screen import Devices
from robotouille_client.window.input.commands import DIRECTIONS, Command, KeyMap
from robotouille_client.window.input.controls import towards
from robotouille_client.window.options import DisplayOptions, TimeSource, WindowStyle
from robotouille_client.window.view import Bubble, GameSource, View
from robotouille_client.window.window import Window

SIZE = (800, 600)
ARROWS = {
    Command.LEFT: pygame.K_LEFT,
    Command.RIGHT: pygame.K_RIGHT,
    Command.UP: pygame.K_UP,
    Command.DOWN: pygame.K_DOWN,
}


@functools.cache
def world_of(task: str) -> World:
    """Return a task's world. Tests share it and must not change it: grounding takes longer than
    a picture.
    """
    return World(task)


def headless_window(size: tuple[int, int] = SIZE, *, cards: Any = None, **options: Any) -> Window:
    """Return a window without a screen; `options` are fields of the window's option values."""

    def taken(kind: Any, **given: Any) -> Any:
        names = [field.name for field in dataclasses.fields(kind) if field.name in options]
        return kind(**given, **{name: options.pop(name) for name in names})

    window = Window(
        taken(DisplayOptions, size=size, headless=True),
        style=taken(WindowStyle),
        cards=cards,
        devices=taken(Devices),
        time_source=taken(TimeSource),
    )
    assert not options, options
    return window


class Timer:
    """Clock that only advances in `sleep`, when set by hand, or by `pace` seconds per call."""

    def __init__(self) -> None:
        self.now = 100.0
        self.pace = 0.0

    def __call__(self) -> float:
        self.now += self.pace
        return self.now

    async def sleep(self, seconds: float) -> None:
        self.now += seconds
        await asyncio.sleep(0)


class Script(GameSource):
    """Source that applies actions at once, or with `slow` only in `step`."""

    def __init__(self, world: World, me: str | None = None, *, slow: bool = False) -> None:
        self.world = world
        self.me = me or world.players[0]
        self.states: list[State] = [world.initial]
        self.acted: list[GroundAction] = []
        self.said: list[str] = []
        self.signals: list[Signal] = []
        self.blocked: tuple[tuple[str, str, str], ...] = ()
        self.bubbles: tuple[Bubble, ...] = ()
        self.slow = slow
        self.step_seconds: float | None = None
        self._asked: GroundAction | None = None

    @property
    def state(self) -> State:
        return self.states[-1]

    @property
    def finished(self) -> bool:
        return self.state.goal_reached

    def view(self) -> View:
        before = self.states[-2] if len(self.states) > 1 else None
        step = len(self.states) - 1
        return View(
            self.world,
            self.state,
            before,
            step,
            me=self.me,
            bubbles=self.bubbles,
            step_seconds=self.step_seconds,
            blocked=self.blocked,
        )

    def act(self, action: GroundAction) -> None:
        self.acted.append(action)
        self._asked = action
        if not self.slow:
            self.step()

    def step(self) -> None:
        """Apply the newest action."""
        asked, self._asked = self._asked, None
        self.states.append(self.state.step(asked if asked is not None else []).state)

    def say(self, text: str) -> None:
        self.said.append(text)

    def signal(self, signal: Signal) -> None:
        self.signals.append(signal)


def at(world: World, station: str, size: tuple[int, int] = SIZE) -> tuple[int, int]:
    """Return the centre of a station in a window."""
    problem, tile = world.task.problem, world.thing(station).tile
    assert tile is not None
    return layout(size, problem.width, problem.height).cell(tile).center


def press(window: Window, source: Script, *keys: int, mod: int = 0) -> None:
    """Press and release keys, with a frame after each event."""
    for key in keys:
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=mod, unicode=""))
        window.frame(source)
        pygame.event.post(pygame.Event(pygame.KEYUP, key=key, mod=mod))
        window.frame(source)


def click(window: Window, source: Script, station: str, button: int = 1) -> None:
    """Point at a station, click, and draw a frame."""
    pos = at(source.world, station)
    pygame.event.post(pygame.Event(pygame.MOUSEMOTION, pos=pos, rel=(0, 0), buttons=(0, 0, 0)))
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=pos, button=button))
    window.frame(source)


def way(state: State, me: str, station: str) -> list[Command]:
    """Return a shortest list of directions that leads a player to a station."""
    queue: deque[tuple[State, list[Command]]] = deque([(state, [])])
    seen = set()
    while queue:
        now, path = queue.popleft()
        placed = scene(now)
        if placed[me].at == station:
            return path
        if placed[me].at in seen:
            continue
        seen.add(placed[me].at)
        for command, direction in DIRECTIONS.items():
            action = towards(now, me, [direction], placed)
            if action is not None:
                after = now.step(action).state
                while after.busy_steps(me):
                    after = after.step([]).state
                queue.append((after, [*path, command]))
    raise AssertionError(f"no keys lead to {station}")


def goes_to(action: GroundAction) -> str | None:
    """Return the destination of a walk, or None for another action."""
    return action.destination


class ScriptedUser:
    """Scripted user: a generator that posts events and yields after each frame.

    `sleep` replaces that of asyncio. The window closes when the generator ends.
    """

    def __init__(self, timer: Timer) -> None:
        self.timer = timer
        self.script: Iterator[None] = iter(())
        self.ended = False

    async def sleep(self, seconds: float) -> None:
        await self.timer.sleep(seconds)
        for _ in self.script:
            return
        self.ended = True
        pygame.event.post(pygame.Event(pygame.QUIT))


def follow(form: Form) -> None:
    """Send the posted events to a form."""
    for event in pygame.event.get():
        form.handle(event, KeyMap())


def post(*keys: int | str) -> None:
    """Post keys by number, or text as typed input."""
    for key in keys:
        if isinstance(key, str):
            for letter in key:
                pygame.event.post(pygame.Event(pygame.TEXTINPUT, text=letter))
        else:
            pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))
            pygame.event.post(pygame.Event(pygame.KEYUP, key=key, mod=0))
