"""The world plays as the naive reference did when the golden trajectories were made."""

from __future__ import annotations

import json
from collections.abc import Sequence

import pytest

from robotouille import State, World
from tests.programs.make_trajectories import FILE, TASKS, plan_of, summary, trajectories
from tests.support.samples import quick_sample

GOLDEN = json.loads(FILE.read_text())


def seen(state: State, applied: Sequence[bool]) -> str:
    players = state.world.players
    valid = [[" ".join((a.name, *a.arguments)) for a in state.actions(p)] for p in players]
    return summary(state.digest, valid, applied, state.goal_reached)


@pytest.mark.parametrize("name", TASKS)
def test_golden_walk_is_unchanged(name: str) -> None:
    state = World(name).initial
    expected = GOLDEN[name]["walk"]
    assert seen(state, []) == expected[0]
    for number, choices in enumerate(GOLDEN[name]["choices"], start=1):
        players = zip(state.world.players, choices, strict=True)
        step = state.step([state.actions(p)[i] for p, i in players if i >= 0])
        state = step.state
        assert seen(state, [a.applied for a in step.attempts]) == expected[number], number
    assert len(expected) == number + 1


@pytest.mark.parametrize("name", quick_sample(TASKS, 10))
def test_shipped_plan_gives_the_golden_states(name: str) -> None:
    world = World(name)
    state = world.initial
    found = [seen(state, [])]
    for joint in plan_of(name, world.task.seats):
        step = state.step([world.action(action, *arguments) for _, (action, arguments) in joint])
        state = step.state
        found.append(seen(state, [a.applied for a in step.attempts]))
    assert found == GOLDEN[name]["plan"]
    assert state.goal_reached


def test_every_task_has_trajectories() -> None:
    assert sorted(GOLDEN) == sorted(TASKS)
    assert FILE.stat().st_size < 300_000


@pytest.mark.parametrize("name", ["synchronous/01_cheese_sandwich"])
def test_golden_file_is_up_to_date(name: str) -> None:
    """After an intended change, run `python -m tests.programs.make_trajectories`."""
    assert GOLDEN[name] == trajectories(name)
