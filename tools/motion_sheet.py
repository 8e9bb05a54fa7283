"""Draw how players move: contact sheets of walking, cutting, frying, handing over and more.

python -m tools.motion_sheet [--rendering chalk] [--out docs/images/motion.png]

Each strip shows every second frame of two seconds. The games are played by planner bots.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")

import pygame
from tools.make_film import record

from robotouille import State, World, load_task
from robotouille.planning.policies.shift_policy import play_shift
from robotouille.replay.recording import recording_of
from robotouille.world.scene import scene
from robotouille_client.window.drawing.painter import Painter
from robotouille_client.window.pictures.text_surfaces import Typesetter
from robotouille_client.window.pictures.theme import INK
from robotouille_client.window.replay.histories.recorded_history import RecordedHistory
from robotouille_client.window.video import FilmOptions, frames_of

SHEET = Path(__file__).resolve().parents[1] / "docs" / "images" / "motion.png"
FPS, FRAMES_PER_STEP, SECONDS = 24, 6, 2
SIZE = (1280, 720)
COLUMNS, SIDE, GAP, LETTERS = 12, 104, 4, 14
SHIFT = "shifts/04_counter@2"
COUNTER = 4
"""Column of the counter in that shift."""
GROUND = (250, 244, 230)


STEPS = SECONDS * FPS // FRAMES_PER_STEP
"""Steps of the game in a strip."""


@dataclass(frozen=True, slots=True)
class Strip:
    """One movement: its name, its states, and the object in the middle.

    Attributes:
        wide: Side of what is cut out, in tiles.
        at_end: True if the movement begins after the last state.
    """

    name: str
    states: Sequence[State]
    middle: str
    wide: float = 2.6
    at_end: bool = False


def solved(task: str) -> list[State]:
    """Return the states of a game that planner bots win."""
    history = RecordedHistory(recording_of(record(task), task))
    return [history.state(step) for step in range(history.length + 1)]


def played(task: str) -> list[State]:
    """Return the states of a shift that planner bots play."""
    world = World(load_task(task, timing="people"))
    states = [world.initial]
    play_shift(world, watch=states.append)
    return states


def strips() -> Iterator[Strip]:
    """Yield each movement at its first occurrence."""
    burger, soup, shift = solved("multi_agent/03"), solved("multi_agent/07@3"), played(SHIFT)
    yield _strip("walking", burger, _walk, wide=5)
    yield _strip("cutting", burger, lambda now, _: _at_work(now, "cut"))
    yield _strip("frying", burger, lambda now, _: _at_work(now, "fry"))
    yield _strip("filling a pot", soup, lambda now, _: _at_work(now, "fill-pot"))
    yield _strip("handing over", shift, _hand_over, lead=4, wide=3.6)
    yield _strip("serving", shift, _serve, lead=3, wide=3.6)
    yield Strip("cheering", burger[-2:], burger[-1].world.players[0], at_end=True)


def _strip(
    name: str,
    states: Sequence[State],
    middle: Callable[[State, State], str],
    lead: int = 0,
    wide: float = 2.6,
) -> Strip:
    """Return the strip that begins some steps before `middle` first finds an object."""
    step, thing = next(
        (i, thing) for i in range(1, len(states)) if (thing := middle(states[i], states[i - 1]))
    )
    first = max(0, step - 1 - lead)
    return Strip(name, states[first : first + STEPS + 1], thing, wide)


def _walk(now: State, before: State) -> str:
    """Return a player on a walk of at least three steps."""
    walkers = (p for p in now.world.players if now.busy_steps(p) >= 3)
    return next((p for p in walkers if scene(now)[p].at != scene(before)[p].at), "")


def _at_work(now: State, action: str) -> str:
    return next((row.subject for row in now.progress() if row.action == action), "")


def _hand_over(now: State, before: State) -> str:
    """Return the counter from which a player takes what another one put there."""
    then, players = scene(before), now.world.players
    taken = (n for n, p in scene(now).items() if p.host in players and n in then)
    hosts = (then[host] for name in taken if (host := then[name].host) is not None)
    return next((h.thing.name for h in hosts if h.tile is not None and h.tile[0] == COUNTER), "")


def _serve(now: State, before: State) -> str:
    served = [0 if state.orders is None else state.orders.served for state in (before, now)]
    hatches = (thing.name for thing in now.objects if thing.kind == "hatch")
    return next(hatches, "") if served[1] > served[0] else ""


def cells(strip: Strip, rendering: str) -> Iterator[pygame.Surface]:
    """Yield every second frame of a strip, cut out around its middle."""
    whole, hold = FPS * SECONDS, FPS * SECONDS if strip.at_end else 0
    options = FilmOptions(
        SIZE, FRAMES_PER_STEP, FPS, hold, rendering=rendering, outcome="Done" if hold else ""
    )
    world, painter = strip.states[0].world, Painter(rendering)
    halfway = strip.states[len(strip.states) // 2]
    tile, place = scene(halfway)[strip.middle].tile or (0, 0), painter.layout(SIZE, world)
    area = pygame.Rect(0, 0, round(strip.wide * place.tile), round(strip.wide * place.tile))
    area.center = place.cell(tile).center
    area.clamp_ip(0, 0, place.panel.left, SIZE[1])
    frames = frames_of(enumerate(strip.states), options)
    skipped = FRAMES_PER_STEP * (2 if strip.at_end else 1)
    for frame in islice(frames, skipped, skipped + whole, 2):
        yield pygame.transform.smoothscale(frame.subsurface(area), (SIDE, SIDE))


def sheet(rendering: str = "") -> pygame.Surface:
    """Return all strips, each in two lines."""
    text, found = Typesetter(), list(strips())
    head, lines = LETTERS * 2, -(-FPS * SECONDS // 2 // COLUMNS)
    high = head + lines * (SIDE + GAP)
    surface = pygame.Surface((COLUMNS * (SIDE + GAP) + GAP, len(found) * high + GAP))
    surface.fill(GROUND)
    for row, strip in enumerate(found):
        top = row * high + GAP
        surface.blit(text.line(strip.name.capitalize(), LETTERS, INK), (GAP, top))
        for number, cell in enumerate(cells(strip, rendering)):
            line, column = divmod(number, COLUMNS)
            at = (GAP + column * (SIDE + GAP), top + head - GAP + line * (SIDE + GAP))
            surface.blit(cell, at)
    return surface


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the sheet."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rendering", default="", help="rendering instead of the domain's own")
    parser.add_argument("--out", type=Path, default=SHEET)
    options = parser.parse_args(arguments)
    pygame.image.save(sheet(options.rendering), options.out)
    print(options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
