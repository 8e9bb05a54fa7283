"""A planner bot that is alone finishes every task over real sockets, under each clock, in time."""

from __future__ import annotations

from math import floor
from pathlib import Path

import pytest

from robotouille import load_task, task_names
from robotouille.episode import Clock
from robotouille_client.bots.kinds import BotKind, policy_maker
from tests.support.bot_games import finish
from tests.support.samples import each_quickly_once
from tests.support.virtual_time import run

OPTIMAL = {
    "synchronous/": (8, 14, 24, 11, 15, 23, 36, 36, 60, 54),
    "asynchronous/": (17, 23, 33, 42, 46, 19, 42, 40, 58, 72),
}
"""Proven lengths of shortest plans, in the order of the tasks' names."""

LENGTHS = {
    name: length
    for folder, lengths in OPTIMAL.items()
    for name, length in zip(
        sorted(name for name in task_names() if name.startswith(folder)), lengths, strict=True
    )
}

planner = policy_maker(BotKind.PLANNER)


@pytest.mark.parametrize(("name", "clock"), each_quickly_once(LENGTHS, list(Clock), 9))
def test_a_planner_alone_wastes_no_step(tmp_path: Path, name: str, clock: Clock) -> None:
    options = {"timing": "benchmark"} if clock is Clock.REALTIME else {}
    outcome = run(finish(tmp_path, name, clock, 1, planner, **options))
    assert outcome["reason"] == "goal", outcome
    assert outcome["steps"] <= floor(1.05 * LENGTHS[name])


@pytest.mark.parametrize("name", ["synchronous/03", "asynchronous/08", "asynchronous/10"])
def test_where_walking_takes_time(tmp_path: Path, name: str) -> None:
    outcome = run(finish(tmp_path, load_task(name).name, Clock.REALTIME, 1, planner))
    assert outcome["reason"] == "goal", outcome
