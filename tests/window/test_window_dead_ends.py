"""Every screen and card can be left with Escape, the mouse or a gamepad."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator

import pygame
import pytest
from tests.support.samples import quick_sample, quick_sample_of_pairs
from tests.support.window_play import post
from tests.support.window_session import WindowSession, wait

from robotouille.episode.rules import Clock
from robotouille_client.window.app.local_game import GameSetup
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.widgets import Row
from robotouille_client.window.replay.timeline.timeline_strip import TimelineStrip

Steps = Iterator[None]
SHORT = GameSetup("synchronous/01", clock=Clock.TURN, max_steps=3)
AWAY = ("Back", "Cancel", "Leave", "Leave the replay", "Menu", "Quit", "Close")
"""What buttons that lead away are called."""


def choose(*labels: str) -> Callable[[WindowSession], Steps]:
    """Choose a menu entry."""

    def steps(session: WindowSession) -> Steps:
        for label in labels:
            yield from session.choose(label)

    return steps


def lose(session: WindowSession) -> Steps:
    """Play a game of three turns to its end card."""
    yield from wait(3)
    for _ in range(4):
        post(pygame.K_SPACE)
        yield from wait(3)
    yield from wait(60)


def lose_and(*labels: str) -> Callable[[WindowSession], Steps]:
    def steps(session: WindowSession) -> Steps:
        yield from lose(session)
        yield from choose(*labels)(session)
        yield from wait(3)

    return steps


def ask_to_leave(session: WindowSession) -> Steps:
    post(pygame.K_ESCAPE)
    yield from wait(3)


def open_list(session: WindowSession) -> Steps:
    post(pygame.K_TAB)
    yield from wait(3)


def type_something(session: WindowSession) -> Steps:
    post(pygame.K_t)
    yield from wait(2)
    post("hello")
    yield from wait(2)


def show_help(session: WindowSession) -> Steps:
    post(pygame.K_h)
    yield from wait(3)


FROM_MENU = {
    "levels": choose("Levels"),
    "all tasks": choose("Levels", "All tasks"),
    "play": choose("Play here"),
    "join": choose("Join with a code"),
    "open": choose("Open a kitchen"),
    "replays": choose("Replays"),
    "tutorial": choose("Tutorial (two minutes)"),
    "settings": choose("Settings"),
    "keys": choose("Settings", "Keys"),
    "connecting": choose("Find a kitchen"),
    "nobody answers": choose("Join with a code", "Play"),
}
IN_A_GAME = {
    "playing": lambda session: wait(3),
    "list": open_list,
    "help": show_help,
    "chat": type_something,
    "leaving": ask_to_leave,
    "end": lose,
    "replay": lose_and("Watch the replay"),
    "saving": lose_and("Save a video"),
}


def current(session: WindowSession) -> Form | None:
    """Return the form that is shown; None in a game or replay."""
    if session.window is not None and not session.window.closed:
        return session.window.card
    return session.form


def escape(session: WindowSession) -> Steps:
    """Press Escape, and confirm leaving where the window asks."""
    asked = current(session)
    post(pygame.K_ESCAPE)
    yield from wait(3)
    if current(session) is not asked and "?" in title(session):
        yield from session.choose(way_out(session).label)


def click(session: WindowSession) -> Steps:
    """Click on the way out: a button, or its key below the kitchen."""
    for _ in range(20):
        at = place(session)
        if at is not None:
            break
        pygame.event.post(pygame.Event(pygame.MOUSEWHEEL, y=-1, x=0))
        yield from wait(2)
    assert at is not None, f"{title(session)!r} has no way out that can be clicked"
    pygame.event.post(pygame.Event(pygame.MOUSEMOTION, pos=at, rel=(0, 0), buttons=(0, 0, 0)))
    yield
    pygame.event.post(pygame.Event(pygame.MOUSEBUTTONDOWN, pos=at, button=1))
    yield from wait(3)


def press_b(session: WindowSession) -> Steps:
    """Press B, and confirm leaving where the window asks."""
    asked = current(session)
    yield from push(pygame.CONTROLLER_BUTTON_B)
    form = current(session)
    if form is not asked and form is not None and "?" in form.title:
        while form.focused is not way_out(session):
            yield from push(pygame.CONTROLLER_BUTTON_DPAD_DOWN)
        yield from push(pygame.CONTROLLER_BUTTON_A)


def push(button: int) -> Steps:
    for kind in (pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP):
        pygame.event.post(pygame.Event(kind, button=button, instance_id=0))
    yield from wait(3)


def title(session: WindowSession) -> str:
    form = current(session)
    return "" if form is None else form.title


def way_out(session: WindowSession) -> Row:
    form = current(session)
    return next(row for label in AWAY for row in form.rows if row.label == label)


def place(session: WindowSession) -> tuple[int, int] | None:
    """Return where the way out is; None if it is not visible."""
    form = current(session)
    if form is not None:
        area = form.place_of(way_out(session))
        return area and area.center
    if isinstance(session.window._strip, TimelineStrip):
        return session.window._strip.button(pygame.K_q)
    keys = session.window._painter._key_strip._places
    return next(area.center for area, key in keys if key == "Esc")


WAYS = {"escape": escape, "mouse": click, "gamepad": press_b}


def leave(session: WindowSession, way: str, screen: str) -> Steps:
    """Go back to the menu with one device."""
    before = None
    for _ in range(5):
        if title(session).startswith("Hello"):
            return
        before = title(session)
        yield from WAYS[way](session)
        yield from wait(3)
    raise AssertionError(f"{screen!r} is a dead end by {way}: it stays at {before!r}")


@pytest.fixture(autouse=True)
def no_server(session: WindowSession) -> None:
    session.app.settings.prefer(server="ws://127.0.0.1:9")
    session.app.settings.code = "ABC"


@pytest.mark.parametrize("way", quick_sample(WAYS))
async def test_each_screen_of_the_menu_can_be_left(session: WindowSession, way: str) -> None:
    def script() -> Steps:
        yield
        for screen, steps in FROM_MENU.items():
            yield from steps(session)
            yield from wait(2)
            assert not title(session).startswith("Hello"), screen
            yield from leave(session, way, screen)
        yield from session.choose("Quit")
        yield from wait(50)
        raise AssertionError("it goes on after Quit")

    await asyncio.wait_for(session.go(script), 60)
    assert not session.user.ended


@pytest.mark.parametrize(
    ("screen", "way"),
    [
        pair
        for pair in quick_sample_of_pairs(IN_A_GAME, list(WAYS), 4)
        if pair.values != ("chat", "mouse")  # Letters need keys.
    ],
)
async def test_each_screen_of_a_game_can_be_left(
    session: WindowSession, screen: str, way: str
) -> None:
    def script() -> Steps:
        yield from wait(3)
        yield from IN_A_GAME[screen](session)
        yield from leave(session, way, screen)
        yield from session.choose("Quit")
        yield from wait(50)
        raise AssertionError("it goes on after Quit")

    await asyncio.wait_for(session.go(script, SHORT), 60)
    assert not session.user.ended
