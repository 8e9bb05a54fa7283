"""Shipped plans in the form in which a client sends them."""

from __future__ import annotations

from typing import Any

from robotouille import GroundAction, World, load_task
from robotouille.installation import data_folder
from robotouille.planning.plan import read_plan

__all__ = ["Orders", "played_plan"]

Orders = list[list[tuple[int, dict[str, Any] | None]]]
"""The action of each seat for each step; None does nothing."""


def played_plan(task: str) -> tuple[World, Orders, list[list[str]]]:
    """Return a world, the actions of its shipped plan, and the fluent facts at each step.

    Each step is played in seat order, as the lockstep clock does.
    """
    world = World(load_task(task))
    state = world.initial
    orders, facts = [], [_fluents(state.fact_names(), world)]
    for joint in read_plan(_plan_of(world), world):
        acting = {str(action.player): action for action in joint}
        orders.append([(i, _wish(acting.get(p))) for i, p in enumerate(world.players)])
        state = state.step([acting[p] for p in world.players if p in acting]).state
        facts.append(_fluents(state.fact_names(), world))
    assert state.goal_reached
    return world, orders, facts


def _wish(action: GroundAction | None) -> dict[str, Any] | None:
    return None if action is None else {"name": action.name, "args": list(action.arguments)}


def _plan_of(world: World) -> str:
    task, folder = world.task, data_folder("problems")
    paths = [folder / f"{task.name}@{task.seats}.plan", folder / f"{task.name}.plan"]
    return next(path for path in paths if path.is_file()).read_text(encoding="utf-8")


def _fluents(names: Any, world: World) -> list[str]:
    """Return the sorted fluent facts, as in the state view."""
    fluents = set(world.table.fluents)
    return sorted(name for name in names if name.partition("(")[0] in fluents)
