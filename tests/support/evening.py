"""Somebody's evening at the window: a shell, what is asked in it, and their fingers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pygame
import pytest

from robotouille import World, load_task
from robotouille.certification.certificate import load_certificate
from robotouille_client.bots.partners import prompt_partners
from robotouille_client.window.forms.display import Display
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.screen import Screen
from robotouille_client.window.shell import replays
from robotouille_client.window.shell.games.local_game import GameSetup
from robotouille_client.window.shell.settings import Settings
from robotouille_client.window.shell.shell import Shell
from robotouille_client.window.view import Source
from robotouille_client.window.window import Window
from tests.support.window_play import ARROWS, Fingers, Timer, goes_to, post, way

SIZE = (640, 480)


class Evening:
    """A shell, what is asked in it, and the fingers of its owner."""

    def __init__(
        self, folder: Path, settings: Settings | None = None, *, menu: bool = True
    ) -> None:
        self.folder = folder
        self.fingers = Fingers(Timer())
        self.shell = Shell(
            settings or Settings(learned=True, size=SIZE),
            Display(SIZE, headless=True),
            path=folder / "window.json",
            recordings=folder / "recordings",
            menu=menu,
            make_partners=prompt_partners,
            clock=self.fingers.timer,
            sleep=self.fingers.sleep,
        )
        self.titles: list[str] = []
        self.form: Form | None = None
        self.window: Window | None = None

    def watch(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Note each form that is asked, and each window of a game; videos are small."""
        ask, frame, start = Screen.ask, Window.frame, Window.run

        async def asked(screen: Screen, form: Form, until: object = None) -> object:
            self.form = form
            self.titles.append(form.title)
            return await ask(screen, form, until)  # type: ignore[arg-type]

        def framed(window: Window, source: Source) -> None:
            frame(window, source)
            if window.card is not None and window.card is not self.form:
                self.form = window.card
                self.titles.append(self.form.title)

        async def started(window: Window, source: object, **options: object) -> None:
            self.window = window
            await start(window, source, **options)  # type: ignore[arg-type]

        monkeypatch.setattr(Screen, "ask", asked)
        monkeypatch.setattr(Window, "frame", framed)
        monkeypatch.setattr(Window, "run", started)
        monkeypatch.setattr(replays, "VIDEO_SIZE", "320x180")

    async def go(
        self, script: Callable[[], Iterator[None]], first: GameSetup | None = None
    ) -> None:
        self.fingers.script = script()
        await self.shell.run(self.shell.local.play(first) if first is not None else None)

    def choose(self, label: str) -> Iterator[None]:
        """Go down to a button of the form that is asked, and press Enter."""
        assert self.form is not None
        row = next(row for row in self.form.rows if row.label == label)
        for _ in self.form.rows:
            if self.form.focused is row:
                break
            post(pygame.K_DOWN)
            yield
        assert self.form.focused is row
        post(pygame.K_RETURN)
        yield from wait(3)


def wait(frames: int) -> Iterator[None]:
    for _ in range(frames):
        yield


def keys_of(setup: GameSetup) -> Iterator[None]:
    """Play the proven plan of a task with arrows and E."""
    world = World(load_task(setup.task, timing="benchmark"))
    state, me = world.initial, world.players[0]
    for line in load_certificate(world.task).plan or ():
        action = world.parse(state, me, line)
        station = goes_to(action)
        for key in [ARROWS[c] for c in way(state, me, station)] if station else [pygame.K_e]:
            post(key)
            yield from wait(2)
        state = state.step(action).state
