"""Draw the pictures of docs/playing.md: a menu, a game, an end card, as somebody plays them.

python tools/picture_playing.py
"""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pygame

from robotouille.episode.rules import Clock
from robotouille_client.bots.partners import prompt_partners
from robotouille_client.window.forms.display import Display
from robotouille_client.window.shell.games.local_game import Plan
from robotouille_client.window.shell.settings import Settings
from robotouille_client.window.shell.shell import Shell

IMAGES = Path(__file__).parents[1] / "docs" / "images"
SIZE = (1120, 630)
COURSE = "up e left left down e right up e left e e e e e down e right e left e"
"""The keys that make the sandwich of training/01."""


class Playing:
    """A shell whose time stands still, but for what a script of keys lets pass."""

    def __init__(self, script: Callable[[Display], Iterator[str]]) -> None:
        self.now = 0.0
        folder = Path(tempfile.mkdtemp())
        self.display = Display(SIZE, headless=True)
        settings = Settings(name="ada", learned=True, task="multi_agent/01", seats=2)
        self.shell = Shell(
            settings,
            self.display,
            recordings=folder,
            make_partners=prompt_partners,
            clock=lambda: self.now,
            sleep=self._sleep,
        )
        self._keys = script(self.display)

    async def _sleep(self, seconds: float) -> None:
        self.now += seconds
        await asyncio.sleep(0)
        key = next(self._keys, None)
        if key is None:
            pygame.event.post(pygame.Event(pygame.QUIT))
        elif key:
            for kind in (pygame.KEYDOWN, pygame.KEYUP):
                code = pygame.key.key_code(key)
                pygame.event.post(pygame.Event(kind, key=code, mod=0, unicode=""))


def pause(frames: int) -> Iterator[str]:
    """Let time pass."""
    yield from [""] * frames


def menus(display: Display) -> Iterator[str]:
    """The menu of games that are played here."""
    yield from ("", "return", "", "", "")
    display.save(IMAGES / "menu.png")


def game(display: Display) -> Iterator[str]:
    """A game with a partner and the list of actions."""
    yield from pause(30)
    for key in ("right", "e"):
        yield key
        yield from pause(90)
    yield "tab"
    yield from pause(3)
    display.save(IMAGES / "hands.png")


def end(display: Display) -> Iterator[str]:
    """The end of a game that was won."""
    for key in COURSE.split():
        yield key
        yield from pause(2)
    yield from pause(60)
    display.save(IMAGES / "end.png")


def main() -> None:
    """Draw all of them."""
    asyncio.run(Playing(menus).shell.run())
    playing = Playing(game)
    asyncio.run(playing.shell.run(playing.shell.play(Plan("multi_agent/01", seats=2))))
    playing = Playing(end)
    turns = Plan("training/01", clock=Clock.TURN, max_steps=200)
    asyncio.run(playing.shell.run(playing.shell.play(turns)))


if __name__ == "__main__":
    main()
