"""Every task is finished over real sockets, under each clock, by bots that play its plan.

Time is virtual. Every recording is verified and re-simulated byte for byte.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille import State, World, load_task, task_names
from robotouille.episode import Clock
from robotouille.planning.plan import Plan, read_plan
from robotouille.planning.policies.script import Script
from robotouille.replay.recording import read_recording
from robotouille.resources import data_folder
from robotouille_client.bots import Policy
from robotouille_client.bots.seat_policy import MakePolicy
from tests.support.bot_games import finish
from tests.support.samples import each_quickly_once
from tests.support.virtual_time import run

DATASETS = ("synchronous/", "asynchronous/", "multi_agent/")
TASKS = [name for name in task_names() if name.startswith(DATASETS)]


def plan_file(name: str, seats: int) -> Path:
    """The plan that is shipped beside a problem."""
    suffix = f"@{seats}" if name.startswith("multi_agent/") else ""
    return data_folder("problems") / f"{name}{suffix}.plan"


def scripted(world: World, plan: Plan) -> MakePolicy:
    def make(state: State, player: str) -> Policy:
        return Script(player, plan, world.initial)

    return make


def check_recordings(folder: Path, *, goal: bool = True) -> None:
    """Every recording in a folder verifies and is written anew byte for byte."""
    files = list(folder.glob("*.rbt"))
    assert files
    for file in files:
        recording = read_recording(file)
        assert recording.verify().ok
        assert recording.resimulate() == recording.stream
        if goal:
            *_, (_, last) = recording.states()
            assert last.goal_reached
        file.unlink()


def test_all_thirty_tasks_are_there() -> None:
    assert [sum(t.startswith(d) for t in TASKS) for d in DATASETS] == [10, 10, 10]


@pytest.mark.parametrize(("name", "clock"), each_quickly_once(TASKS, list(Clock), 12))
def test_finished_by_bots(tmp_path: Path, name: str, clock: Clock) -> None:
    seats = load_task(name).seats
    world = World(load_task(name, seats=seats))
    plan = read_plan(plan_file(name, seats).read_text(), world)
    outcome = run(finish(tmp_path, name, clock, seats, scripted(world, plan)))
    assert outcome["reason"] == "goal", outcome
    if clock is not Clock.REALTIME and seats == 1:
        assert outcome["steps"] == len(plan)
    check_recordings(tmp_path)
