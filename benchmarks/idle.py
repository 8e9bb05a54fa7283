"""Measure the processor load of each screen of the window while the player does nothing.

python -m benchmarks.idle [--screen]

The load is processor time per second of wall time. The window draws without a display, unless
`--screen` is given. Needs the extra `window`.
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
    from robotouille_client.window.drawing.window_layout import Strip
    from robotouille_client.window.forms.card_slot import Cards
    from robotouille_client.window.forms.screen import Display
    from robotouille_client.window.sources.local import LocalSource
    from robotouille_client.window.view import GameSource

SIZE, SECONDS, SETTLING = (1280, 720), 4.0, 1.0
AIM = 5.0

Show = Callable[["Display"], Coroutine[Any, Any, object]]


@dataclass(frozen=True, slots=True)
class Resting:
    """Policy that does nothing."""

    player: str

    def observe(self, did: object) -> None:
        """Ignore the actions."""

    def act(self, state: State) -> GroundAction | None:
        return None


def resting_game(task: str, steps: int = 1000, now: Callable[[], float] = time.monotonic) -> Any:
    """Return a local game at 5 steps per second in which nobody acts."""
    from robotouille_client.window.sources.local import LocalSeats, LocalSource

    world = World(task)
    me, *others = world.players
    rules = Rules(clock=Clock.REALTIME, step_rate=5.0, max_steps=steps)
    partners = PromptPartners({player: Resting(player) for player in others})
    bots = {player: player.title() for player in others}
    return LocalSource(Episode(world, rules, now()), LocalSeats(me, bots), partners, now)


async def in_window(source: GameSource, display: Display, cards: Cards | None = None) -> None:
    from robotouille_client.window.forms.screen import Devices
    from robotouille_client.window.window import Window

    await Window(devices=Devices(display), cards=cards).run(source, linger=None)


async def playing(display: Display) -> None:
    """Show a game for one player."""
    await in_window(resting_game("asynchronous/09"), display)


async def team(display: Display) -> None:
    """Show a game for four players."""
    await in_window(resting_game("multi_agent/10@4"), display)


async def over(display: Display) -> None:
    """Show the card at the end of a lost game."""
    from robotouille_client.window.app.game_cards import GameCards

    source: LocalSource = resting_game("synchronous/01", 1)
    cards = GameCards(lambda: source.outcome, lambda: [("Menu", "menu")])
    await in_window(source, display, cards=cards)


async def menu(display: Display) -> None:
    """Show the main menu."""
    from robotouille_client.window.app.main_menu import main_menu
    from robotouille_client.window.app.settings import Settings
    from robotouille_client.window.forms.screen import Screen

    await Screen(display).ask(main_menu(Settings(), ""))


async def paused(display: Display) -> None:
    """Show a paused replay."""
    from robotouille.replay.recording import read_recording
    from robotouille_client.window.forms.screen import Devices
    from robotouille_client.window.options import WindowStyle
    from robotouille_client.window.replay.viewer import RecordingViewer
    from robotouille_client.window.window import Window

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "game.rbt"
        path.write_bytes(recorded_game("multi_agent/07@4"))

        def make_window(caption: str, strip: Strip) -> Window:
            return Window(style=WindowStyle(strip=strip), devices=Devices(display))

        viewer = RecordingViewer([(path, read_recording(path))], make_window=make_window)
        viewer.playhead.seek(20, playing=False)
        await viewer.window.run(viewer, linger=None)


async def waiting(display: Display) -> None:
    """Show a kitchen on a server that waits for the second player."""
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
    "the card at the end": over,
    "the menu": menu,
    "a paused replay": paused,
    "a waiting kitchen": waiting,
}


async def share(show: Show, display: Display, seconds: float) -> float:
    """Return the load of a screen in percent of a core."""
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
    """Open a display and return the load of a screen in percent of a core."""
    from robotouille_client.window.forms.screen import Display

    display = Display(SIZE, headless=headless)
    try:
        return asyncio.run(share(show, display, seconds))
    finally:
        display.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--screen", action="store_true", help="open the window, e.g. under Xvfb")
    parser.add_argument("--only", help="measure only screens whose name contains this text")
    options = parser.parse_args(arguments)
    if not find_spec("pygame"):
        print("idle window: skipped; needs the extra `window`")
        return
    if not options.screen:
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    where = "on a display" if options.screen else "without a display"
    print(f"\nIdle window, {where}, {SIZE[0]} x {SIZE[1]} (target {AIM:g} % of a core)")
    for name, show in SCREENS.items():
        if options.only is None or options.only in name:
            used = measure(show, options.seconds, headless=not options.screen)
            print(f"  {name:22} {used:5.1f} % of a core", flush=True)


if __name__ == "__main__":
    main()
