"""Spectators: the live game and its earlier steps. Real server, virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pygame
import pytest
from tests.support.servers import crash, serving
from tests.support.virtual_time import virtual
from tests.support.window_play import headless_window

from robotouille.episode.tallies import Activity
from robotouille_client import connect
from robotouille_client.window.replay.histories.history import EntryKind
from robotouille_client.window.replay.viewer import SpectatorSource
from robotouille_client.window.window import Window
from robotouille_server import Server


def press(window: Window, source: SpectatorSource, key: int) -> None:
    pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))
    pygame.event.post(pygame.Event(pygame.KEYUP, key=key, mod=0))
    window.frame(source)


@pytest.mark.slow
@virtual
async def test_going_back_and_returning_to_live(tmp_path: Path) -> None:
    async with (
        serving(tmp_path) as server,
        connect(server.url, name="ada", kind="human") as ada,
        connect(server.url, name="bob", kind="human") as bob,
        connect(server.url, name="eve", kind="human") as eve,
    ):
        rules = {"clock": "realtime", "step_rate": 4.0, "max_steps": 60}
        created = await ada.create("multi_agent/01", **rules)
        one, _ = await ada.join(created.code), await bob.join(created.code)
        await asyncio.sleep(1.0)
        game = await eve.join(created.code, role="spectator")
        loop = asyncio.get_running_loop()
        source = SpectatorSource(game, loop.time, eve.connected.is_set)
        window = headless_window((1280, 720), strip=source.strip, clock=loop.time)
        window.frame(source)
        began = source.history.first
        assert began >= 3
        states = {}
        for number in range(12):
            if number == 4:
                one.say("hello")
            if one.actions:
                one.submit(one.actions[number % 2])
            await asyncio.sleep(0.25)
            window.frame(source)
            states[game.step] = game.state
        assert source.playhead.follows
        assert source.view().step == game.step == source.history.length
        press(window, source, pygame.K_HOME)
        assert source.view().step == began
        press(window, source, pygame.K_PERIOD)
        said = source.view()
        assert [bubble.text for bubble in said.bubbles] == ["hello"]
        assert said.state == states[said.step]
        await asyncio.sleep(1.0)
        window.frame(source)
        assert source.view().step == said.step < source.history.length
        press(window, source, pygame.K_END)
        assert source.playhead.follows
        assert source.view().step == game.step
        history = source.history
        did = [history.activity("robot1", step) for step in range(began + 1, game.step + 1)]
        assert Activity.ACTED in did
        assert history.activity("robot1", began) is None
        press(window, source, pygame.K_l)
        press(window, source, pygame.K_h)
        await asyncio.sleep(30.0)
        window.frame(source)
        assert source.view().outcome
        assert history.marks[-1].kind is EntryKind.ENDED
        press(window, source, pygame.K_LEFT)
        assert not source.view().outcome


@asynccontextmanager
async def watching(
    server: Server, frames: int, max_steps: int
) -> AsyncIterator[tuple[SpectatorSource, Window]]:
    """Watch some frames of an idle game at four steps a second."""
    async with (
        connect(server.url, name="ada", kind="human") as ada,
        connect(server.url, name="eve", kind="human") as eve,
    ):
        rules = {"clock": "realtime", "step_rate": 4.0, "max_steps": max_steps}
        created = await ada.create("synchronous/01", **rules)
        await ada.join(created.code)
        game = await eve.join(created.code, role="spectator")
        loop = asyncio.get_running_loop()
        source = SpectatorSource(game, loop.time, eve.connected.is_set)
        window = headless_window((1280, 720), strip=source.strip, clock=loop.time)
        for _ in range(frames):
            await asyncio.sleep(0.25)
            window.frame(source)
        yield source, window


@virtual
async def test_the_game_ends_while_looking_back(tmp_path: Path) -> None:
    async with (
        serving(tmp_path) as server,
        watching(server, frames=12, max_steps=30) as (source, window),
    ):
        press(window, source, pygame.K_LEFT)
        at = source.view().step
        assert "End to go back to live" in source.view().status
        await asyncio.sleep(20.0)
        window.frame(source)
        view = source.view()
        assert source.finished
        assert (view.step, view.outcome) == (at, "")
        assert "ended" in view.status
        press(window, source, pygame.K_END)
        assert source.view().outcome
        press(window, source, pygame.K_HOME)
        assert source.view().step == source.history.first
        press(window, source, pygame.K_SPACE)
        await asyncio.sleep(1.0)
        assert source.history.first < source.view().step < source.history.length


@virtual
async def test_the_server_vanishes_while_looking_back(tmp_path: Path) -> None:
    async with (
        serving(tmp_path) as server,
        watching(server, frames=20, max_steps=300) as (source, window),
    ):
        seen = source.history.length
        press(window, source, pygame.K_HOME)
        await crash(server)
        await asyncio.sleep(6.0)
        window.frame(source)
        assert source.view().offline is not None
        assert source.history.length - seen <= 1, "at most the step in progress"
        press(window, source, pygame.K_RIGHT)
        assert source.view().step == source.history.first + 1
        press(window, source, pygame.K_END)
        assert source.playhead.follows
