"""Random input at any time breaks nothing, answers no card by accident, and Escape leads out."""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pygame
import pytest
from tests.support.samples import quick_sample
from tests.support.window_play import Script, Timer, headless_window, post
from tests.support.window_session import SIZE, WindowSession, wait

from robotouille import World, load_task
from robotouille.episode.rules import Clock
from robotouille_client.window.app.game_cards import LEAVE_BUTTONS, REVIEW_BUTTONS, GameCards
from robotouille_client.window.app.local_game import GameSetup
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.forms.screen import Display
from robotouille_client.window.view import (
    Bubble,
    FarewellView,
    LobbyRow,
    LobbyView,
    PauseView,
    SeatView,
    View,
)
from robotouille_client.window.window import Window

WORLD = World(load_task("multi_agent/01", timing="people"))
ME, OTHER = WORLD.players
LOBBY = LobbyView((LobbyRow("ada (you)", "here"), LobbyRow("ben", "free")), code="KQXZB-MHTWA")
STATES: dict[str, dict[str, object]] = {
    "waiting": {"lobby": LOBBY},
    "waiting for who is ready": {"lobby": dataclasses.replace(LOBBY, ready=False)},
    "countdown": {"starts_in": 2.0},
    "running": {},
    "refused": {"bubbles": (Bubble(ME, "Somebody stands there."),)},
    "paused": {"pause": PauseView("Paused", "ben is away", 20.0, 0.5)},
    "watching": {"me": None},
    "connection lost": {"offline": 25.0},
    "bot thinking": {"thinking": (OTHER,), "waits_for": (OTHER,)},
    "ended": {"outcome": "Out of steps"},
    "sent out": {"farewell": FarewellView("You were sent out", "By the operator.")},
}
LAST = ("ended", "sent out")
BUTTONS = (("Play again", "again"), *REVIEW_BUTTONS, *LEAVE_BUTTONS)
LETTERS = [*"abcdehmqstw123456789", "SPACE"]
KEYS = [
    *LETTERS, "RETURN", "ESCAPE", "TAB", "BACKSPACE", "DELETE", "HOME", "END", "PAGEUP",
    "PAGEDOWN", "LEFT", "RIGHT", "UP", "DOWN", "LSHIFT", *(f"F{n}" for n in (*range(1, 11), 12)),
]  # fmt: skip
"""Not F11: large pictures take long."""
PAD_BUTTONS = range(pygame.CONTROLLER_BUTTON_DPAD_RIGHT + 1)
NOT_THE_GAMES = {"RETURN", "ESCAPE"}
"""The keys that may answer a card; the mouse and gamepads may, too."""


class AnyState(Script):
    """Source that can be in any state of a game."""

    def __init__(self) -> None:
        super().__init__(WORLD, ME, slow=True)
        self.now = "running"

    @property
    def finished(self) -> bool:
        return self.now in LAST

    def view(self) -> View:
        seats = (SeatView(ME, "ada"), SeatView(OTHER, "ben", "bot"))
        return dataclasses.replace(super().view(), seats=seats, **STATES[self.now])

    def be_ready(self, ready: bool) -> None:
        self.said.append(str(ready))


class RandomUser:
    """User who presses and clicks random_input, and reopens a window that closes."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.random = Random(seed)
        self.timer = Timer()
        self.source = AnyState()
        self.folder = folder
        self.display = Display((320, 240), headless=True)
        self.display.open()
        self.window = self.open()

    def open(self) -> Window:
        return headless_window(display=self.display, clock=self.timer, screenshots=self.folder,
            cards=GameCards(lambda: None, lambda: BUTTONS),)  # fmt: skip

    def press_escape(self) -> None:
        for kind in (pygame.KEYUP, pygame.KEYDOWN, pygame.KEYUP):
            pygame.event.post(pygame.Event(kind, key=pygame.K_ESCAPE, mod=0, unicode=""))
        self.window.frame(self.source)

    def do_anything(self) -> None:
        """One input; where that was an answer, it was meant as one."""
        name, events = random_input(self.random)
        self.window.frame(self.source)
        shown = self.window.card
        chats = self.window.overlay(self.source.view()).typing is not None
        received = shown is not None and (shown.listens or chats)
        for event in events:
            pygame.event.post(event)
        self.window.frame(self.source)
        if self.window.answer is not None:
            assert shown is not None, name
            assert name in NOT_THE_GAMES | {"click", "pad"}, name
            assert self.window.answer in {row.answer for row in shown.rows}
            assert received or name == "click", f"{name} came too early"
            self.window = self.open()
        self.timer.now += self.random.choice((0.02, 0.02, 0.1, 0.5))
        if self.random.random() < 0.1 and self.source._asked is not None:
            self.source.step()

    def escape(self) -> None:
        """Press Escape until there is a way out; what it does then."""
        for _ in range(5):
            if self.window.card is None:
                self.press_escape()
        card, by_itself = self.window.card, self.source.finished
        assert card is not None, f"{self.source.now}: Escape leads nowhere"
        assert {row.answer for row in card.rows} & {"menu", "quit"}, card.title
        for _ in range(2 if by_itself else 1):  # A line of chat may be open over it.
            self.timer.now += 2.0
            if self.window.answer is None:
                self.press_escape()
        assert self.window.card is None or self.window.answer == "menu"


def random_input(
    random: Random, size: tuple[int, int] = (320, 240)
) -> tuple[str, list[pygame.Event]]:
    """Return a random input's name and events."""
    kind = random.choice(("key", "key", "key", "key", "click", "mouse", "pad", "odd"))
    at = random.randrange(size[0]), random.randrange(size[1])
    if kind == "key":
        name = random.choice(KEYS)
        return name, key_press(name, random)
    if kind == "click":
        down = pygame.Event(pygame.MOUSEBUTTONDOWN, pos=at, button=random.choice((1, 1, 2, 3, 4)))
        return kind, [down, pygame.Event(pygame.MOUSEBUTTONUP, pos=at, button=1)]
    if kind == "mouse":
        held = (random.randrange(2), 0, 0)
        moved = pygame.Event(pygame.MOUSEMOTION, pos=at, rel=(0, 0), buttons=held)
        return kind, [random.choice((moved, pygame.Event(pygame.MOUSEWHEEL, x=0, y=-1)))]
    if kind == "pad":
        button, axis = random.choice(PAD_BUTTONS), random.randrange(4)
        tilt = pygame.Event(
            pygame.CONTROLLERAXISMOTION, axis=axis, value=random.choice((-30_000, 0, 30_000))
        )
        push = [
            pygame.Event(each, button=button, instance_id=0)
            for each in (pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP)
        ]
        return kind, random.choice((push, push, [tilt]))
    odd = (pygame.WINDOWLEAVE, pygame.WINDOWFOCUSLOST)
    gone = pygame.Event(pygame.CONTROLLERDEVICEREMOVED, instance_id=0)
    return kind, [random.choice((*map(pygame.Event, odd), gone))]


def key_press(name: str, random: Random) -> list[pygame.Event]:
    """Return events of a key press that may type a letter and is mostly released."""
    key = getattr(pygame, f"K_{name}")
    mod = pygame.KMOD_LSHIFT if random.random() < 0.1 else 0
    events = [pygame.Event(pygame.KEYDOWN, key=key, mod=mod, unicode="")]
    if name in LETTERS:
        letter = " " if name == "SPACE" else name
        events.append(pygame.Event(pygame.TEXTINPUT, text=letter))
    if random.random() < 0.9:
        events.append(pygame.Event(pygame.KEYUP, key=key, mod=mod))
    return events


@pytest.mark.parametrize("state", quick_sample(STATES, 2))
def test_random_input_in_every_state_of_a_game(state: str, tmp_path: Path) -> None:
    anybody = RandomUser(list(STATES).index(state), tmp_path)
    for _ in range(3):
        for _ in range(8):
            anybody.do_anything()
        anybody.source.now = state
        for _ in range(12):
            anybody.do_anything()
        anybody.escape()
        anybody.source.now = "running"
        anybody.window = anybody.open()


def to_replay(session: WindowSession) -> Iterator[None]:
    """Play a game of three turns, and open its replay."""
    for _ in range(4):
        post(pygame.K_SPACE)
        yield from wait(3)
    yield from wait(60)
    yield from session.choose("Watch the replay")


def to_menu(session: WindowSession, size: int = 12) -> Iterator[None]:
    """Press Escape, and confirm leaving where the window asks."""
    pygame.event.post(pygame.Event(pygame.KEYUP, key=pygame.K_ESCAPE, mod=0))
    for _ in range(size):
        if session.titles[-1:] == ["Hello, player!"]:
            return
        asked = len(session.titles)
        post(pygame.K_ESCAPE)
        yield from wait(60)
        card = session.window.card if session.window is not None else None
        if len(session.titles) > asked and card is not None and card.title.endswith("?"):
            post(pygame.K_DOWN, pygame.K_RETURN)
            yield from wait(60)
    raise AssertionError(f"no way out of {session.titles[-1]!r}")


STARTS = {
    "game": (
        GameSetup("synchronous/01", clock=Clock.REALTIME, rate=10.0, max_steps=60),
        lambda session: wait(1),
    ),
    "replay": (GameSetup("synchronous/01", clock=Clock.TURN, max_steps=3), to_replay),
    "tutorial": (None, lambda session: session.choose("Tutorial (two minutes)")),
}


@pytest.mark.parametrize("inputs", [20, pytest.param(250, marks=pytest.mark.slow)])
@pytest.mark.parametrize("start", STARTS)
async def test_random_input_from_the_menu_to_the_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, start: str, inputs: int
) -> None:
    monkeypatch.chdir(tmp_path)
    settings = Settings(learned=True, size=SIZE, task="synchronous/01", server="ws://127.0.0.1:9")
    session = WindowSession(tmp_path, settings)
    session.watch(monkeypatch)
    random, (game, steps) = Random(inputs), STARTS[start]

    def script() -> Iterator[None]:
        yield
        yield from steps(session)
        for _ in range(inputs):
            for event in random_input(random, SIZE)[1]:
                pygame.event.post(event)
            yield from wait(random.choice((1, 1, 1, 10)))
        yield from to_menu(session)

    await asyncio.wait_for(session.go(script, game), 60)
