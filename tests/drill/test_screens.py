"""Recognition of an episode in a picture, so that the drill accepts no dead window."""

from __future__ import annotations

import os
from types import SimpleNamespace
from typing import Any

import pytest

from robotouille import State, World, load_task
from robotouille.protocol.messages import SeatInfo

PLAYER = "robot1"


@pytest.fixture(autouse=True)
def _display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "SDL_VIDEODRIVER", "dummy")
    monkeypatch.setitem(os.environ, "PYGAME_HIDE_SUPPORT_PROMPT", "1")
    pygame = pytest.importorskip("pygame")
    pygame.display.init()
    pygame.font.init()
    pygame.display.set_mode((1, 1))


@pytest.fixture
def start() -> State:
    return World(load_task("multi_agent/01_lettuce_burger", seats=2)).initial


def recognized(picture: Any, state: State) -> bool:
    """Return whether a picture is recognized as an episode in this state."""
    from robotouille_client.window.drawing.painter import Painter
    from tests.support.screens import likeness

    seats = [SeatInfo(player=player, name=player, present=True) for player in state.world.players]
    game: Any = SimpleNamespace(
        world=state.world, state=state, step=3, clock={"step_rate": 5.0}, seats=seats, code="AB"
    )
    return likeness(picture, Painter(), game, PLAYER).good


def window(state: State | None, **changes: Any) -> Any:
    """Draw a window at a state, or a black window without one."""
    import pygame

    from robotouille_client.window.drawing.painter import Painter
    from robotouille_client.window.view import SeatView, View
    from tests.support.screens import SIZE

    surface = pygame.Surface(SIZE, depth=24)
    if state is not None:
        seats = tuple(SeatView(player, player) for player in state.world.players)
        view = View(state.world, state, step=3, me=PLAYER, seats=seats, **changes)
        Painter().paint(surface, view)
    return surface


def test_only_a_live_window_at_the_same_state_is_recognized(start: State) -> None:
    assert recognized(window(start), start)
    action = next(a for a in start.actions(PLAYER) if a.name == "move")
    assert not recognized(window(start), start.step(action).state), "an earlier state"
    assert not recognized(window(start, offline=5.0), start), "no connection"
    assert not recognized(window(None), start), "a black window"
