"""Beside every shipped problem lies a plan for each number of seats, and it reaches the goal."""

from __future__ import annotations

import pytest

from robotouille import World, load_task, task_names
from robotouille.planning.plan import read_plan, write_plan
from robotouille.planning.validation import replay
from robotouille.resources import data_folder

CASES = [
    (name, seats)
    for name in task_names()
    for seats in (load_task(name).problem.seats or (load_task(name).seats,))
]


def plan_text(name: str, seats: int) -> str:
    folder = data_folder("problems")
    alone = folder / f"{name}.plan"
    return (alone if alone.exists() else folder / f"{name}@{seats}.plan").read_text()


@pytest.mark.parametrize(("name", "seats"), CASES)
def test_replayed_to_its_goal(name: str, seats: int) -> None:
    world = World(load_task(name, seats=seats))
    plan = read_plan(plan_text(name, seats), world)
    report = replay(plan, world)
    assert report.ok, str(report)
    assert report.final.goal_reached
    if name.startswith("multi_agent/") and seats == 2:
        assert all(plan.share(player) >= 3 for player in world.players)


@pytest.mark.parametrize(("name", "seats"), CASES[::6])
def test_text_round_trip(name: str, seats: int) -> None:
    world = World(load_task(name, seats=seats))
    plan = read_plan(plan_text(name, seats), world)
    assert read_plan(write_plan(plan, world, ["a note"]), world) == plan


def test_a_shorter_plan_that_stops_early_is_not_ok() -> None:
    world = World("synchronous/01")
    plan = read_plan(plan_text("synchronous/01_cheese_sandwich", 1), world)
    cut = type(plan)(plan.steps[:-1])
    assert not replay(cut, world).ok
    assert replay(cut, world).reached_at is None
    swapped = type(plan)((plan.steps[1], plan.steps[0], *plan.steps[2:]))
    assert replay(swapped, world).rejection is not None
