"""Dishes that a thread analyses before their first order."""

from __future__ import annotations

import pytest

from robotouille import World, load_task
from robotouille.planning.shift import DishPlanner, prepare_in_background
from robotouille.planning.solvers import AnytimePlanner

TASK, DISH = "shifts/01_sandwich_bar@2", "tomato sandwich"


def plan_of(planner: AnytimePlanner, world: World) -> str:
    found = next(planner.search(world.initial, team=world.players[1:], beam=500, choices=6))
    return str(found.plan)


@pytest.mark.slow
def test_preparation_changes_no_plan() -> None:
    world = World(load_task(TASK, timing="people"))
    fresh, prepared = (DishPlanner(world, DISH) for _ in range(2))
    prepared.prepare()
    assert plan_of(prepared.anytime, world) == plan_of(fresh.anytime, world)


@pytest.mark.slow
def test_all_dishes_are_prepared_in_the_background() -> None:
    world = World(load_task(TASK, timing="people"))
    first, second = (DishPlanner(world, DISH) for _ in range(2))
    thread = prepare_in_background([first, second])
    thread.join()
    assert first.anytime.searches == second.anytime.searches == 1
