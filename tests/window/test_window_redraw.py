"""What looks the same is not drawn again, and a frame makes no pictures anew."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pygame
import pytest
from benchmarks import idle
from benchmarks import window as bench

from robotouille import Timing, World, load_task
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.view import PauseView, SeatView, View
from robotouille_client.window.window import Window

SIZE = (640, 360)


class Clock:
    def __init__(self) -> None:
        self.now = 0.0
        self.slept: list[float] = []

    def __call__(self) -> float:
        return self.now

    async def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.slept.append(seconds)
        await asyncio.sleep(0)


class Moment:
    """A source that shows what it is told to."""

    finished = False

    def __init__(self, view: View) -> None:
        self.shown = view

    def view(self) -> View:
        return self.shown

    def act(self, action: object) -> None: ...

    def say(self, text: str) -> None: ...


@pytest.fixture
def view() -> View:
    world = World("multi_agent/07@4")
    seats = tuple(SeatView(player, player) for player in world.players)
    return View(world, world.initial, world.initial, 3, 80, "real time", 0.1, seats, "robot1")


@pytest.fixture
def window():
    clock = Clock()
    window = Window(SIZE, headless=True, clock=clock, sleep=clock.sleep)
    window.clock = clock
    yield window
    window.close()


def frames(window: Window, source: Moment, count: int = 1) -> int:
    """How many of some frames were drawn."""
    before = window.drawn
    for _ in range(count):
        window.frame(source)
    return window.drawn - before


def test_a_moment_is_drawn_once(window: Window, view: View) -> None:
    source = Moment(view)
    frames(window, source)
    pygame.event.clear()
    assert frames(window, source, 20) == 0
    for phase in (0.2, 0.5, 1.0):
        source.shown = replace(view, phase=phase)
        assert frames(window, source) == 0, "nobody moves: the time of a step is not seen"


@pytest.mark.parametrize(
    "change", [{"step": 4}, {"chat": (("Ada", "hello"),)}, {"me": None}, {"notice": "lunch"}]
)
def test_what_is_seen_is_drawn(window: Window, view: View, change: dict[str, object]) -> None:
    source = Moment(view)
    frames(window, source)
    pygame.event.clear()
    source.shown = replace(view, **change)
    assert frames(window, source, 3) == 1


def test_who_walks_is_drawn_all_the_way(window: Window, view: View) -> None:
    walk = next(a for a in view.state.actions("robot1") if a.name == "move")
    source = Moment(replace(view, state=view.state.step(walk).state, step=4))
    frames(window, source)
    pygame.event.clear()
    for phase in (0.2, 0.5, 0.9):
        source.shown = replace(source.shown, phase=phase)
        assert frames(window, source) == 1


def test_any_event_draws_the_window_again(window: Window, view: View) -> None:
    source = Moment(view)
    frames(window, source)
    pygame.event.clear()
    pygame.event.post(pygame.Event(pygame.WINDOWEXPOSED))
    assert frames(window, source, 3) == 1


def test_a_countdown_is_drawn_as_often_as_its_dial_moves(window: Window, view: View) -> None:
    source = Moment(view)
    drawn = 0
    for tick in range(1000):
        left = 100.0 - tick / 100
        source.shown = replace(view, pause=PauseView("Waiting", "", left, left / 100))
        drawn += frames(window, source)
    assert 20 < drawn < 60


async def test_input_is_seen_within_20_ms_while_nothing_moves(window: Window, view: View) -> None:
    running = asyncio.create_task(window.run(Moment(view), linger=None))
    while len(window.clock.slept) < 20:
        await asyncio.sleep(0)
    running.cancel()
    assert max(window.clock.slept) < 0.0201
    assert window.clock.slept[-1] == pytest.approx(0.02)


def test_a_frame_makes_no_surfaces(view: View, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a step that was drawn once, every other frame is put together from what is there."""
    world = World(load_task("multi_agent/07@4", timing=Timing.PEOPLE))
    state = world.initial
    walks = {p: next(a for a in state.actions(p) if a.name == "move") for p in world.players}
    moving = replace(view, world=world, previous=state, state=state.step(walks).state)
    painter, surface = Painter(), pygame.Surface(SIZE)
    shown = [replace(moving, phase=i / 16) for i in range(17)]
    for each in shown:
        painter.paint(surface, each)
    made: list[str] = []

    def counted(name: str, make):
        return lambda *a, **k: (made.append(name), make(*a, **k))[1]

    monkeypatch.setattr(pygame, "Surface", counted("Surface", pygame.Surface))
    for name in ("smoothscale", "rotozoom", "scale", "flip"):
        make = getattr(pygame.transform, name)
        monkeypatch.setattr(pygame.transform, name, counted(name, make))
    for each in shown:
        painter.paint(surface, each)
    assert made == []


def test_the_window_is_measured() -> None:
    frames = bench.measure_frames(steps=2)
    assert 0 < frames.median <= frames.p99 and frames.bare > 0
    assert idle.measure(idle.playing, 0.2) > 0
