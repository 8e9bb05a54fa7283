"""Unchanged frames are not drawn again, and frames create no pictures."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from types import SimpleNamespace

import pygame
import pytest
from tests.support.window_play import headless_window

from robotouille import World
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


@pytest.fixture
def view() -> View:
    world = World("multi_agent/07@4")
    seats = tuple(SeatView(player, player) for player in world.players)
    return View(world, world.initial, world.initial, 3, 80, "real time", 0.1, seats, "robot1")


@pytest.fixture
def window():
    clock = Clock()
    window = headless_window(SIZE, clock=clock, sleep=clock.sleep)
    window.clock = clock
    return window


def moment(view: View) -> SimpleNamespace:
    """Return a source with a fixed view."""
    source = SimpleNamespace(shown=view, finished=False)
    source.view = lambda: source.shown
    return source


def frames(window: Window, source: SimpleNamespace, count: int = 1) -> int:
    """Return how many of some frames were drawn."""
    before = window.drawn
    for _ in range(count):
        window.frame(source)
    return window.drawn - before


def test_an_unchanged_view_is_drawn_once(window: Window, view: View) -> None:
    source = moment(view)
    frames(window, source)
    pygame.event.clear()
    assert frames(window, source, 20) == 0
    for phase in (0.2, 0.5, 1.0):
        source.shown = replace(view, phase=phase)
        assert frames(window, source) == 0, "nobody moves: the time of a step is not seen"


@pytest.mark.parametrize(
    "change", [{"step": 4}, {"chat": (("Ada", "hello"),)}, {"me": None}, {"notice": "lunch"}]
)
def test_a_visible_change_is_drawn(window: Window, view: View, change: dict[str, object]) -> None:
    source = moment(view)
    frames(window, source)
    pygame.event.clear()
    source.shown = replace(view, **change)
    assert frames(window, source, 3) == 1


def test_calm_players_are_drawn_once_a_step(window: Window, view: View) -> None:
    """Their breath needs no pictures besides those that show the number of the step."""
    still = replace(view, previous=None, step_seconds=0.2, seconds=0.0)
    source = moment(still)
    frames(window, source)
    pygame.event.clear()
    drawn = []
    for tick in range(250):  # Ten seconds, in which everybody breathes and blinks.
        step, part = divmod(tick, 5)
        phase, seconds = part / 5, tick / 25 + 0.013
        source.shown = replace(still, step=step, phase=phase, seconds=seconds)
        drawn.append(frames(window, source, 1))
    assert sum(drawn) <= 50


def test_walks_are_drawn_in_every_frame(window: Window, view: View) -> None:
    walk = next(a for a in view.state.actions("robot1") if a.name == "move")
    source = moment(replace(view, state=view.state.step(walk).state, step=4))
    frames(window, source)
    pygame.event.clear()
    for phase in (0.2, 0.5, 0.9):
        source.shown = replace(source.shown, phase=phase)
        assert frames(window, source) == 1


def test_every_event_redraws_the_window(window: Window, view: View) -> None:
    source = moment(view)
    frames(window, source)
    pygame.event.clear()
    pygame.event.post(pygame.Event(pygame.WINDOWEXPOSED))
    assert frames(window, source, 3) == 1


@pytest.mark.slow
def test_a_countdown_is_drawn_when_its_dial_moves(window: Window, view: View) -> None:
    source = moment(view)
    drawn = 0
    for tick in range(1000):
        left = 100.0 - tick / 100
        source.shown = replace(view, pause=PauseView("Waiting", "", left, left / 100))
        drawn += frames(window, source)
    assert 20 < drawn < 60


async def test_input_shows_within_20_ms(window: Window, view: View) -> None:
    running = asyncio.create_task(window.run(moment(view), linger=None))
    while len(window.clock.slept) < 20:
        await asyncio.sleep(0)
    running.cancel()
    assert max(window.clock.slept) < 0.0201
    assert window.clock.slept[-1] == pytest.approx(0.02)
