"""The shipped bots."""

from __future__ import annotations

import re
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from robotouille.errors import Fault, FileError, RobotouilleError

if TYPE_CHECKING:
    from robotouille.planning.policies.policy import Policy
    from robotouille.world.world import State
    from robotouille_client.bots.seat_policy import MakePolicy

NAMES = (
    "Ada", "Ben", "Cleo", "Dov", "Edda", "Finn", "Gus", "Hana", "Ivo", "June", "Kai", "Lou",
    "Mika", "Nora", "Otto", "Pia",
)  # fmt: skip
"""Short given names that are easy to tell apart."""


def given_names(seed: int = 0, seat: str | None = None) -> tuple[str, ...]:
    """Return all names in order of preference, which depends on the seed and the seat."""
    number = re.search(r"\d+$", seat or "")
    first = (seed + (int(number[0]) - 1 if number else 0)) % len(NAMES)
    return (*NAMES[first:], *NAMES[:first])


class BotKind(StrEnum):
    """The kind of a bot: random, following a plan file, or planning by search."""

    RANDOM = "random"
    SCRIPTED = "scripted"
    PLANNER = "planner"


def policy_maker(kind: BotKind, seed: int = 0, plan: Path | None = None) -> MakePolicy:
    """Return a function that makes the policy of a seat.

    Raises:
        RobotouilleError: A scripted bot has no plan file.
    """
    if kind is BotKind.SCRIPTED and (plan is None or not plan.is_file()):
        raise RobotouilleError(f"a scripted bot needs a plan file: --plan FILE, found {plan}")

    def make(state: State, player: str) -> Policy:
        if kind is BotKind.RANDOM:
            from robotouille.planning.policies.policy import RandomPolicy

            return RandomPolicy(player, seed)
        if kind is BotKind.SCRIPTED:
            return _scripted(state, player, plan)
        from robotouille.planning.policies.planner_policy import PlannerOptions, PlannerPolicy

        if state.world.shift is not None:
            from robotouille.planning.policies.shift_policy import ShiftPolicy

            return ShiftPolicy(state.world, player, PlannerOptions(seed=seed))
        return PlannerPolicy(state.world, player, PlannerOptions(seed=seed), start=state)

    return make


def _scripted(state: State, player: str, plan: Path | None) -> Policy:
    from robotouille.planning.plan import read_plan
    from robotouille.planning.policies.policy import Script
    from robotouille.world.world import World

    if plan is None:
        raise RobotouilleError("a scripted bot needs a plan file: --plan FILE")
    # Plan files have one joint action for each step, so walks must take one step.
    task = state.world.task
    rehearsal = World(type(task).from_json({**task.to_json(), "timing": "benchmark"}))
    try:
        text = plan.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(str(plan), [Fault("", f"cannot be read: {error}")]) from None
    return Script(player, read_plan(text, rehearsal, str(plan)), rehearsal.initial)
