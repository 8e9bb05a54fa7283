"""Waiting for the start of a game."""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import pygame
import pytest
from tests.support.samples import quick_sample
from tests.support.servers import serving
from tests.support.virtual_time import opening
from tests.support.window_play import Script, Timer, headless_window, world_of

from robotouille_client import Game, connect
from robotouille_client.window.drawing.kitchen.spots import occupied
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.sources.remote import RemoteSource
from robotouille_client.window.view import LobbyRow, LobbyView, SeatView, View
from robotouille_client.window.window import Window


@dataclass
class Table:
    """Ada at a window, and Bob, who is ready."""

    window: Window
    source: RemoteSource
    one: Game
    two: Game

    async def post(self, *events: pygame.Event) -> None:
        """Send Ada's input, and update both games."""
        for event in events:
            pygame.event.post(event)
        self.window.frame(self.source)
        await asyncio.sleep(0.1)
        self.window.frame(self.source)

    async def press(self, key: int) -> None:
        await self.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))

    @property
    def lobby(self) -> LobbyView | None:
        return self.source.view().lobby


@asynccontextmanager
async def table(folder: Path, **options: object) -> AsyncIterator[Table]:
    async with (
        serving(folder, countdown=3.0) as server,
        connect(server.url, name="ada", kind="human") as ada,
        connect(server.url, name="bob", kind="bot") as bob,
    ):
        created = await ada.create("multi_agent/02", clock="realtime", **options)
        one = await ada.join(created.code, ready=False)
        loop = asyncio.get_running_loop()
        source = RemoteSource(one, loop.time, ada.connected.is_set)
        window = headless_window((640, 400), clock=loop.time)
        window.frame(source)
        free = (LobbyRow("ada (you)", "here"), LobbyRow("robot2", "free"))
        assert source.view().lobby == LobbyView(free, False, one.code)
        two = await bob.join(created.code)
        await asyncio.sleep(0.1)
        yield Table(window, source, one, two)


@pytest.mark.parametrize("key", quick_sample([pygame.K_RETURN, pygame.K_e, pygame.K_SPACE]))
@opening(table)
async def test_enter_toggles_ready(at: Table, key: int) -> None:
    await asyncio.sleep(30)
    rows = (LobbyRow("ada (you)", "here"), LobbyRow("bob", "ready"))
    assert at.lobby == LobbyView(rows, False, at.one.code)
    assert at.source.view().status == "Waiting for you to get ready"
    await at.press(key)
    assert at.source.view().status == "Starting in 3"
    assert at.lobby.ready
    await at.press(pygame.K_RETURN)
    assert at.source.view().starts_in is None
    assert at.lobby.ready is False
    await at.press(key)
    if key != pygame.K_RETURN:
        await at.press(key)
        await at.press(key)
        assert at.source.view().starts_in is not None, "the use key is meant for the game"
    await asyncio.sleep(3.1)
    view = at.source.view()
    assert (view.lobby, view.phase, at.one.running) == (None, view.phase, True)


@opening(table)
async def test_clicking_gets_ready_once(at: Table) -> None:
    click = pygame.Event(pygame.MOUSEBUTTONDOWN, button=1, pos=(200, 200))
    await at.post(click)
    await at.post(click)
    assert at.lobby.ready


@opening(table)
async def test_a_gamepad_gets_ready(at: Table) -> None:
    button = pygame.CONTROLLER_BUTTON_A
    await at.post(
        pygame.Event(pygame.CONTROLLERBUTTONDOWN, button=button, instance_id=0),
        pygame.Event(pygame.CONTROLLERBUTTONUP, button=button, instance_id=0),
    )
    assert at.lobby.ready


@opening(table)
async def test_enter_opens_the_chat_after_the_start(at: Table) -> None:
    await at.press(pygame.K_RETURN)
    await asyncio.sleep(3.1)
    at.window.frame(at.source)
    await at.press(pygame.K_RETURN)
    assert at.window.overlay(at.source.view()).typing is not None
    assert at.one.running


@opening(table)
async def test_chat_before_the_start(at: Table) -> None:
    await at.press(pygame.K_t)
    await at.post(pygame.Event(pygame.TEXTINPUT, text="hello"))
    await at.press(pygame.K_RETURN)
    assert ("ada", "hello") in at.source.view().chat
    assert at.lobby.ready is False


@opening(table)
async def test_the_others_see_who_is_ready(at: Table) -> None:
    loop = asyncio.get_running_loop()
    other = RemoteSource(at.two, loop.time)
    other.view()
    await at.press(pygame.K_RETURN)
    assert ("·", "ada is ready") in other.view().chat


@pytest.mark.parametrize(
    "size", quick_sample((size,) for size in [(320, 240), (640, 480), (1280, 720), (3840, 2160)])
)
@pytest.mark.parametrize("ready", [False, True, None])
def test_the_card_fits_beside_the_panel(size: tuple[int, int], ready: bool | None) -> None:
    world = world_of("multi_agent/10@4")
    rows = (
        LobbyRow("Ada (you)", "here"),
        LobbyRow("W" * 40, "ready"),
        LobbyRow("Carol", "away"),
        LobbyRow("robot4", "free"),
    )
    view = View(world, world.initial, me="robot1", lobby=LobbyView(rows, ready, "KQXZB-WMFTA"))
    painter, surface = Painter(), pygame.Surface(size)
    painter.paint(surface, view)
    place = painter.layout(size, world)
    card = painter._interruptions.draw(surface, place, view)[0]
    assert surface.get_rect().contains(card)
    assert not card.colliderect(place.panel)


@pytest.mark.parametrize(
    "size", quick_sample((size,) for size in [(640, 360), (800, 600), (1280, 720), (3840, 2160)])
)
@pytest.mark.parametrize(
    "task", quick_sample(["multi_agent/10@4", "multi_agent/07", "training/03"])
)
@pytest.mark.parametrize("ready", [False, True, None])
def test_the_card_covers_no_player_and_no_object(
    size: tuple[int, int], task: str, ready: bool | None
) -> None:
    world = world_of(task)
    rows = (LobbyRow("Ada", "here"), LobbyRow("Ben", "ready"))
    seats = tuple(SeatView(player, player) for player in world.players)
    for me in world.players if ready is not None else (None,):
        lobby = LobbyView(rows, ready, "KQXZB-WMFTA")
        view = View(world, world.initial, seats=seats, me=me, lobby=lobby)
        painter, surface = Painter(), pygame.Surface(size)
        painter.paint(surface, view)
        place, stage = painter.layout(size, world), painter.stage(world.initial)
        ground = painter._ground(place, view, painter._frame(view, place))
        card = painter._interruptions.draw(surface, place, view, ground)[0]
        kept = occupied(place, stage, painter._poses(view)) if size[0] > 640 else ground.players
        assert card.collidelist(kept) < 0
        assert surface.get_rect().contains(card)
        assert not card.colliderect(place.panel) or painter._panel.free.contains(card)


def test_the_context_key_gets_ready() -> None:
    class Waiting(Script):
        ready = False

        def view(self) -> View:
            rows = (LobbyRow("Ada (you)", "ready" if self.ready else "here"),)
            return dataclasses.replace(super().view(), lobby=LobbyView(rows, self.ready))

        def be_ready(self, ready: bool) -> None:
            self.ready = ready

    source = Waiting(world_of("training/01"))
    window = headless_window((800, 600), clock=Timer())
    for ready, words in ((False, "I'm ready!"), (True, "not ready after all")):
        window.frame(source)
        assert source.ready is ready
        assert window.overlay(source.view()).hints == (("E", words),)
        pygame.event.post(pygame.Event(pygame.KEYDOWN, key=pygame.K_e, mod=0, unicode="e"))
        window.frame(source)
        pygame.event.post(pygame.Event(pygame.KEYUP, key=pygame.K_e, mod=0))
        window.frame(source)
