"""A window on a real (virtual) screen, with a real mouse and keyboard."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.support.screens import REAL_INPUT, open_screen

from robotouille import World
from robotouille_client.window.drawing.window_layout import layout

PROGRAM = """
import asyncio, sys
from pathlib import Path
from robotouille import World
from robotouille_client.window.view import View
from robotouille_client.window.window import Window

class Game:
    def __init__(self):
        self.world = World("asynchronous/09")
        self.state, self.step, self.finished = self.world.initial, 0, False
    def view(self):
        if window.frames == 3:
            print("ready", flush=True)
            window.frames += 1
        return View(self.world, self.state, step=self.step, me="robot1")
    def act(self, action):
        print(action.name, *sorted(action.arguments), flush=True)
        self.state, self.step = self.state.step(action).state, self.step + 1
    def say(self, text):
        print("said", text, flush=True)
        window.screenshot(sys.argv[1])
        self.finished = True

window = Window((800, 600), caption="robotouille-test")
asyncio.run(window.run(Game(), linger=0))
"""

pytestmark = REAL_INPUT


@pytest.fixture
def screen(tmp_path: Path) -> Iterator[str]:
    """The name of a virtual screen of its own."""
    with open_screen(tmp_path / "pixels", (800, 600)) as opened:
        yield opened.display


def spot(name: str) -> list[str]:
    world = World("asynchronous/09")
    place = layout((800, 600), world.task.problem.width, world.task.problem.height)
    return [str(x) for x in place.cell(world.thing(name).tile).center]


def xdotool(environment: dict[str, str], *arguments: str) -> str:
    command = ["xdotool", *arguments]
    done = subprocess.run(
        command, env=environment, check=True, timeout=20, text=True, stdout=subprocess.PIPE
    )
    return done.stdout


def test_mouse_and_keys(screen: str, tmp_path: Path) -> None:
    environment = {
        **os.environ,
        "DISPLAY": screen,
        "SDL_VIDEODRIVER": "x11",
        "SDL_VIDEO_WINDOW_POS": "0,0",
    }
    picture = tmp_path / "screen.png"
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(picture)],
        env=environment, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert program.stdout is not None
        assert program.stdout.readline().strip() == "ready"
        xdotool(environment, "mousemove", "400", "300")
        found = xdotool(environment, "getmouselocation", "--shell")
        (window,) = [line[7:] for line in found.splitlines() if line.startswith("WINDOW=")]
        xdotool(environment, "windowfocus", window)
        expected = [
            ("table11", "move robot1 table11 table8"),
            ("table11", "pick-up-item chicken1 robot1 table11"),
            ("stove1", "move robot1 stove1 table11"),
            ("stove1", "place-item chicken1 robot1 stove1"),
        ]
        for name, action in expected:
            xdotool(environment, "mousemove", *spot(name), "click", "1")
            assert program.stdout.readline().strip() == action
        xdotool(environment, "key", "e")
        assert program.stdout.readline().strip() == "cook chicken1 robot1 stove1"
        xdotool(environment, "key", "t")
        xdotool(environment, "type", "--delay", "30", "the end")
        xdotool(environment, "key", "Return")
        assert program.stdout.readline().strip() == "said the end"
        assert program.wait(20) == 0
        assert picture.stat().st_size > 10_000
    finally:
        program.kill()
        program.communicate(timeout=10)
