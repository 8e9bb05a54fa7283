"""Everything here draws without a screen."""

from __future__ import annotations

import os

os.environ["SDL_VIDEODRIVER"] = "dummy"
os.environ["SDL_AUDIODRIVER"] = "dummy"
os.environ["PYGAME_HIDE_SUPPORT_PROMPT"] = "1"

from collections.abc import Callable, Iterator
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pygame")

import pygame
from tests.support.window_session import WindowSession

from robotouille import State, World
from robotouille_client.window.forms.screen import Display

# The fonts of the system are listed by a program: once, before any test.
FONTS = pytest.importorskip("pygame.font")
FONTS.init()
FONTS.get_fonts()

load_sized_svg = pygame.image.load_sized_svg


@lru_cache(maxsize=1500)
def drawn_once(svg: bytes, size: tuple[int, int]) -> Any:
    return load_sized_svg(BytesIO(svg), size)


@pytest.fixture(autouse=True)
def pictures_drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each window draws all its pictures anew, which is a tenth of the time of these tests."""

    def load(file: Any, size: tuple[int, int]) -> Any:
        if isinstance(file, BytesIO) and max(size) <= 160:
            return drawn_once(file.getvalue(), size)
        return load_sized_svg(file, size)

    monkeypatch.setattr(pygame.image, "load_sized_svg", load)


@pytest.fixture(autouse=True)
def display_closed() -> Iterator[None]:
    """Close the display that a test has opened."""
    yield
    pygame.display.quit()


@pytest.fixture
def display() -> Display:
    opened = Display((800, 600), headless=True)
    opened.open()
    pygame.event.clear()
    return opened


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> WindowSession:
    """Application with scripted input, and all its files in an empty folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    found = WindowSession(tmp_path)
    found.watch(monkeypatch)
    return found


@pytest.fixture(scope="session")
def play() -> Callable[..., list[State]]:
    return _play


def _play(world: World, *lines: str, player: str | None = None) -> list[State]:
    """Play lines such as `pick-up-item bread1` and return the states; `-` does nothing."""
    player = player or world.players[0]
    states = [world.initial]
    for line in lines:
        name, *arguments = line.split()
        state = states[-1]
        if name == "-":
            states.append(state.step([]).state)
            continue
        valid = [a for a in state.actions(player) if a.name == name]
        action = next(a for a in valid if set(arguments) <= set(a.arguments))
        states.append(state.step(action).state)
    return states
