"""The small searches of `examples/search` do what they say."""

from __future__ import annotations

import runpy
from typing import Any

import pytest

from robotouille import GroundAction, State, World
from tests.support.sources import ROOT

START = World("synchronous/01").initial


def names(example: str) -> dict[str, Any]:
    return runpy.run_path(str(ROOT / f"examples/search/{example}.py"))


def after(plan: list[GroundAction]) -> State:
    state = START
    for action in plan:
        state = START.world.successor(state, action)
    return state


@pytest.mark.parametrize("example", ["breadth_first", "astar"])
def test_a_search_finds_the_shortest_plan(example: str) -> None:
    plan = names(example)[example](START)
    assert len(plan) == 8
    assert after(plan).goal_reached


def test_tree_search_plays_to_the_goal() -> None:
    search, state = names("mcts")["Mcts"]("robot1"), START
    for _ in range(20):
        if state.goal_reached:
            break
        state = state.world.successor(state, search.act(state))
    assert state.goal_reached


@pytest.mark.parametrize("example", ["breadth_first", "astar", "mcts"])
def test_an_example_is_a_program(
    example: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = ROOT / f"examples/search/{example}.py"
    monkeypatch.setattr("sys.argv", [str(path), "synchronous/01"])
    runpy.run_path(str(path), run_name="__main__")
    assert len(capsys.readouterr().out.splitlines()) == 8
