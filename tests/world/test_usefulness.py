"""Useful and useless actions and work."""

from __future__ import annotations

import pytest

from robotouille import State, World
from robotouille.world.presentation.usefulness import (
    changes_something,
    useful_actions,
    work_in_progress,
)
from tests.support.scripted import BOILING, POT_AT_SINK, after

CUTTING = ["move table9", "pick-up-item", "move board1", "place-item", "cut"]
COOKING = ["move table11", "pick-up-item chicken1", "move stove1", "place-item", "cook"]


def useless(state: State) -> list[str]:
    player = state.world.players[0]
    useful = useful_actions(state, player)
    return [action.name for action in state.actions(player) if action not in useful]


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ([], []),
        (CUTTING, []),
        ([*CUTTING, "cut", "cut"], ["cut"]),
        ([*COOKING, "-", "-", "-", "-"], ["cook"]),
        (POT_AT_SINK, ["fill-pot"]),
        (BOILING, ["boil-water"]),
        ([*BOILING, "-", "-", "-", "-"], ["boil-water"]),
    ],
)
def test_useless_actions(lines: list[str], expected: list[str]) -> None:
    assert useless(after("asynchronous/09", *lines)) == expected


def test_in_another_domain() -> None:
    lines = ["grab gear1", "walk anvil1", "drop", "hammer"]
    assert useless(after("workshop/01", *lines)) == []
    assert useless(after("workshop/01", *lines, "hammer")) == ["hammer"]


def test_waiting_counts_as_useful() -> None:
    state = World("asynchronous/09").initial
    assert changes_something(state, state.world.action("wait"))


def test_useless_progress_is_hidden() -> None:
    cutting = after("asynchronous/09", *CUTTING)
    assert work_in_progress(cutting) == cutting.progress() != ()
    again = after("asynchronous/09", *CUTTING, "cut", "cut", "cut", "cut")
    assert again.progress()
    assert work_in_progress(again) == ()
    boiling = after("asynchronous/09", *BOILING)
    assert [row.action for row in work_in_progress(boiling)] == ["boil-water"]
