"""The help: what it says, and what stands still meanwhile."""

from __future__ import annotations

import pygame
import pytest
from tests.support.window_play import Script, Timer

from robotouille import World
from robotouille.episode.rules import Clock
from robotouille_client.window.pictures.theme import ACCENT
from robotouille_client.window.shell.game_cards import GameCards
from robotouille_client.window.shell.games.local_game import GameSetup, LocalGame
from robotouille_client.window.sources.local import LocalSource
from robotouille_client.window.window import Window

SETUP = GameSetup("training/01", clock=Clock.REALTIME, rate=10.0, countdown=0.0)


def press(window: Window, source: LocalSource | Script, key: int) -> None:
    pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))
    window.frame(source)
    pygame.event.post(pygame.Event(pygame.KEYUP, key=key, mod=0))
    window.frame(source)


@pytest.mark.parametrize("close", [pygame.K_h, pygame.K_ESCAPE])
def test_a_game_of_ones_own_waits_while_one_reads(close: int) -> None:
    timer = Timer()
    game = LocalGame(SETUP, "Ada", timer, None)
    source = game.source
    cards = GameCards(lambda: source.outcome, tuple, source.stand_still)
    window = Window((800, 600), headless=True, clock=timer, cards=cards)
    try:
        window.frame(source)
        press(window, source, pygame.K_h)
        step = source.view().step
        timer.now += 9.0
        assert (source.view().step, source.view().frozen) == (step, True)
        press(window, source, close)
        timer.now += 1.0
        assert not source.view().frozen
        assert source.view().step > step
        press(window, source, pygame.K_h)
        press(window, source, pygame.K_h)
        assert not source.view().frozen
        press(window, source, pygame.K_ESCAPE)
        assert source.view().frozen
    finally:
        window.close()
        game.finish(over=False)


@pytest.mark.parametrize("task", ["multi_agent/07", "asynchronous/10", "training/01"])
def test_the_help_speaks_as_people_do(task: str) -> None:
    source = Script(World(task))
    window = Window((800, 600), headless=True, clock=Timer())
    try:
        window.frame(source)
        press(window, source, pygame.K_h)
        rows = window.overlay(source.view()).help
    finally:
        window.close()
    said = " ".join(words for _, words in rows)
    assert "Esc" in dict(rows)
    for schema in source.world.schemas:
        name = schema.name.replace("-", " ")
        assert " " not in name or f"{name}," not in said, name


@pytest.mark.parametrize("size", [(320, 240), (640, 360), (1280, 720)])
def test_all_of_the_help_is_inside_the_window(size: tuple[int, int]) -> None:
    source = Script(World("asynchronous/06"))
    window = Window(size, headless=True, clock=Timer())
    try:
        window.frame(source)
        press(window, source, pygame.K_h)
        picture = pygame.display.get_surface()
        assert picture is not None
        middle = range(size[0] // 3, 2 * size[0] // 3)
        frame = [y for y in range(size[1]) if all(picture.get_at((x, y)) == ACCENT for x in middle)]
        assert frame[-1] - frame[0] > size[1] // 3  # Its upper and its lower edge.
    finally:
        window.close()
