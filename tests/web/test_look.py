"""The browser client shows the same scenes, pictures, poses and effects as the window."""

from __future__ import annotations

import json
import random
import subprocess
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from robotouille import State, Task, World, load_task
from robotouille.domain.input_bindings import bindings_of
from robotouille.domain.rendering import rendering_of
from robotouille.planning.shift import DishPlanner
from robotouille.protocol.states import StateWriter
from robotouille.web.site import look_files
from robotouille.world.presentation.work import useful_actions
from robotouille_client.window.drawing.kitchen.animation import (
    Moment,
    StepAnimation,
    step_animation,
)
from robotouille_client.window.drawing.kitchen.gestures import Gestures
from robotouille_client.window.drawing.kitchen.spots import Motion
from robotouille_client.window.pictures.appearance import (
    AppearanceResolver,
    SceneSprites,
    SpritePiece,
)
from robotouille_client.window.pictures.dishes import Dish, dishes
from robotouille_client.window.view import View
from tests.support.node import node
from tests.web.vectors import published_tasks, shipped_tasks

COMPARE = Path(__file__).parent / "look.mjs"
pytestmark = pytest.mark.process

STEPS = 60
"""Steps of one game."""
QUICK = (
    "asynchronous/10", "multi_agent/09@2", "shifts/05@1", "workshop/02", "examples/pancakes",
    "synchronous/08",
)  # fmt: skip
"""Tasks of the short test: every domain, and soups, stacks and dirty plates."""
PHASES = (0.0, 0.35, 0.8, 1.0)


def games(tasks: Iterator[Task], states: int, rng: random.Random) -> Iterator[dict[str, Any]]:
    """Yield the lines of random games of some tasks, with a number of states in all."""
    chosen = list(tasks)
    rng.shuffle(chosen)
    steps = max(2, min(STEPS, states // len(chosen)))
    while states > 0:
        for task in chosen[: max(1, states // steps)]:
            yield from _game(task, steps, rng)
            states -= steps


def _game(task: Task, states: int, rng: random.Random) -> Iterator[dict[str, Any]]:
    world = World(task)
    window, writer, state = _Window(world), StateWriter(world), world.initial
    # Games start at different times of their work, so that short samples see all of it.
    for _ in range(rng.choice((0, 10, 60)) if states < STEPS else 0):
        state = _step(state, rng)
    yield {
        "task": task.json,
        "look": look_files(window.rendering, bindings_of(task)),
        "snapshot": {"step": 0, **writer.tables(state), **writer.values(state)},
        "step": 0,
        "expect": {**window.dishes(), **window.picture(state, None, 0, rng)},
    }
    for step in range(1, states):
        before, state = state, _step(state, rng)
        delta = {"step": step, **writer.changes(before, state)}
        yield {"delta": delta, "step": step, "expect": window.picture(state, before, step, rng)}


def _step(state: State, rng: random.Random) -> State:
    """Return the state after random actions that change something."""
    joint = {}
    for player in state.world.players:
        valid = useful_actions(state, player)
        work = [action for action in valid if action.destination is None]
        choices = work if work and rng.random() < 0.6 else valid
        if choices and rng.random() < 0.9:
            joint[player] = rng.choice(choices)
    return state.step(joint).state


class _Window:
    """Expected pictures of the states of one game, as the window draws them."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.rendering = rendering_of(world.task)
        self._resolver = AppearanceResolver(world.task.domain, self.rendering)
        self._motion = Motion(world.floor)
        self._gestures = Gestures()

    def dishes(self) -> dict[str, Any]:
        """Return the pictures of the goal and of the orders of a shift."""
        world, resolver = self.world, self._resolver
        shift = world.task.problem.shift
        return {
            "dishes": _dishes(dishes(world, resolver)),
            "orders": {name: self._order(name) for name in (shift.menu if shift else ())},
        }

    def _order(self, name: str) -> list[dict[str, Any]]:
        found = dishes(DishPlanner(self.world, name).world, self._resolver) or ()
        layers = [layer for dish in found for layer in dish.layers][::-1]
        shown = [layer.appearance for layer in layers if layer.appearance.role != "station"]
        return [asdict(each) for each in shown]

    def picture(
        self, state: State, before: State | None, step: int, rng: random.Random
    ) -> dict[str, Any]:
        """Return what the window draws of a state."""
        resolver, stage = self._resolver, self._resolver.stage(state)
        earlier = None if before is None else Moment(before, resolver.stage(before))
        won = before is not None and state.goal_reached and not before.goal_reached
        lost = not won and rng.random() < 0.1
        moving = step_animation(self.rendering, Moment(state, stage), earlier, lost=lost)
        return {
            "outcome": "won" if won else "lost" if lost else "",
            "scene": {
                name: {
                    "tile": each.tile, "host": each.host, "level": each.level,
                    "facing": each.facing, "at": each.at, "facts": sorted(each.facts),
                    "contents": each.contents,
                }
                for name, each in stage.placed.items()
            },
            "stage": {
                "stations": {name: asdict(each) for name, each in stage.stations.items()},
                "piles": {host: list(map(_piece, pile)) for host, pile in stage.piles.items()},
                "bases": stage.bases,
            },
            "words": {
                name: resolver.words(each.thing.kind, each.facts)
                for name, each in stage.placed.items()
            },
            "animation": _animation(moving),
            "poses": [self._poses(state, before, step, p, stage, moving, rng) for p in PHASES],
        }  # fmt: skip

    def _poses(
        self, state: State, before: State | None, step: int, phase: float, stage: SceneSprites,
        moving: StepAnimation, rng: random.Random,
    ) -> dict[str, Any]:  # fmt: skip
        earlier = None if before is None else self._resolver.stage(before).placed
        poses = self._motion.poses(state, stage.placed, earlier, step, phase)
        seconds = rng.random() * 60
        view = View(self.world, state, None, step, 0, "", phase, (), None, seconds=seconds)
        held = {name for name in poses if name in stage.piles}
        # Gestures of their own: the window also celebrates served dishes.
        gestures = {
            name: {**asdict(each), "lean": None}
            for name, each in Gestures().of(view, poses, moving, held).items()
        }
        for each in gestures.values():
            del each["lean"]  # A head is shaken about a bubble, and the page draws these.
        return {
            "phase": phase,
            "seconds": seconds,
            "poses": {name: asdict(pose) for name, pose in poses.items()},
            "walking": self._motion.walking(step),
            "gestures": gestures,
        }


def _dishes(found: tuple[Dish, ...] | None) -> list[Any] | None:
    return None if found is None else [asdict(dish)["layers"] for dish in found]


def _piece(piece: SpritePiece) -> dict[str, Any]:
    """Return what the page draws of an object in a pile: its picture shows what is in it."""
    return {name: value for name, value in asdict(piece).items() if name != "inside"}


def _animation(moving: StepAnimation) -> dict[str, Any]:
    return {
        "travels": sorted(moving.travels),
        "working": sorted(moving.working),
        "shaken": sorted(moving.shaken),
        "emissions": [[each.effect.asset, each.source] for each in moving.emissions],
        "tools": [[each.tool.asset, each.target] for each in moving.tools],
    }


def compared(lines: Iterator[dict[str, Any]]) -> dict[str, int]:
    """Return the counts of a comparison. It prints the first differences."""
    text = "".join(json.dumps(line) + "\n" for line in lines)
    done = subprocess.run(
        [node(), str(COMPARE)], input=text, capture_output=True, text=True, check=False, timeout=300
    )
    *differences, counts = done.stdout.splitlines() or [""]
    assert done.returncode == 0, done.stderr
    for line in differences:
        print(line)
    found: dict[str, int] = json.loads(counts)
    return found


def test_scenes_and_pictures_are_those_of_the_window() -> None:
    rng = random.Random(3)
    found = compared(games(map(load_task, QUICK), 60, rng))
    assert found["states"] >= 50
    assert found["differences"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_scenes_and_pictures_of_many_states(seed: int) -> None:
    rng = random.Random(seed)
    found = compared(games(shipped_tasks(rng), 2000, rng))
    assert found["states"] >= 1900
    assert found["differences"] == 0


@pytest.mark.slow
def test_kitchens_of_the_published_dialect() -> None:
    tasks = list(published_tasks())
    if not tasks:
        pytest.skip("the published files are missing")
    rng = random.Random(8)
    assert compared(games(iter(tasks), 1000, rng))["differences"] == 0
