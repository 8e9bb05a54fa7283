"""A session at the window: the application, its open form, and scripted input."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import pygame
import pytest

from robotouille import World, load_task
from robotouille.certification.certificate import load_certificate
from robotouille_client.bots.partners import prompt_partners
from robotouille_client.window.app import replays
from robotouille_client.window.app.app import App, UserFiles
from robotouille_client.window.app.local_game import GameSetup
from robotouille_client.window.app.settings import Settings, load_settings
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.screen import Display, Screen
from robotouille_client.window.input.action_queue import GUARD_SECONDS
from robotouille_client.window.options import TimeSource
from robotouille_client.window.view import GameSource
from robotouille_client.window.window import Window
from tests.support.window_play import ARROWS, ScriptedUser, Timer, goes_to, post, way

SIZE = (640, 480)


class WindowSession:
    """The window application with its open form and scripted input."""

    def __init__(
        self, folder: Path, settings: Settings | None = None, *, menu: bool = True
    ) -> None:
        self.folder = folder
        self.user = ScriptedUser(Timer())
        self.app = App(
            settings or Settings(learned=True, size=SIZE),
            Display(SIZE, headless=True),
            storage=UserFiles(folder / "window.json", recordings=folder / "recordings"),
            menu=menu,
            make_partners=prompt_partners,
            time_source=TimeSource(self.user.timer, self.user.sleep),
        )
        self.titles: list[str] = []
        self.others: list[asyncio.Future[None]] = []
        self.form: Form | None = None
        self.window: Window | None = None
        self.source: Any = None

    def watch(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Record each form and each game window that opens, and make videos small."""
        ask, frame, start = Screen.ask, Window.frame, Window.run

        async def asked(screen: Screen, form: Form, until: object = None) -> object:
            self.form = form
            self.titles.append(form.title)
            return await ask(screen, form, until)  # type: ignore[arg-type]

        def framed(window: Window, source: GameSource) -> None:
            frame(window, source)
            if window.card is not None and window.card is not self.form:
                self.form = window.card
                self.titles.append(self.form.title)

        async def started(window: Window, source: object, **options: object) -> None:
            self.window, self.source = window, source
            await start(window, source, **options)  # type: ignore[arg-type]

        monkeypatch.setattr(Screen, "ask", asked)
        monkeypatch.setattr(Window, "frame", framed)
        monkeypatch.setattr(Window, "run", started)
        monkeypatch.setattr(replays, "VIDEO_SIZE", "320x180")

    async def go(
        self, script: Callable[[], Iterator[None]], first: GameSetup | None = None
    ) -> None:
        self.user.script = script()
        await self.app.run(self.app.local.play(first) if first is not None else None)

    async def go_online(
        self, script: Iterator[None], first: Coroutine[Any, Any, object] | None = None
    ) -> None:
        """Run a script with the event loop's clock, as games on a server do."""
        ui = self.app.ui
        ui.time_source = TimeSource(asyncio.get_running_loop().time, ui.time_source.sleep)
        self.user.timer.sleep = asyncio.sleep  # type: ignore[method-assign]
        self.user.script = script
        await asyncio.wait_for(self.app.run(first), 600)

    @property
    def labels(self) -> list[str]:
        """Labels of the open form's rows that take the focus."""
        assert self.form is not None
        return [row.label for row in self.form.rows if row.focusable]

    @property
    def remembered(self) -> Settings:
        """The settings that would survive a killed process."""
        return load_settings(self.folder / "window.json")[0]

    def choose(self, label: str) -> Iterator[None]:
        """Move down to a button of the open form and press Enter."""
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
    """Yield the arrow and E keys that play a task's proven plan."""
    world = World(load_task(setup.task, timing="benchmark"))
    state, me = world.initial, world.players[0]
    before = ""
    for line in load_certificate(world.task).plan or ():
        action = world.parse(state, me, line)
        station = goes_to(action)
        if not station and before not in ("move", action.name):
            yield from wait(round(GUARD_SECONDS * 60) + 5)
        before = action.name
        for key in [ARROWS[c] for c in way(state, me, station)] if station else [pygame.K_e]:
            post(key)
            yield from wait(2)
        state = state.step(action).state
