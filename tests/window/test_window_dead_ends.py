"""Every screen and card of the window can be left: by Escape, by the mouse, by a gamepad."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import pygame
import pytest
from tests.support.evening import SIZE, Evening, wait
from tests.support.window_play import post

from robotouille.episode.rules import Clock
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Row
from robotouille_client.window.hands.commands import KeyMap
from robotouille_client.window.replay.timeline.timeline_strip import TimelineStrip
from robotouille_client.window.shell.games.local_game import GameSetup
from robotouille_client.window.shell.settings import Settings

Steps = Iterator[None]
SHORT = GameSetup("synchronous/01", clock=Clock.TURN, max_steps=3)
AWAY = ("Back", "Cancel", "Leave it", "Leave the replay", "Menu", "Quit", "Close")
"""What buttons that lead away are called."""


def choose(*labels: str) -> Callable[[Evening], Steps]:
    """From the menu to a screen."""

    def steps(evening: Evening) -> Steps:
        for label in labels:
            yield from evening.choose(label)

    return steps


def lose(evening: Evening) -> Steps:
    """From a game of three turns to its end card."""
    yield from wait(3)
    for _ in range(4):
        post(pygame.K_SPACE)
        yield from wait(3)
    yield from wait(60)


def lose_and(*labels: str) -> Callable[[Evening], Steps]:
    def steps(evening: Evening) -> Steps:
        yield from lose(evening)
        yield from choose(*labels)(evening)
        yield from wait(3)

    return steps


def ask_to_leave(evening: Evening) -> Steps:
    post(pygame.K_ESCAPE)
    yield from wait(3)


def open_list(evening: Evening) -> Steps:
    post(pygame.K_TAB)
    yield from wait(3)


def type_something(evening: Evening) -> Steps:
    post(pygame.K_t)
    yield from wait(2)
    post("hello")
    yield from wait(2)


def show_help(evening: Evening) -> Steps:
    post(pygame.K_h)
    yield from wait(3)


FROM_MENU = {
    "play": choose("Play here"),
    "join": choose("Join by code"),
    "open": choose("Open a kitchen on a server"),
    "replays": choose("Replays"),
    "tutorial": choose("Tutorial: two minutes"),
    "settings": choose("Settings"),
    "keys": choose("Settings", "Keys"),
    "connecting": choose("Kitchens on a server"),
    "nobody answers": choose("Join by code", "Play"),
}
IN_A_GAME = {
    "playing": lambda evening: wait(3),
    "list": open_list,
    "help": show_help,
    "chat": type_something,
    "leaving": ask_to_leave,
    "end": lose,
    "replay": lose_and("Watch the replay"),
    "saving": lose_and("Save a video"),
}


def current(evening: Evening) -> Form | None:
    """The form that is asked; None in a game, or a replay."""
    if evening.window is not None and not evening.window.closed:
        return evening.window.card
    return evening.form


def escape(evening: Evening) -> Steps:
    """Escape; where that asks whether one means it, Enter on what leads away."""
    asked = current(evening)
    post(pygame.K_ESCAPE)
    yield from wait(3)
    if current(evening) is not asked and "?" in title(evening):
        yield from evening.choose(way_out(evening).label)


def click(evening: Evening) -> Steps:
    """A click on what leads away: a button of the form, which may have to be scrolled to, or the
    key for it below the kitchen."""
    at = place(evening)
    for _ in range(20):
        if at is not None:
            break
        pygame.event.post(pygame.Event(pygame.MOUSEWHEEL, y=-1, x=0))
        yield from wait(2)
        at = place(evening)
    assert at is not None, f"{title(evening)!r} has no way out that can be clicked"
    pygame.event.post(pygame.Event(pygame.MOUSEMOTION, pos=at, rel=(0, 0), buttons=(0, 0, 0)))
    yield
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=at, button=1))
    yield from wait(3)


def press_b(evening: Evening) -> Steps:
    """B; where that asks whether one means it, down to what leads away, and A."""
    asked = current(evening)
    yield from push(pygame.CONTROLLER_BUTTON_B)
    form = current(evening)
    if form is not asked and form is not None and "?" in form.title:
        while form.focused is not way_out(evening):
            yield from push(pygame.CONTROLLER_BUTTON_DPAD_DOWN)
        yield from push(pygame.CONTROLLER_BUTTON_A)


def push(button: int) -> Steps:
    for kind in (pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP):
        pygame.event.post(pygame.Event(kind, button=button, instance_id=0))
    yield from wait(3)


def title(evening: Evening) -> str:
    form = current(evening)
    return "" if form is None else form.title


def way_out(evening: Evening) -> Row:
    form = current(evening)
    assert form is not None
    return next(row for label in AWAY for row in form.rows if row.label == label)


def place(evening: Evening) -> tuple[int, int] | None:
    """Where the way out is, as the mouse finds it; None where it is not in sight."""
    form = current(evening)
    if form is None:
        assert evening.window is not None
        if isinstance(evening.window._strip, TimelineStrip):
            found = evening.window._strip._buttons.place(pygame.K_q)
            assert found is not None
            return found.center
        keys = evening.window._painter._key_strip._places
        return next(area.center for area, key in keys if key == "Esc")
    focused = form.focused
    for y in range(0, SIZE[1], 4):
        for x in (SIZE[0] // 4, SIZE[0] - 40):
            form._focus = -1
            at = {"pos": (x, y), "rel": (0, 0), "buttons": (0, 0, 0)}
            form.handle(pygame.Event(pygame.MOUSEMOTION, at), KeyMap())
            if form.focused is way_out(evening):
                return x, y + 4
    assert focused is not None
    form.focus(focused)
    return None


WAYS = {"escape": escape, "mouse": click, "gamepad": press_b}


def leave(evening: Evening, way: str, screen: str) -> Steps:
    """Go back to the menu in one way alone."""
    before = None
    for _ in range(5):
        if title(evening).startswith("Hello"):
            return
        before = title(evening)
        yield from WAYS[way](evening)
        yield from wait(3)
    raise AssertionError(f"{screen!r} is a dead end by {way}: it stays at {before!r}")


@pytest.fixture
def evening(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Evening:
    settings = Settings(learned=True, size=SIZE, server="ws://127.0.0.1:9", code="ABC")
    found = Evening(tmp_path, settings)
    found.watch(monkeypatch)
    return found


@pytest.mark.parametrize("way", WAYS)
async def test_each_screen_of_the_menu_can_be_left(evening: Evening, way: str) -> None:
    def script() -> Steps:
        yield
        for screen, steps in FROM_MENU.items():
            yield from steps(evening)
            yield from wait(2)
            assert not title(evening).startswith("Hello"), screen
            yield from leave(evening, way, screen)
        yield from evening.choose("Quit")
        yield from wait(50)
        raise AssertionError("it goes on after Quit")

    await asyncio.wait_for(evening.go(script), 60)
    assert not evening.fingers.ended


@pytest.mark.parametrize(
    ("screen", "way"),
    [pair for pair in product(IN_A_GAME, WAYS) if pair != ("chat", "mouse")],  # Letters need keys.
)
async def test_each_screen_of_a_game_can_be_left(evening: Evening, screen: str, way: str) -> None:
    def script() -> Steps:
        yield from wait(3)
        yield from IN_A_GAME[screen](evening)
        yield from leave(evening, way, screen)
        yield from evening.choose("Quit")
        yield from wait(50)
        raise AssertionError("it goes on after Quit")

    await asyncio.wait_for(evening.go(script, SHORT), 60)
    assert not evening.fingers.ended
