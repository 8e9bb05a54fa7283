"""Small kitchens for one test each, and ways to play in them."""

from __future__ import annotations

from typing import Any

from robotouille import State, World
from robotouille.domain.schema import ProblemFile
from robotouille.domain.task import Timing, build_task, read_domain

__all__ = ["act", "kitchen", "play", "problem", "waiting"]


def problem(**fields: Any) -> dict[str, Any]:
    """A problem file: two tables, a board, two stoves, a sink, and a cook in front of table1."""
    return {
        "version": "2.0",
        "width": 6,
        "height": 5,
        "config": {},
        "stations": [
            {"name": "table", "x": 0, "y": 0},
            {"name": "table", "x": 1, "y": 0},
            {"name": "board", "x": 2, "y": 0},
            {"name": "stove", "x": 3, "y": 0},
            {"name": "stove", "x": 4, "y": 0},
            {"name": "sink", "x": 5, "y": 0},
        ],
        "items": [],
        "containers": [],
        "meals": [],
        "players": [{"name": "robot", "x": 0, "y": 1, "direction": [0, -1]}],
        "goal_description": "",
        "goal": [{"predicate": "clear", "args": ["item"], "ids": [1]}],
        **fields,
    }


def kitchen(
    *, timing: str = "benchmark", seats: int | None = None, domain: str = "robotouille", **fields: Any
) -> World:
    """The world of `problem(**fields)`."""
    task = build_task(
        "test",
        read_domain(domain),
        ProblemFile.model_validate(problem(**fields)),
        timing=Timing(timing),
        seats=seats,
    )
    return World(task)


def act(state: State, action: str, *arguments: str) -> State:
    """The state after one action, which must apply."""
    result = state.step(state.world.action(action, *arguments))
    assert all(attempt.applied for attempt in result.attempts), result.attempts
    return result.state


def play(state: State, *sentences: str, player: str = "") -> State:
    """The state after several actions, as their sentences say them."""
    for sentence in sentences:
        actor = player or state.world.players[0]
        result = state.step(state.world.parse(state, actor, sentence))
        assert result.attempts[0].applied
        state = result.state
    return state


def waiting(state: State, steps: int) -> State:
    """The state after some steps in which nobody acts."""
    for _ in range(steps):
        state = state.step([]).state
    return state
