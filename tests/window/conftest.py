"""Everything here draws without a screen."""

from __future__ import annotations

import os

os.environ["SDL_VIDEODRIVER"] = "dummy"
os.environ["SDL_AUDIODRIVER"] = "dummy"
os.environ["PYGAME_HIDE_SUPPORT_PROMPT"] = "1"

from collections.abc import Callable, Iterator
from functools import lru_cache
from io import BytesIO
from typing import Any

import pytest

pytest.importorskip("pygame")

import pygame

from robotouille import State, World
from robotouille_client.window.forms.display import Display

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


Course = list[State]


@pytest.fixture
def display() -> Iterator[Display]:
    opened = Display((800, 600), headless=True)
    opened.open()
    pygame.event.clear()
    yield opened
    opened.close()


@pytest.fixture(scope="session")
def play() -> Callable[..., Course]:
    return _play


def _play(world: World, *lines: str, player: str | None = None) -> Course:
    """The states of a course of lines such as `pick-up-item bread1`; `-` is a step of nothing."""
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
