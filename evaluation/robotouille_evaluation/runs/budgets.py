"""Step budgets of a run: one rule for all its tasks with goals.

Results under different rules are not comparable, so a run never mixes them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from robotouille.errors import RobotouilleError
from robotouille_evaluation.packs.pack import Pack, PackInstance

GoalBudget = Literal["own", "published"]
"""Rule of the step budget of tasks with goals. A shift has its own length."""

LACKED = {"own": "known plan", "published": "published constant"}
MAX_NAMED = 5
"""Most tasks that a message names."""


@dataclass(frozen=True, slots=True)
class BudgetedInstances:
    """Instances that a rule gives a step budget, and those that it does not."""

    rule: GoalBudget
    instances: tuple[PackInstance, ...]
    left_out: tuple[PackInstance, ...]

    def __str__(self) -> str:
        """Return a line about the instances that are left out, or an empty text."""
        if not self.left_out:
            return ""
        tasks = list(dict.fromkeys(each.task for each in self.left_out))
        more = f" and {len(tasks) - MAX_NAMED} more" if len(tasks) > MAX_NAMED else ""
        number = len(self.left_out)
        return (
            f"{number} of {number + len(self.instances)} instances have no {LACKED[self.rule]} "
            f"and are left out: {', '.join(tasks[:MAX_NAMED])}{more}"
        )


def with_budget(
    pack: Pack, instances: Sequence[PackInstance], rule: GoalBudget | None, seats: int | None
) -> BudgetedInstances:
    """Return the instances that a rule gives a step budget. Shifts always have one.

    Args:
        rule: Rule to use; by default that of `common_rule`.
        seats: Number of players; the usual number if None.

    Raises:
        RobotouilleError: No instance has such a budget, or no rule is given and none fits all.
    """
    rule = rule or common_rule(pack, instances, seats)
    kept: list[PackInstance] = []
    left_out: list[PackInstance] = []
    for instance in instances:
        playable = pack.shift(instance) is not None or _has(pack, instance, rule, seats)
        (kept if playable else left_out).append(instance)
    if not kept and left_out:
        pack.budget(left_out[0], rule, seats=seats)  # raises the error that says what is missing
    return BudgetedInstances(rule, tuple(kept), tuple(left_out))


def common_rule(pack: Pack, instances: Iterable[PackInstance], seats: int | None) -> GoalBudget:
    """Return `own` if plans of all instances are known, and `published` if none is.

    Raises:
        RobotouilleError: Plans of some instances are known only.
    """
    goals = [each for each in instances if pack.shift(each) is None]
    unknown = sum(not _has(pack, each, "own", seats) for each in goals)
    if 0 < unknown < len(goals):
        raise RobotouilleError(
            f"{unknown} of {len(goals)} instances have no known plan, and a run has one kind of "
            "step budget: choose --budget published (the constants), or --budget own (without "
            "these instances), or find more plans with `robotouille pack prove` first"
        )
    return "published" if unknown else "own"


def _has(pack: Pack, instance: PackInstance, rule: GoalBudget, seats: int | None) -> bool:
    if rule == "own":
        return instance.best(seats) is not None
    return pack.task(instance.task).optimal is not None
