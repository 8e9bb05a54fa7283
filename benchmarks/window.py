"""What a frame of the window costs.

python -m benchmarks.window

Frames are drawn in software, without a screen, beside the bare cost of blitting as many sprites of
the same size on the same background. Needs the extra `window`.
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
"""Those of 3 s before a game."""
AIM_FRAME = 8.0


@dataclass(frozen=True, slots=True)
class Frames:
    """Milliseconds of processor for one frame; `bare` is that of the sprites alone."""

    median: float
    p99: float
    bare: float


Course = list[tuple[State, State]]
"""Steps: the states before and after each."""


def course(steps: int = STEPS) -> Course:
    """The largest task, played by its shortest plan again and again: everybody walks, carries and
    cooks at every step."""
    world = World(TASK)
    plan = read_plan("\n".join(load_certificate(world.task).plan or ()), world)
    state, taken = world.initial, []
    for joint in itertools.islice(itertools.cycle(plan), steps):
        before = world.initial if state.goal_reached else state
        state = world.step(before, joint).state
        taken.append((before, state))
    return taken


class Led:
    """A source that is led through views by hand."""

    finished = False

    def __init__(self, shown: View) -> None:
        self.shown = shown

    def view(self) -> View:
        return self.shown

    def act(self, action: object) -> None:
        """Nothing comes of it."""

    def say(self, text: str) -> None:
        """Nobody listens."""


def views(taken: Course, phases: int) -> Iterator[View]:
    """Each of the frames of a course, with everything that a view can show."""
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
    """Show a course in a window, from the source to the screen. What is drawn ahead between two
    frames is part of the first of them; the countdown, in which that begins, is left out."""
    from robotouille_client.window.window import Window

    window, shown = Window(SIZE, headless=True), list(views(course(steps), PHASES))
    source = Led(replace(shown[0], previous=None, state=shown[0].world.initial, starts_in=3.0))
    times = []

    def frame() -> None:
        window.frame(source)
        window.preload()

    gc.collect()
    gc.freeze()  # As a window does that is on a screen.
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
    """The background and one sprite for each thing that moves."""
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
    """What does not move."""
    types = set(view.world.task.domain.station_types)
    return {thing.name for thing in view.state.objects if thing.type in types}


def _timed(what: Callable[[], None]) -> float:
    start = time.thread_time()
    what()
    return (time.thread_time() - start) * 1e3


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args(arguments)
    if not find_spec("pygame"):
        print("the window is left out: it needs the extra `window`")
        return
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    frames = measure_frames()
    print(f"window, {TASK} at {SIZE[0]} x {SIZE[1]}, software rendering")
    print(
        f"  a frame: median {frames.median:.2f} ms, 99 % under {frames.p99:.2f} ms (aim "
        f"{AIM_FRAME:g} ms), {frames.p99 / frames.bare:.1f} times the same sprites alone "
        f"({frames.bare:.2f} ms)"
    )


if __name__ == "__main__":
    main()
