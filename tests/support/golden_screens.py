"""Golden pictures of the menu screens.

`python -m tests.support.golden_screens` draws them again, into `tests/window/golden_screens`.
Review the changes before you commit them.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import pygame

from robotouille import GroundAction
from robotouille.certification.certificate import load_certificate
from robotouille.episode import Clock, Episode, Phase, Rules
from robotouille.protocol.messages import EpisodeInfo, SeatInfo
from robotouille.replay.compression import compress
from robotouille_client.window.app.level_map import LevelMap
from robotouille_client.window.app.main_menu import KeysMenu, SettingsMenu, main_menu, quit_form
from robotouille_client.window.app.play_menu import PlayMenu, TaskPicker
from robotouille_client.window.app.replays_menu import ReplaysMenu
from robotouille_client.window.app.server_menus import JoinMenu, LobbyMenu, OpenMenu
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.screen import Display, Screen
from robotouille_client.window.input.commands import KeyMap
from robotouille_client.window.preferences import Preferences
from tests.support.games import play_through, record
from tests.support.golden_pictures import redraw

__all__ = ["GOLDEN", "PICTURES", "SCREENS", "proven_game"]

GOLDEN = Path(__file__).parents[1] / "window/golden_screens"
SIZE, SMALL = (1120, 630), (320, 240)
BURGER = "multi_agent/01_lettuce_burger"
NOW = datetime(2026, 11, 22, 14, 5, tzinfo=UTC)
MAX_LATE = 100
"""Largest number of extra draws while pictures load."""


def proven_game() -> bytes:
    """Return the recording of a task's shortest plan."""
    plan = iter(load_certificate("synchronous/01").plan or ())

    def choose(episode: Episode, player: str) -> GroundAction:
        return episode.world.parse(episode.state, player, next(plan))

    rules = Rules(clock=Clock.TURN, max_steps=50)
    return compress(record(*play_through("synchronous/01", rules, choose)))


STARS = {
    "synchronous/01_cheese_sandwich@1": 3,
    "synchronous/02_lettuce_sandwich@1": 1,
    "multi_agent/01_lettuce_burger@2": 2,
}


def _settings() -> Settings:
    best = {f"{BURGER}@2": 40}
    return Settings(
        preferences=Preferences(name="ada"), learned=True, task=BURGER, seats=2, best=best,
        code="KQXZB-MHTWA", stars=STARS,
    )  # fmt: skip


def _replays() -> Form:
    folder = Path(tempfile.mkdtemp())
    whole = proven_game()
    for number, content in enumerate((whole, whole[: len(whole) // 2], b"Hello")):
        path = folder / f"{number}.rbt"
        path.write_bytes(content)
        at = NOW.timestamp() - number * 50_000
        os.utime(path, (at, at))
    return ReplaysMenu(sorted(folder.iterdir()), now=NOW).form


def _kitchens() -> Form:
    seats = [SeatInfo(player="robot1", name="ada"), SeatInfo(player="robot2")]
    info = EpisodeInfo(
        episode="KQXZB-MHTWA", code="KQXZB-MHTWA", task=BURGER, clock=Clock.REALTIME,
        phase=Phase.WAITING, step=0, max_steps=300, seats=seats,
    )  # fmt: skip
    return LobbyMenu([info], _settings()).form


SCREENS: dict[str, Callable[[], Form]] = {
    "menu": lambda: main_menu(_settings()),
    "leaving": quit_form,
    "levels": lambda: LevelMap(_settings()),
    "play": lambda: PlayMenu(_settings()).form,
    "tasks": lambda: TaskPicker(_settings(), BURGER).form,
    "join": lambda: JoinMenu(_settings(), "It cannot be reached. " * 4).form,
    "open": lambda: OpenMenu(_settings()).form,
    "lobby": _kitchens,
    "replays": _replays,
    "settings": lambda: SettingsMenu(_settings()).form,
    "keys": lambda: KeysMenu(KeyMap()).form,
}


def screen(name: str, size: tuple[int, int], *, strong: bool = False) -> pygame.Surface:
    """Draw a menu screen in a window of this size, after everything has loaded."""
    display, form = Display(size, headless=True), SCREENS[name]()
    display.open()
    try:
        shown = Screen(display, preferences=Preferences(strong_contrast=strong))
        for _ in range(MAX_LATE):
            shown.draw(form)
            if not form.idle():
                break
        shown.draw(form)
        assert display.surface is not None
        return display.surface.copy()
    finally:
        display.close()


PICTURES: dict[str, Callable[[], pygame.Surface]] = {
    **{name: lambda name=name: screen(name, SIZE) for name in SCREENS},  # type: ignore[misc]
    "settings-strong": lambda: screen("settings", SIZE, strong=True),
    **{
        f"{name}-small": lambda name=name: screen(name, SMALL)  # type: ignore[misc]
        for name in ("menu", "levels", "play", "tasks", "settings", "replays")
    },
}


if __name__ == "__main__":
    redraw(GOLDEN, PICTURES)
