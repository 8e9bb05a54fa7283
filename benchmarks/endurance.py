"""Measure the window's memory over hours of games, menus, changes of size and new chat lines.

python -m benchmarks.endurance --minutes 60

Time is simulated: one frame per step at 5 steps per second. Needs the extra `window`.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import os
import random
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from tests.support.window_play import Timer

if TYPE_CHECKING:
    from robotouille_client.window.app.local_game import LocalGame
    from robotouille_client.window.forms.screen import Display

RATE, MINUTES = 5, 60
GAME_STEPS, SIZE_STEPS = 150, 40
TASKS = ("multi_agent/01", "multi_agent/07", "asynchronous/09", "synchronous/03")
SIZES = ((640, 360), (320, 240), (800, 600), (1280, 720))


@dataclass(frozen=True, slots=True)
class Sample:
    """Memory of this process in MiB after a number of steps and games."""

    steps: int
    games: int
    memory: float


def evening(steps: int, samples: int, sizes: Sequence[tuple[int, int]] = SIZES) -> Iterator[Sample]:
    """Play one game after another in one display, and yield memory samples."""
    from robotouille.episode.rules import Clock
    from robotouille_client.bots.kinds import BotKind
    from robotouille_client.bots.partners import prompt_partners
    from robotouille_client.window.app.local_game import GameSetup, LocalGame
    from robotouille_client.window.forms.screen import Display

    timer, done, dice = Timer(), 0, random.Random(1)
    due = [steps * (n + 1) // samples for n in range(samples)]
    display = Display(sizes[0], headless=True)
    with tempfile.TemporaryDirectory() as folder:
        for number, task in enumerate(itertools.cycle(TASKS)):
            setup = GameSetup(
                task, None, Clock.REALTIME, RATE, BotKind.RANDOM, max_steps=GAME_STEPS,
                seed=number, countdown=0.0,
            )  # fmt: skip
            game = LocalGame(setup, "Ada", timer, Path(folder), prompt_partners)
            for _ in play(game, display, dice):
                timer.now += 1 / RATE
                done += 1
                if done % SIZE_STEPS == 0:
                    resize(display, sizes[done // SIZE_STEPS % len(sizes)])
                if due and done >= due[0]:
                    yield Sample(due.pop(0), number + 1, memory())
            game.finish(ended=True)
            in_menu(display)
            if not due:
                break
    display.close()


def play(game: LocalGame, display: Display, dice: random.Random) -> Iterator[None]:
    """Play one game frame by frame; the player acts, points and chats at random."""
    import pygame

    from robotouille_client.window.forms.screen import Devices
    from robotouille_client.window.window import Window

    window, source = Window(devices=Devices(display)), game.source
    for step in itertools.count():
        window.frame(source)
        window.preload()
        if source.finished:
            return
        view = source.view()
        actions = view.state.actions(view.me or "")
        if actions:
            source.act(dice.choice(actions))
        if step % 10 == 0:
            source.say(f"This is chat line {dice.random()}.")
            pos = dice.randrange(display.size[0]), dice.randrange(display.size[1])
            moved = {"pos": pos, "rel": (0, 0), "buttons": (0, 0, 0)}
            pygame.event.post(pygame.Event(pygame.MOUSEMOTION, moved))
        if step % 25 < 2:
            key = pygame.K_TAB if step % 2 else pygame.K_h
            pygame.event.post(pygame.Event(pygame.KEYDOWN, key=key, mod=0, unicode=""))
        yield


def resize(display: Display, size: tuple[int, int]) -> None:
    """Resize the window as if the player dragged its edge."""
    import pygame

    display.size = size
    pygame.display.set_mode(size, pygame.RESIZABLE)


def in_menu(display: Display) -> None:
    """Draw the main menu once."""
    import pygame

    from robotouille_client.window.app.main_menu import main_menu
    from robotouille_client.window.app.settings import Settings
    from robotouille_client.window.pictures.text_surfaces import Typesetter

    surface = display.surface
    if surface is not None:
        main_menu(Settings(), "").draw(surface, surface.get_rect(), Typesetter(), 14)
        pygame.event.clear()


def memory() -> float:
    """Return the memory of this process in MiB."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the memory after each tenth of the run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=int, default=MINUTES)
    options = parser.parse_args(arguments)
    if not find_spec("pygame") or not Path("/proc/self/statm").exists():
        print("window memory: skipped; needs the extra `window` and /proc")
        return
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    begun = time.process_time()
    found = list(evening(options.minutes * 60 * RATE, 10))
    used = time.process_time() - begun
    row = " ".join(f"{each.memory:.1f}" for each in found)
    print(
        f"\nWindow memory over {options.minutes} minutes of play at {RATE} steps per second, "
        f"{found[-1].games} games ({used:.0f} s processor time), MiB after each tenth:\n  {row}"
    )


if __name__ == "__main__":
    main()
