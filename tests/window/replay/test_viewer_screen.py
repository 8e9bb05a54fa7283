"""The viewer on a real (virtual) screen, with a real mouse and keyboard."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import pygame
from tests.support.golden_pictures import difference
from tests.support.screens import REAL_INPUT, SIZE, Screen, open_screen

from robotouille.replay.recording import read_recording
from robotouille_client.window.replay.viewer import Viewer
from robotouille_client.window.window import Window

PROGRAM = """
import asyncio, sys
from functools import partial
from pathlib import Path
from robotouille.replay.recording import read_recording
from robotouille_client.window.replay.viewer import ReplayCards, Viewer
from robotouille_client.window.window import Window

path = Path(sys.argv[1])

class Told(Viewer):
    told = None
    def view(self):
        shown = super().view()
        at = (shown.step, self.playhead.playing, self.playhead.speed, self.state.log)
        if self.window.frames > 2 and at != self.told:
            self.told = at
            print(*at, flush=True)
        return shown

viewer = Told([(path, read_recording(path))], make_window=partial(Window, cards=ReplayCards()))
viewer.playhead.seek(0, playing=False)
try:
    asyncio.run(viewer.window.run(viewer, linger=None))
finally:
    viewer.close()
"""

pytestmark = REAL_INPUT


class Desk:
    """A viewer in a process of its own, and the hands of whoever sits before it."""

    def __init__(self, screen: Screen, program: subprocess.Popen[str]) -> None:
        self.screen = screen
        self._program = program
        self._environment = {**os.environ, "DISPLAY": screen.display}

    def do(self, *arguments: str) -> str:
        """Use mouse and keys."""
        done = subprocess.run(
            ["xdotool", *arguments],
            env=self._environment, check=True, timeout=20, text=True, stdout=subprocess.PIPE,
        )  # fmt: skip
        return done.stdout

    def focus(self) -> None:
        """Type into the window that is there."""
        self.do("mousemove", "400", "300")
        found = self.do("getmouselocation", "--shell")
        [window] = [line[7:] for line in found.splitlines() if line.startswith("WINDOW=")]
        self.do("windowfocus", window)

    def told(self) -> tuple[int, bool, float, bool]:
        """The next thing that changes: step, whether it plays, speed, whether the log is open."""
        assert self._program.stdout is not None
        line = self._program.stdout.readline()
        assert line, "the program has ended"
        step, playing, speed, log = line.split()
        return int(step), playing == "True", float(speed), log == "True"

    def until(self, step: int) -> None:
        """Wait until a step is shown."""
        for _ in range(200):
            if self.told()[0] == step:
                return
        raise AssertionError(f"step {step} was never shown")

    def leaves(self) -> bool:
        """Whether it goes when its question is answered; a new card takes no answers at first."""
        self.do("key", "Down")
        for _ in range(40):
            self.do("key", "q", "key", "Down", "key", "Return")
            with suppress(subprocess.TimeoutExpired):
                return self._program.wait(0.5) == 0
        return False


@contextmanager
def at_desk(path: Path, folder: Path) -> Iterator[Desk]:
    with open_screen(folder) as screen:
        environment = {
            **os.environ, "DISPLAY": screen.display, "SDL_VIDEODRIVER": "x11",
            "SDL_VIDEO_WINDOW_POS": "0,0",
        }  # fmt: skip
        program = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(path)],
            env=environment, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        try:
            yield Desk(screen, program)
        finally:
            program.kill()
            program.communicate(timeout=10)


def test_mouse_and_keys_on_a_screen(path: Path, tmp_path: Path) -> None:
    make = partial(Window, headless=True)
    here = Viewer([(path, read_recording(path))], now=lambda: 0.0, make_window=make)
    here.window.frame(here)
    strip = here.strips[0]

    def at(step: int) -> tuple[str, ...]:
        return tuple(map(str, strip.place_of(step, 1)))

    def button(key: int) -> tuple[str, ...]:
        place = strip.button(key)
        assert place is not None
        return tuple(map(str, place))

    with at_desk(path, tmp_path / "screen") as desk:
        assert desk.told()[0] == 0
        desk.focus()
        desk.do("mousemove", *at(20), "click", "1")
        desk.until(20)
        desk.do("mousemove", *at(20), "mousedown", "1", "mousemove", *at(25), "mousemove", *at(31))
        desk.until(31)
        desk.do("mouseup", "1")
        for key, step in (
            ("Home", 0), ("End", 40), ("Prior", 36), ("Next", 40), ("Left", 39), ("shift+Left", 29),
            ("comma", 20), ("period", 40),
        ):  # fmt: skip
            desk.do("key", key)
            desk.until(step)
        desk.do("keydown", "Left")
        desk.until(34)
        desk.do("keyup", "Left")
        desk.do("key", "Home")
        desk.until(0)
        desk.do("key", "plus")
        assert desk.told()[2] == 2.0
        desk.do("mousemove", *button(pygame.K_MINUS), "click", "1")
        assert desk.told()[2] == 1.0
        desk.do("mousemove", *button(pygame.K_RIGHT), "click", "1")
        desk.until(1)
        desk.do("mousemove", *button(pygame.K_l), "click", "1")
        assert desk.told()[3]
        desk.do("mousemove", *button(pygame.K_END), "click", "1")
        desk.until(40)
        desk.do("mousemove", "100", "300")
        assert shows_the_end(desk, here)
        desk.do("mousemove", *button(pygame.K_q), "click", "1")
        assert desk.leaves()
    here.close()


def shows_the_end(desk: Desk, here: Viewer) -> bool:
    """Whether the screen looks as a viewer without one, at the end with the log open."""
    here.state.log = True
    here.playhead.seek(here.playhead.length, playing=False)
    here.window.frame(here)
    shown = here.window._display.surface
    assert shown is not None
    wanted = shown.copy()
    for _ in range(100):
        picture = desk.screen.picture()
        assert picture.get_size() == SIZE
        if difference(wanted, picture) < 40:
            return True
    return False
