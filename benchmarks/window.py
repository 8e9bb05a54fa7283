"""Measure the cost of a frame of the window.

python -m benchmarks.window

Frames are drawn in software, without a display. For comparison, the benchmark blits the same number
of sprites of the same size on a plain background. Needs the extra `window`.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import TYPE_CHECKING

from robotouille import State, World
from robotouille.certification.certificate import load_certificate
from robotouille.planning import read_plan

if TYPE_CHECKING:
    from robotouille_client.window.view import View

TASK, SIZE, PHASES = "multi_agent/10@4", (1280, 720), 12
STEPS = 120
COUNTDOWN_FRAMES = 180
"""Number of frames in the 3 s countdown before a game."""
AIM_FRAME = 8.0


@dataclass(frozen=True, slots=True)
class Frames:
    """Milliseconds of processor time per frame; `bare` is for the sprites alone."""

    median: float
    p99: float
    bare: float


Course = list[tuple[State, State]]
"""Sequence of steps, each with the states before and after it."""


def course(steps: int = STEPS) -> Course:
    """Return steps of the largest task, whose shortest plan repeats. All players act each step."""
    world = World(TASK)
    plan = read_plan("\n".join(load_certificate(world.task).plan or ()), world)
    state, taken = world.initial, []
    for joint in itertools.islice(itertools.cycle(plan), steps):
        before = world.initial if state.goal_reached else state
        state = world.step(before, joint).state
        taken.append((before, state))
    return taken


class Led:
    """Source whose view the caller sets."""

    finished = False

    def __init__(self, shown: View) -> None:
        self.shown = shown

    def view(self) -> View:
        return self.shown

    def act(self, action: object) -> None:
        """Ignore the action."""

    def say(self, text: str) -> None:
        """Ignore the text."""

    def signal(self, signal: object) -> None:
        """Ignore the signal."""

    def be_ready(self, ready: bool) -> None:
        """Ignore whether the player is ready."""


def views(taken: Course, phases: int) -> Iterator[View]:
    """Yield each frame of a course as a view with all optional parts."""
    from robotouille_client.window.view import Bubble, SeatView, View

    players = taken[0][0].world.players
    for step, (before, state) in enumerate(taken, start=1):
        seats = tuple(SeatView(p, p.title(), actions=step) for p in players)
        said = (Bubble(players[step % len(players)], f"That was step {step}.", "chat"),)
        view = View(
            state.world, state, before, step, 500, "real time", 0.0, seats, players[0], said,
            (("Ada", f"step {step}"),),
        )  # fmt: skip
        for phase in range(phases):
            yield replace(view, phase=(phase + 1) / phases)


def measure_frames(steps: int = STEPS) -> Frames:
    """Show a course in a window and measure its frames.

    The time of a frame includes preloading after it. The countdown before the game, in which
    preloading begins, is not measured.
    """
    from robotouille_client.window.options import DisplayOptions
    from robotouille_client.window.window import Window

    window = Window(DisplayOptions(SIZE, headless=True))
    shown = list(views(course(steps), PHASES))
    source = Led(replace(shown[0], previous=None, state=shown[0].world.initial, starts_in=3.0))
    times = []

    def frame() -> None:
        window.frame(source)
        window.preload()

    gc.collect()
    gc.freeze()  # As a window on a display does.
    try:
        for _ in range(COUNTDOWN_FRAMES):
            frame()
        for view in shown:
            source.shown = view
            times.append(_timed(frame))
        rest = sorted(times)
        return Frames(rest[len(rest) // 2], rest[len(rest) * 99 // 100], _bare(shown[-1]))
    finally:
        gc.unfreeze()
        window.close()


def _bare(view: View) -> float:
    """Measure drawing the background and one sprite for each movable thing."""
    import pygame

    from robotouille_client.window.drawing.window_layout import layout

    problem = view.world.task.problem
    side = layout(SIZE, problem.width, problem.height).tile
    surface, ground = pygame.Surface(SIZE), pygame.Surface(SIZE)
    sprite = pygame.Surface((side, side), pygame.SRCALPHA)
    sprite.fill((200, 100, 50, 128))
    count = sum(name not in problem_stations(view) for name in (o.name for o in view.state.objects))
    places = [((i * 97) % (SIZE[0] - side), (i * 61) % (SIZE[1] - side)) for i in range(count)]

    def frame() -> None:
        surface.blit(ground, (0, 0))
        for place in places:
            surface.blit(sprite, place)

    times = sorted(_timed(frame) for _ in range(200))
    return times[100]


def problem_stations(view: View) -> set[str]:
    """Return the names of the stations, which do not move."""
    types = set(view.world.task.domain.station_types)
    return {thing.name for thing in view.state.objects if thing.type in types}


def _timed(what: Callable[[], None]) -> float:
    start = time.thread_time()
    what()
    return (time.thread_time() - start) * 1e3


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args(arguments)
    if not find_spec("pygame"):
        print("window: skipped; needs the extra `window`")
        return
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    frames = measure_frames()
    print(f"window, {TASK} at {SIZE[0]} x {SIZE[1]}, software rendering")
    print(
        f"  frame: median {frames.median:.2f} ms, 99 % under {frames.p99:.2f} ms (target "
        f"{AIM_FRAME:g} ms), {frames.p99 / frames.bare:.1f} times the sprites alone "
        f"({frames.bare:.2f} ms)"
    )


if __name__ == "__main__":
    main()
