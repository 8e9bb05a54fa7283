"""Before the beginning: who is here, who is ready, and how one says so in a window."""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import pygame
import pytest
from tests.support.servers import serving
from tests.support.virtual_time import run

from robotouille.protocol.messages import SeatInfo
from robotouille_client import Game, connect
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.sources.remote import RemoteSource
from robotouille_client.window.sources.texts import comings_and_goings, waiting_words
from robotouille_client.window.view import LobbyRow, LobbyView
from robotouille_client.window.window import Window


@dataclass
class Table:
    """Ada at a window, and Bob, who is ready."""

    window: Window
    source: RemoteSource
    one: Game
    two: Game

    async def post(self, *events: pygame.Event) -> None:
        """What Ada does, and what comes of it."""
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
        window = Window((640, 400), headless=True, clock=loop.time)
        try:
            window.frame(source)
            free = (LobbyRow("ada (you)", "here"), LobbyRow("robot2", "free"))
            assert source.view().lobby == LobbyView(free, False, one.code)
            two = await bob.join(created.code)
            await asyncio.sleep(0.1)
            yield Table(window, source, one, two)
        finally:
            window.close()


@pytest.mark.parametrize("key", [pygame.K_RETURN, pygame.K_e, pygame.K_SPACE])
def test_a_key_says_it_and_takes_it_back(tmp_path: Path, key: int) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            await asyncio.sleep(30)
            rows = (LobbyRow("ada (you)", "here"), LobbyRow("bob", "ready"))
            assert at.lobby == LobbyView(rows, False, at.one.code)
            assert at.source.view().status == "Waiting until you are ready"
            await at.press(key)
            assert at.source.view().status == "Starts in 3"
            assert at.lobby is not None
            assert at.lobby.ready
            await at.press(key)
            assert at.source.view().starts_in is None
            assert at.lobby.ready is False
            await at.press(key)
            await asyncio.sleep(3.1)
            view = at.source.view()
            assert (view.lobby, view.phase, at.one.running) == (None, view.phase, True)

    run(main())


def test_a_click_says_it_and_a_second_one_does_no_harm(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            click = pygame.Event(pygame.MOUSEBUTTONDOWN, button=1, pos=(200, 200))
            await at.post(click)
            await at.post(click)
            assert at.lobby is not None
            assert at.lobby.ready

    run(main())


def test_a_gamepad_says_it(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            button = pygame.CONTROLLER_BUTTON_A
            await at.post(
                pygame.Event(pygame.CONTROLLERBUTTONDOWN, button=button, instance_id=0),
                pygame.Event(pygame.CONTROLLERBUTTONUP, button=button, instance_id=0),
            )
            assert at.lobby is not None
            assert at.lobby.ready

    run(main())


def test_enter_is_for_the_chat_once_the_game_has_begun(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            await at.press(pygame.K_RETURN)
            await asyncio.sleep(3.1)
            at.window.frame(at.source)
            await at.press(pygame.K_RETURN)
            assert at.window.overlay(at.source.view()).typing is not None
            assert at.one.running

    run(main())


def test_one_can_talk_before_the_beginning(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            await at.press(pygame.K_t)
            await at.post(pygame.Event(pygame.TEXTINPUT, text="hello"))
            await at.press(pygame.K_RETURN)
            assert ("ada", "hello") in at.source.view().chat
            assert at.lobby is not None
            assert at.lobby.ready is False

    run(main())


def test_the_others_are_told(tmp_path: Path) -> None:
    async def main() -> None:
        async with table(tmp_path) as at:
            loop = asyncio.get_running_loop()
            other = RemoteSource(at.two, loop.time)
            other.view()
            await at.press(pygame.K_RETURN)
            assert ("·", "ada is ready") in other.view().chat

    run(main())


class TestWords:
    def seats(self, *seats: dict[str, object]) -> list[SeatInfo]:
        given = [{"player": f"robot{i}", **seat} for i, seat in enumerate(seats, 1)]
        return [SeatInfo(**seat) for seat in given]  # type: ignore[arg-type]

    def test_what_the_beginning_waits_for(self) -> None:
        ada = {"name": "ada", "present": True, "ready": False}
        bob = {"name": "bob", "present": True, "ready": False}
        eve = {"name": "eve", "present": True}
        assert waiting_words(self.seats(ada, bob), None, "robot1") == "Waiting until you are ready"
        words = waiting_words(self.seats(ada, bob, eve), None, "robot3")
        assert words == "Waiting until ada and bob are ready"
        assert waiting_words(self.seats(ada, eve), None, "robot2") == "Waiting until ada is ready"
        assert waiting_words(self.seats(ada, {}), None, "robot2") == "Waiting for 1 more player"

    def test_news_of_it(self) -> None:
        before = self.seats({"name": "ada", "present": True, "ready": False})
        after = self.seats({"name": "ada", "present": True})
        assert comings_and_goings(before, after, None) == ["ada is ready"]
        assert comings_and_goings(after, before, None) == ["ada is not ready any more"]
        assert comings_and_goings(before, after, "robot1") == []


@pytest.mark.parametrize("size", [(320, 240), (640, 480), (1280, 720), (3840, 2160)])
@pytest.mark.parametrize("ready", [False, True, None])
def test_the_card_is_inside_and_covers_no_panel(size: tuple[int, int], ready: bool | None) -> None:
    from robotouille.domain.loading import load_task
    from robotouille.world.world import shared_world
    from robotouille_client.window.view import View

    world = shared_world(load_task("multi_agent/10@4"))
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


@pytest.mark.parametrize("size", [(640, 360), (1280, 720), (1920, 1080)])
@pytest.mark.parametrize("task", ["multi_agent/01", "multi_agent/10@4", "training/03"])
def test_the_card_does_not_hide_ones_own_player(size: tuple[int, int], task: str) -> None:
    from robotouille import World
    from robotouille.world.scene import scene
    from robotouille_client.window.drawing.lobby_card import Ground
    from robotouille_client.window.view import View

    world = World(task)
    rows = tuple(LobbyRow(player, "here") for player in world.players)
    for me in world.players:
        view = View(world, world.initial, me=me, lobby=LobbyView(rows, False, "KQXZB-WMFTA"))
        painter, surface = Painter(), pygame.Surface(size)
        painter.paint(surface, view)
        place, tile = painter.layout(size, world), scene(world.initial)[me].tile
        assert tile is not None
        cell = place.cell(tile)
        card = painter._interruptions.draw(surface, place, view, Ground(cell))[0]
        assert not card.colliderect(cell.inflate(-cell.width // 2, -cell.height // 2))


@pytest.mark.parametrize("size", [(640, 360), (800, 600), (1280, 720), (1920, 1080)])
@pytest.mark.parametrize("task", ["multi_agent/01", "multi_agent/07", "training/03"])
@pytest.mark.parametrize("ready", [False, True, None])
def test_the_card_covers_no_player_and_nothing_that_lies_somewhere(
    size: tuple[int, int], task: str, ready: bool | None
) -> None:
    from robotouille import World
    from robotouille_client.window.drawing.kitchen.spots import occupied
    from robotouille_client.window.view import SeatView, View

    world = World(task)
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


def test_the_context_key_says_that_one_is_ready() -> None:
    from tests.support.window_play import Script, Timer

    from robotouille import World
    from robotouille_client.window.view import View
    from robotouille_client.window.window import Window

    class Waiting(Script):
        ready = False

        def view(self) -> View:
            rows = (LobbyRow("Ada (you)", "ready" if self.ready else "here"),)
            return dataclasses.replace(super().view(), lobby=LobbyView(rows, self.ready))

        def be_ready(self, ready: bool) -> None:
            self.ready = ready

    source = Waiting(World("training/01"))
    window = Window((800, 600), headless=True, clock=Timer())
    try:
        for ready, words in ((False, "I am ready"), (True, "not ready yet")):
            window.frame(source)
            assert source.ready is ready
            assert window.overlay(source.view()).hints == (("E", words),)
            pygame.event.post(pygame.Event(pygame.KEYDOWN, key=pygame.K_e, mod=0, unicode="e"))
            window.frame(source)
            pygame.event.post(pygame.Event(pygame.KEYUP, key=pygame.K_e, mod=0))
            window.frame(source)
    finally:
        window.close()
