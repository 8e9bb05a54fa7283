"""Draw the pictures of docs/play.md: menus, games, and end screens.

python tools/picture_playing.py [--out FOLDER]
"""

from __future__ import annotations

import argparse
import asyncio
import dataclasses
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pygame

from robotouille import World, load_task
from robotouille.episode import Phase
from robotouille.episode.rules import Clock
from robotouille.planning.plan import read_plan
from robotouille.planning.policies.shift_policy import play_shift
from robotouille.protocol.messages import Create, EpisodeInfo, SeatInfo
from robotouille_client.bots.partners import prompt_partners
from robotouille_client.window.app.app import App, UserFiles
from robotouille_client.window.app.local_game import GameSetup
from robotouille_client.window.app.server_menus import LobbyMenu
from robotouille_client.window.app.settings import Settings
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.screen import Display, Screen
from robotouille_client.window.options import TimeSource
from robotouille_client.window.preferences import Preferences
from robotouille_client.window.view import (
    Bubble,
    LobbyRow,
    LobbyView,
    PauseView,
    SeatView,
    View,
)
from robotouille_server import ServerSettings, serve

IMAGES = Path(__file__).parents[1] / "docs" / "images"
SIZE = (1120, 630)
COURSE = "up e left left down e right up e left e e e e e down e right e left e"
"""Keys that make the sandwich of training/01."""
BEST = {"multi_agent/02_lettuce_tomato_burger@2": 61, "shifts/01_sandwich_bar@2": 314}
STARS = {
    "synchronous/01_cheese_sandwich": 3, "synchronous/02_lettuce_sandwich": 3,
    "synchronous/03_lettuce_tomato_sandwich": 2, "asynchronous/01_cheese_chicken_sandwich": 3,
    "multi_agent/01_lettuce_burger": 3, "multi_agent/02_lettuce_tomato_burger": 2,
    "shifts/01_sandwich_bar": 3, "shifts/02_burger_stand": 1,
}  # fmt: skip
"""Best results and stars of the player in the pictures."""
Script = Callable[[Display, Path], Iterator[str]]
"""Generator of keys that saves pictures of a display in a folder."""


class Playing:
    """Shell that is driven by a script of keys, with a simulated clock.

    `seconds` is the real time between two keys, which a server needs.
    """

    def __init__(self, script: Script, out: Path, seconds: float = 0.0) -> None:
        self.now = 0.0
        self._seconds = seconds
        folder = Path(tempfile.mkdtemp())
        self.display = Display(SIZE, headless=True)
        settings = Settings(
            preferences=Preferences(name="ada"), learned=True, task="multi_agent/01", seats=2,
            best=BEST, stars=STARS,
        )  # fmt: skip
        self.app = App(
            settings,
            self.display,
            storage=UserFiles(recordings=folder),
            make_partners=prompt_partners,
            time_source=TimeSource(lambda: self.now, self._sleep),
        )
        self._keys = script(self.display, out)

    async def ask(self, form: Form) -> object:
        """Show a form as the app does."""
        return await Screen(self.display, sleep=self._sleep).ask(form)

    async def _sleep(self, seconds: float) -> None:
        self.now += seconds
        await asyncio.sleep(self._seconds)
        key = next(self._keys, None)
        if key is None:
            pygame.event.post(pygame.Event(pygame.QUIT))
        elif key:
            for kind in (pygame.KEYDOWN, pygame.KEYUP):
                code = pygame.key.key_code(key)
                pygame.event.post(pygame.Event(kind, key=code, mod=0, unicode=""))


def pause(frames: int) -> Iterator[str]:
    """Let frames pass without a key."""
    yield from [""] * frames


def menus(display: Display, out: Path) -> Iterator[str]:
    """Draw the menu of local games."""
    yield from ("", "down", "return")
    yield from pause(12)
    display.save(out / "menu.png")


def levels(display: Display, out: Path) -> Iterator[str]:
    """Draw the map of levels."""
    yield from ("", "return")
    yield from pause(150)
    display.save(out / "levels.png")


def tasks(display: Display, out: Path) -> Iterator[str]:
    """Draw the list of tasks."""
    yield from ("", "down", "return", "", "down", "return")
    yield from pause(150)
    display.save(out / "tasks.png")


def game(display: Display, out: Path) -> Iterator[str]:
    """Draw a game with a partner and the list of actions."""
    yield from pause(30)
    yield "return"
    yield from pause(30)
    for key in ("right", "e"):
        yield key
        yield from pause(90)
    yield "tab"
    yield from pause(3)
    display.save(out / "hands.png")


def end(display: Display, out: Path) -> Iterator[str]:
    """Draw the end of a won game."""
    for key in COURSE.split():
        # The use key is guarded for a second after an action.
        yield from pause(70 if key == "e" else 2)
        yield key
    # The third star is stamped last.
    yield from pause(100)
    display.save(out / "end.png")


def settings(display: Display, out: Path) -> Iterator[str]:
    """Draw the settings."""
    yield from ("", "up", "up", "return", "", "")
    display.save(out / "settings.png")


def tutorial(display: Display, out: Path) -> Iterator[str]:
    """Draw the second lesson of the tutorial."""
    yield from pause(30)
    yield "up"
    yield from pause(60)
    display.save(out / "tutorial.png")


def lost(display: Display, out: Path) -> Iterator[str]:
    """Draw the end of a game that reached its step limit."""
    yield from pause(30)
    yield "return"
    yield from pause(300)
    display.save(out / "lost.png")


def lobby(display: Display, out: Path) -> Iterator[str]:
    """Draw the list of a server's kitchens."""
    yield from pause(3)
    display.save(out / "lobby.png")


def kitchens() -> Form:
    """Return a lobby with two example kitchens."""
    ada, ben = (SeatInfo(player=p, name=n) for p, n in (("robot1", "ada"), ("robot2", "ben")))
    free = SeatInfo(player="robot3")
    rows = [
        ("KQXZB-MHTWA", "multi_agent/01_lettuce_burger", Phase.WAITING, [ada, free]),
        ("RNYHV-KDQTA", "multi_agent/07_onion_potato_tomato_soup", Phase.RUNNING, [ada, ben]),
    ]
    episodes = [
        EpisodeInfo(
            episode=code, code=code, task=task, clock=Clock.REALTIME, phase=phase, step=0,
            max_steps=300, seats=seats,
        )
        for code, task, phase, seats in rows
    ]  # fmt: skip
    return LobbyMenu(episodes, Settings()).form


async def served(out: Path) -> None:
    """Draw the end of a game on a server."""
    settings = ServerSettings(port=0, recordings=Path(tempfile.mkdtemp()), countdown=0.0)
    async with serve(settings) as server:
        room = server.lobby.create(Create(task="training/01", clock=Clock.TURN))

        def script(display: Display, out: Path) -> Iterator[str]:
            yield from pause(30)
            for key in ("return", *COURSE.split()):
                yield from pause(70 if key == "e" else 0)
                yield key
                yield from pause(6)
            yield from pause(100)
            display.save(out / "end_server.png")

        playing = Playing(script, out, 0.01)
        await playing.app.run(playing.app.remote.join(room.code, url=server.url))


def moment(path: Path, rendering: str = "", task: str = "multi_agent/01@2", **seen: Any) -> None:
    """Draw a kitchen with two players; `seen` replaces parts of the view."""
    world = World(load_task(task, timing="people"))
    first, second = world.players
    seats = (SeatView(first, "ada", actions=4), SeatView(second, "ben", actions=3))
    view = View(
        world, world.initial, step=12, max_steps=300, clock="real time", seats=seats, me=first,
        step_seconds=0.2,
    )  # fmt: skip
    surface = pygame.Surface(SIZE)
    Painter(rendering).paint(surface, dataclasses.replace(view, **seen))
    pygame.image.save(surface, path)


Spoken = tuple[tuple[Bubble, str], ...]


def cooking(
    path: Path, task: str, steps: int, size: tuple[int, int] = SIZE, said: Spoken = ()
) -> None:
    """Draw a kitchen after some steps of its task's plan file.

    Args:
        said: Bubbles, each with its sentence in the chat, or nothing for an announcement.
    """
    loaded = load_task(task)
    world = World(loaded)
    state = before = world.initial
    plan = loaded.name.rpartition("/")[2] + task[task.rfind("@") :] * ("@" in task)
    text = (loaded.folder / f"{plan}.plan").read_text(encoding="utf-8")
    for joint in list(read_plan(text, world))[:steps]:
        before, state = state, state.step(list(joint)).state
    names = dict(zip(world.players, ("ada", "ben", "cleo", "dara"), strict=False))
    seats = tuple(SeatView(player, name, actions=steps // 2) for player, name in names.items())
    if not said and len(seats) > 1:
        said = ((Bubble(world.players[-1], "I take the bowls.", "chat"), "I take the bowls."),)
    view = View(
        world, state, before, steps, 100, "real time", 0.6, seats, world.players[0],
        tuple(bubble for bubble, _ in said),
        tuple((names[bubble.player], text) for bubble, text in said if text), step_seconds=0.2,
    )  # fmt: skip
    surface = pygame.Surface(size)
    Painter().paint(surface, view)
    pygame.image.save(surface, path)


def shift(path: Path, task: str, steps: int) -> None:
    """Draw a shift after some steps of a team of planners."""
    world = World(load_task(task, timing="people"))
    states = [world.initial]
    play_shift(world, watch=states.append)
    before, state = states[steps - 1 : steps + 1]
    names = dict(zip(world.players, ("ada", "ben", "cleo", "dara"), strict=False))
    seats = tuple(SeatView(player, name, actions=steps // 8) for player, name in names.items())
    view = View(
        world, state, before, steps, 600, "real time", 0.6, seats, world.players[0],
        step_seconds=0.2,
    )  # fmt: skip
    surface = pygame.Surface(SIZE)
    Painter().paint(surface, view)
    pygame.image.save(surface, path)


def moments(out: Path) -> None:
    """Draw events of a game and other renderings."""
    cooking(out / "kitchen.png", "multi_agent/10@3", 18)
    cooking(out / "signals.png", "multi_agent/07@3", 11, said=(
        (Bubble("robot1", "I need", "chat", ("stove1",), "stove1"), "I need the stove, please"),
        (Bubble("robot2", "You take", "chat", ("onion1",), "onion1"), "You take the onion, please"),
        (Bubble("robot3", "", "chat", ("board1", "onion1")), ""),
    ))  # fmt: skip
    cooking(out / "pancakes.png", "examples/pancakes", 16, (800, 450))
    rows = (LobbyRow("ada (you)", "here"), LobbyRow("ben", "ready"))
    lobby = LobbyView(rows, False, "KQXZB-MHTWA")
    moment(out / "ready.png", step=0, lobby=lobby, status="Are you ready?")
    moment(out / "countdown.png", step=0, starts_in=2.4, status="The game begins")
    away = SeatView("robot2", "ben", connected=False, actions=3)
    seats = (SeatView("robot1", "ada", actions=4), away)
    detail = "The game ends in 23 s unless ben comes back."
    lost = PauseView("ben lost the connection", detail, 22.4, 0.7)
    moment(out / "paused.png", seats=seats, pause=lost)
    moment(out / "offline.png", offline=7.0)
    moment(out / "refusal.png", bubbles=(Bubble("robot1", "The board is not free."),))
    moment(out / "blocked.png", blocked=(("robot2", "stove1", "robot1"),))
    shift(out / "shift.png", "shifts/03@3", 360)
    moment(out / "chalk.png", rendering="chalk")
    moment(out / "workshop.png", task="workshop/02")


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw all pictures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--out", type=Path, default=IMAGES, help="output folder instead of docs/images"
    )
    out = parser.parse_args(arguments).out
    out.mkdir(parents=True, exist_ok=True)
    moments(out)
    asyncio.run(Playing(menus, out).app.run())
    asyncio.run(Playing(levels, out).app.run())
    asyncio.run(Playing(tasks, out).app.run())
    asyncio.run(Playing(settings, out).app.run())
    playing = Playing(lobby, out)
    asyncio.run(playing.app.run(playing.ask(kitchens())))
    playing = Playing(tutorial, out)
    asyncio.run(playing.app.run(playing.app.local.learn()))
    playing = Playing(game, out)
    asyncio.run(playing.app.run(playing.app.local.play(GameSetup("multi_agent/01", seats=2))))
    playing = Playing(end, out)
    turns = GameSetup("training/01", clock=Clock.TURN, max_steps=200)
    asyncio.run(playing.app.run(playing.app.local.play(turns)))
    playing = Playing(lost, out)
    asyncio.run(served(out))
    short = GameSetup("training/01", max_steps=10, countdown=0.0)
    asyncio.run(playing.app.run(playing.app.local.play(short)))


if __name__ == "__main__":
    main()
