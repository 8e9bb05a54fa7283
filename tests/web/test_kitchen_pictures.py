"""The canvas of the browser client shows the same kitchens as the window."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from typing import Any

import numpy as np
import pygame
import pytest

from robotouille import State, load_task, task_names
from tests.web.kitchen_page import (
    CHROMIUM,
    MARGIN,
    kitchen_page,
    look_of,
    planned_game,
    recorded,
    web_picture,
    window_picture,
)

if importlib.util.find_spec("playwright") is None:
    pytest.skip("needs playwright: pip install playwright", allow_module_level=True)
pytestmark = [
    pytest.mark.browser,
    pytest.mark.process,
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt install chromium"),
]

SIZE = (1000, 640)
PARTS = 2
"""Parts of a tile's side whose mean colours are compared."""
LARGEST, MEAN = 12.0, 1.2
"""Allowed differences of mean colours, of 255: of one part, and of all parts."""
MOVING = ("multi_agent/10@4", "multi_agent/07@2", "asynchronous/10", "workshop/02", "shifts/06@2")
BEHIND = 0.6
"""Share of a step that has passed in the pictures of moving players."""
ENDING = """(reason) => {
  const moment = { step: 1, before: states[0], stepSeconds: 1, receivedAt: 1, outcome: { reason } };
  kitchen.show(states[1], moment);
  const drawn = {}, emitted = {};
  for (const [name, first, last] of [["moving", 10, 10.5], ["over", 13, 13.02]]) {
    kitchen.draw(first);
    drawn[name] = kitchen.draw(last);
    emitted[name] = kitchen.animated.animation.emissions.length;
  }
  kitchen.quiet = { matches: true };
  kitchen.ended = null;
  kitchen.draw(20);
  drawn.reduced = kitchen.draw(20.5);
  return [drawn, emitted];
}"""
"""Draws moments of a game's end; returns whether later frames differ, and numbers of effects."""


@pytest.fixture(scope="module")
def page() -> Iterator[Any]:
    with kitchen_page(SIZE) as opened:
        yield opened


def differences(one: pygame.Surface, other: pygame.Surface, grid: tuple[int, int]) -> Any:
    """Return the differences of the mean colours of the parts of two pictures."""
    means = []
    for surface in (one, other):
        plain = pygame.Surface(surface.get_size())
        plain.blit(surface, (0, 0))
        # Rounding makes the tiles of the two kitchens differ by a pixel.
        same = pygame.transform.smoothscale(plain, (grid[0] * 8, grid[1] * 8))
        pixels = pygame.surfarray.array3d(same).astype(np.float64)
        means.append(pixels.reshape(grid[0], 8, grid[1], 8, 3).mean(axis=(1, 3)))
    return np.abs(means[0] - means[1]).max(axis=2)


def compare(page: Any, states: list[State], steps: tuple[int, ...], phase: float) -> None:
    """Compare the pictures of some steps of a game."""
    world = states[0].world
    game = {**recorded(states, look_of(world.task)), "me": None}
    # Without a panel, the page has the room of the window's kitchen.
    room = window_picture(states, 0, 1.0, SIZE).get_size()
    size = [side + 2 * MARGIN for side in room]
    page.evaluate("([game, ...size]) => begin(game, ...size)", [game, *size, 1])
    problem = world.task.problem
    grid = (problem.width * PARTS, (problem.height + 1) * PARTS)
    for step in steps:
        web = web_picture(page, states, step, phase)
        window = window_picture(states, step, phase, SIZE)
        found = differences(web, window, grid)
        print(f"{world.task.name} {step}: {found.max():.1f} at most, {found.mean():.2f} on average")
        assert found.max() < LARGEST
        assert found.mean() < MEAN


@pytest.mark.parametrize("name", [name for name in task_names() if "generated" not in name])
def test_kitchen_looks_like_that_of_the_window(page: Any, name: str) -> None:
    compare(page, planned_game(load_task(name), 0), (0,), 1.0)


@pytest.mark.parametrize("name", MOVING)
def test_play_looks_like_that_of_the_window(page: Any, name: str) -> None:
    states = planned_game(load_task(name), 60)
    steps = tuple(step for step in (9, 23, 47) if step < len(states))
    compare(page, states, steps, BEHIND)


@pytest.mark.parametrize("reason", ["goal", "step_limit"])
def test_effects_of_the_end_move_and_vanish(page: Any, reason: str) -> None:
    states = planned_game(load_task("synchronous/01"), 2)
    game = {**recorded(states, look_of(states[0].world.task)), "me": None}
    page.evaluate("([game, ...size]) => begin(game, ...size)", [game, *SIZE, 1])
    drawn, emitted = page.evaluate(ENDING, reason)
    # The first frame of the end begins at 10 s. Nobody blinks at these times.
    assert drawn == {"moving": True, "over": False, "reduced": False}
    assert emitted["moving"] > 0 == emitted["over"]


def test_frames_of_the_largest_task(page: Any) -> None:
    # The times depend on the machine, so they are only printed.
    states = planned_game(load_task("multi_agent/10@4"), 120)
    game = recorded(states, look_of(states[0].world.task))
    page.set_viewport_size({"width": 1280, "height": 720})
    page.evaluate("([game, ...size]) => begin(game, ...size)", [game, 1280, 720, 1])
    timings = sorted(page.evaluate("timings()"))
    assert timings
    middle, late = timings[len(timings) // 2], timings[len(timings) * 95 // 100]
    print(f"{len(timings)} frames: {middle:.2f} ms, 95 % below {late:.2f} ms")
