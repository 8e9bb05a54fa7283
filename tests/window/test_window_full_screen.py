"""Full screen on a virtual screen without a window manager."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pygame
import pytest
from tests.support.screens import REAL_INPUT, SIZE, Screen, open_screen

from robotouille_client.window.forms.screen import DESKTOPS

PROGRAM = """
import asyncio
from robotouille_client.window.forms.screen import Display
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.screen import Screen
from robotouille_client.window.forms.widgets import Button, Choice
from robotouille_client.window.pictures.theme import BACKGROUND

async def sleep(seconds):
    await asyncio.sleep(seconds)
    for line in said():
        print(line, flush=True)

seen = [None]
def said():
    shown = (display.surface.get_size(), display.size, choice.index)
    if shown != seen[-1]:
        seen.append(shown)
        yield f"{shown[0]} of {shown[1]} at {shown[2]}"

choice = Choice("Task", [(str(n), n) for n in range(50)])
display = Display((640, 400))
asyncio.run(Screen(display, sleep=sleep).ask(Form("Menu", [choice, Button("Quit", "quit")])))
print("size", display.size, flush=True)
"""

pytestmark = REAL_INPUT


@pytest.fixture
def screen(tmp_path: Path) -> Iterator[Screen]:
    with open_screen(tmp_path / "screen") as opened:
        yield opened


def covered(picture: pygame.Surface) -> bool:
    """Return whether something is drawn in all corners."""
    width, height = picture.get_size()
    corners = [(2, 2), (width - 3, 2), (2, height - 3), (width - 3, height - 3)]
    return all(picture.get_at(corner)[:3] != (0, 0, 0) for corner in corners)


def test_f11_toggles_full_screen(screen: Screen) -> None:
    env = {**os.environ, "DISPLAY": screen.display, "SDL_AUDIODRIVER": "dummy"}
    for received in ("SDL_VIDEODRIVER", *DESKTOPS):
        env.pop(received, None)
    full = f"{SIZE} of (640, 400) at 0"
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM], env=env, stdout=subprocess.PIPE, text=True
    ) as window:
        try:
            assert window.stdout is not None

            def press(*keys: str) -> None:
                subprocess.run(["xdotool", "key", "--delay", "20", *keys], env=env, check=True)

            def until(words: str) -> None:
                assert window.stdout is not None
                for line in window.stdout:
                    if line.strip() == words:
                        return
                raise AssertionError(f"never said {words!r}")

            until("(640, 400) of (640, 400) at 0")
            assert not covered(screen.picture())
            subprocess.run(["xdotool", "mousemove", "640", "360"], env=env, check=True)
            press("F11")
            until(full)
            press("Right")
            until(f"{SIZE} of (640, 400) at 1")
            assert covered(screen.picture())
            press("F11")
            until("(640, 400) of (640, 400) at 1")
            press(*["Right"] * 39)
            until("(640, 400) of (640, 400) at 40")
            press("Down", "Return")
            until("size (640, 400)")
        finally:
            window.kill()
