"""The bots that are shipped, by name."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from robotouille.errors import Fault, FileError, RobotouilleError

if TYPE_CHECKING:
    from robotouille.planning.policies.policy import Policy
    from robotouille.world.world import State
    from robotouille_client.bots.seat_policy import MakePolicy

__all__ = ["BotKind", "policy_maker"]


class BotKind(StrEnum):
    """What decides: chance, a plan file, or search."""

    RANDOM = "random"
    SCRIPTED = "scripted"
    PLANNER = "planner"


def policy_maker(kind: BotKind, seed: int = 0, plan: Path | None = None) -> MakePolicy:
    """How to make the policy of a seat; RobotouilleError if a plan is needed and not there."""
    if kind is BotKind.SCRIPTED and (plan is None or not plan.is_file()):
        raise RobotouilleError(f"a scripted bot plays a plan file: --plan FILE, found {plan}")

    def make(state: State, player: str) -> Policy:
        if kind is BotKind.RANDOM:
            from robotouille.planning.policies.policy import RandomPolicy

            return RandomPolicy(player, seed)
        if kind is BotKind.SCRIPTED:
            return _scripted(state, player, plan)
        from robotouille.planning.policies.planner_policy import PlannerPolicy

        return PlannerPolicy(state.world, player, seed=seed, start=state)

    return make


def _scripted(state: State, player: str, plan: Path | None) -> Policy:
    from robotouille.planning.plan import read_plan
    from robotouille.planning.policies.script import Script
    from robotouille.world.world import World

    if plan is None:
        raise RobotouilleError("a scripted bot plays a plan file: --plan FILE")
    task = state.world.task
    rehearsal = World(type(task).from_json({**task.to_json(), "timing": "benchmark"}))
    try:
        text = plan.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(str(plan), [Fault("", f"cannot be read: {error}")]) from None
    return Script(player, read_plan(text, rehearsal, str(plan)), rehearsal.initial)
