"""What the window takes of a core while its owner does nothing, screen by screen.

python -m benchmarks.idle [--screen]

Processor time of this process for each second of the wall clock, without a screen unless one is
asked for. Needs the extra `window`.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import tempfile
import time
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.support.games import recorded_game
from tests.support.server_process import server_process

from robotouille import GroundAction, State, World
from robotouille.episode import Clock, Episode, Rules
from robotouille_client.bots.partners import PromptPartners
from robotouille_client.client import connect

if TYPE_CHECKING:
    from robotouille_client.window.forms.display import Display
    from robotouille_client.window.sources.local import LocalSource
    from robotouille_client.window.view import Source

SIZE, SECONDS, SETTLING = (1280, 720), 4.0, 1.0
AIM = 5.0

Show = Callable[["Display"], Coroutine[Any, Any, object]]


@dataclass(frozen=True, slots=True)
class Resting:
    """Decides to do nothing."""

    player: str

    def observe(self, did: object) -> None:
        """Nothing comes of it."""

    def act(self, state: State) -> GroundAction | None:
        return None


def resting_game(task: str, steps: int = 1000, now: Callable[[], float] = time.monotonic) -> Any:
    """A game in this process, at 5 steps a second, in which nobody does anything."""
    from robotouille_client.window.sources.local import LocalSource

    world = World(task)
    me, *others = world.players
    rules = Rules(clock=Clock.REALTIME, step_rate=5.0, max_steps=steps)
    partners = PromptPartners({player: Resting(player) for player in others})
    bots = {player: player.title() for player in others}
    return LocalSource(Episode(world, rules, now()), me, bots, partners, now)


async def in_window(source: Source, display: Display, **options: Any) -> None:
    from robotouille_client.window.window import Window

    await Window(display=display, **options).run(source, linger=None)


async def playing(display: Display) -> None:
    """A game for one."""
    await in_window(resting_game("asynchronous/09"), display)


async def team(display: Display) -> None:
    """A game for four."""
    await in_window(resting_game("multi_agent/10@4"), display)


async def over(display: Display) -> None:
    """The card of a game that was lost."""
    from robotouille_client.window.shell.game_cards import GameCards

    source: LocalSource = resting_game("synchronous/01", 1)
    cards = GameCards(lambda: source.outcome, lambda: [("Menu", "menu")])
    await in_window(source, display, cards=cards)


async def menu(display: Display) -> None:
    """The first screen."""
    from robotouille_client.window.forms.screen import Screen
    from robotouille_client.window.shell.screens.main_menu import menu as main_menu
    from robotouille_client.window.shell.settings import Settings

    await Screen(display).ask(main_menu(Settings(), ""))


async def paused(display: Display) -> None:
    """A recording that stands still."""
    from robotouille.replay.recording import read_recording
    from robotouille_client.window.replay.viewer import Viewer
    from robotouille_client.window.window import Window

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "game.rbt"
        path.write_bytes(recorded_game("multi_agent/07@4"))
        viewer = Viewer(
            [(path, read_recording(path))], make_window=partial(Window, display=display)
        )
        viewer.playhead.seek(20, playing=False)
        await viewer.window.run(viewer, linger=None)


async def waiting(display: Display) -> None:
    """A kitchen on a server that waits for the second player."""
    from robotouille_client.window.sources.remote import RemoteSource

    with (
        tempfile.TemporaryDirectory() as folder,
        server_process(Path(folder), "--mode", "realtime") as server,
    ):
        async with connect(server.url, name="ada", kind="human") as client:
            made = await client.create("multi_agent/01")
            game = await client.join(made.code)
            source = RemoteSource(game, asyncio.get_running_loop().time, client.connected.is_set)
            await in_window(source, display)


SCREENS: dict[str, Show] = {
    "a game for one": playing,
    "a game for four": team,
    "the card at its end": over,
    "the menu": menu,
    "a paused replay": paused,
    "a kitchen that waits": waiting,
}


async def share(show: Show, display: Display, seconds: float) -> float:
    """The percentage of a core that a screen takes."""
    running = asyncio.create_task(show(display))
    for _ in range(1000):
        await asyncio.sleep(0.02)
        if display.is_open or running.done():
            break
    await asyncio.sleep(SETTLING)
    start, begun = time.process_time(), time.monotonic()
    await asyncio.sleep(seconds)
    used = (time.process_time() - start) / (time.monotonic() - begun)
    if running.done():
        running.result()
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    return used * 100


def measure(show: Show, seconds: float = SECONDS, *, headless: bool = True) -> float:
    """The percentage of a core that a screen takes in which nothing happens."""
    from robotouille_client.window.forms.display import Display

    display = Display(SIZE, headless=headless)
    try:
        return asyncio.run(share(show, display, seconds))
    finally:
        display.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--screen", action="store_true", help="open the window, e.g. under Xvfb")
    parser.add_argument("--only", help="the one screen whose name has this in it")
    options = parser.parse_args(arguments)
    if not find_spec("pygame"):
        print("the window is left out: it needs the extra `window`")
        return
    if not options.screen:
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    where = "on a screen" if options.screen else "without a screen"
    print(f"\nNobody does anything, {where}, {SIZE[0]} x {SIZE[1]} (aim {AIM:g} % of a core)")
    for name, show in SCREENS.items():
        if options.only is None or options.only in name:
            used = measure(show, options.seconds, headless=not options.screen)
            print(f"  {name:22} {used:5.1f} % of a core", flush=True)


if __name__ == "__main__":
    main()
