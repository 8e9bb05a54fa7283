"""Shifts for tests: the example, and a kitchen with plates and soup."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from robotouille.domain.loading import load_task
from robotouille.domain.schema import Arrival
from robotouille.domain.task import Task
from robotouille.replay import Recording
from robotouille.world.world import State, World

__all__ = [
    "EXAMPLE",
    "TOAST_ACTIONS",
    "act",
    "bistro",
    "example",
    "file_of",
    "recomputed",
    "term",
    "toast_almost",
]

EXAMPLE = Path(__file__).parents[2] / "examples" / "first_shift.json"


def example(**options: Any) -> Task:
    return load_task(str(EXAMPLE), **options)


def file_of(**changes: Any) -> dict[str, Any]:
    """Return the example as JSON, with changes to its shift."""
    problem: dict[str, Any] = json.loads(EXAMPLE.read_text())
    problem["shift"] |= changes
    return problem


def term(predicate: str, *kinds_and_ids: Any) -> dict[str, Any]:
    kinds, ids = kinds_and_ids[::2], kinds_and_ids[1::2]
    return {"predicate": predicate, "args": list(kinds), "ids": list(ids)}


TOAST = [
    term("item_on", "plate", 1, "hatch", 2),
    term("isclean", "plate", 1),
    term("atop", "bread", 3, "plate", 1),
]
SOUP = [
    term("container_at", "bowl", 1, "hatch", 2),
    term("in", "water", 3, "bowl", 1),
    term("addedto", "onion", 4, "water", 3),
]
BISTRO: dict[str, Any] = {
    "version": "2.0",
    "domain": "restaurant",
    "width": 8,
    "height": 4,
    "config": {"wash_time": {"default": 2}, "fill_time": {"default": 1}},
    "objects": {
        "station": [
            {"name": name, "x": x, "y": 3 if x % 2 else 0}
            for x, name in enumerate(["rack", "sink", "crate", "crate", "stove", "table", "hatch"])
        ]
        + [{"name": "bin", "x": 7, "y": 3}, {"name": "table", "x": 7, "y": 0}],
        "item": [
            {"name": "plate", "x": 0, "y": 0, "predicates": ["isclean"]},
            {"name": "bread", "x": 2, "y": 0},
            {"name": "bread", "x": 2, "y": 0, "stack-level": 1},
            {"name": "onion", "x": 3, "y": 3, "predicates": ["iscuttable"]},
        ],
        "container": [{"name": "pot", "x": 4, "y": 0}, {"name": "bowl", "x": 5, "y": 3}],
        "player": [{"name": "robot", "x": 1, "y": 2, "direction": [0, 1]}],
    },
    "shift": {
        "steps": 200,
        "menu": {
            "toast": {"goal": TOAST, "points": 10, "tip": 8, "patience": 80},
            "soup": {"goal": SOUP, "points": 30, "penalty": 7, "patience": 100},
        },
        "arrivals": [{"at": 0, "dish": "toast"}, {"at": 0, "dish": "soup"}],
        "serve": {
            "station": "hatch",
            "predicates": ["item_at", "container_at"],
            "soils": ["isclean"],
        },
        "discard": "bin",
    },
}


def bistro(folder: Path, **changes: Any) -> World:
    """Return a kitchen with plates that must be washed, and soup."""
    problem = copy.deepcopy(BISTRO)
    problem["shift"] |= changes
    path = folder / "bistro.json"
    path.write_text(json.dumps(problem))
    return World(str(path))


def act(state: State, *sentences: str | None) -> State:
    """Take a step for each sentence of a valid action, or None for nothing."""
    for sentence in sentences:
        result = state.step(sentence)
        assert all(attempt.applied for attempt in result.attempts)
        state = result.state
    return state


TOAST_ACTIONS = (
    "Pick up plate1 at rack1 with robot1",
    "Move robot1 from rack1 to hatch1",
    "Put down plate1 at hatch1 with robot1",
    "Move robot1 from hatch1 to crate1",
    "Lift bread2 off bread1 at crate1 with robot1",
    "Move robot1 from crate1 to hatch1",
)


def toast_almost(world: World) -> State:
    """Return a state of the bistro in which one action is left to serve a toast."""
    return act(world.initial, "Move robot1 from sink1 to rack1", *TOAST_ACTIONS)


def recomputed(recording: Recording) -> tuple[int, int, int]:
    """Compute the result of a shift from its file and the facts of a kitchen without a shift.

    Dishes are recognised by the goals of tasks of their own, and orders kept in a list of rows.
    """
    task = recording.task
    shift = task.problem.shift
    assert shift is not None
    factor = task.profile.delay_factor
    arrivals = [each for each in shift.arrivals if isinstance(each, Arrival)]
    plain = {}
    for name, dish in shift.menu.items():
        problem = task.problem.model_copy(update={"shift": None, "goal": dish.goal})
        plain[name] = World(replace(task, problem=problem))
    waiting: list[tuple[int, str]] = []
    queue = [(each.at * factor, each.dish) for each in arrivals]
    points = served = expired = 0
    before: State | None = None
    frames = iter(recording.steps)
    for time, state in recording.states():
        if before is not None:
            frame = next(frames)
            for name in dict.fromkeys(dish for _, dish in sorted(waiting)):
                world = plain[name]
                facts = (before.facts, before.timer_rows(), before.timers.busy)
                moves = [world.action(*move["action"]) for move in frame["moves"]]
                if world.restore(*facts).step(moves).state.goal_reached:
                    due = min(due for due, dish in waiting if dish == name)
                    waiting.remove((due, name))
                    dish, patience = shift.menu[name], shift.menu[name].patience * factor
                    points += dish.points + dish.tip * (due - time) // patience
                    served += 1
                    break
            for due, name in [row for row in waiting if row[0] <= time]:
                waiting.remove((due, name))
                points -= shift.menu[name].penalty
                expired += 1
        while queue and queue[0][0] <= time and len(waiting) < shift.most_open:
            name = queue.pop(0)[1]
            waiting.append((time + shift.menu[name].patience * factor, name))
        before = state
    return points, served, expired
