"""Policies that choose a seat's actions: at random, by a script, or with a planner."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.planning.policies.planner_policy import PlannerOptions, PlannerPolicy
    from robotouille.planning.policies.policy import Did, Policy, RandomPolicy, Script, TeamPolicy
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.planning.policies.policy",
        "robotouille.planning.policies.planner_policy",
    )

__all__ = [
    "Did",
    "PlannerOptions",
    "PlannerPolicy",
    "Policy",
    "RandomPolicy",
    "Script",
    "TeamPolicy",
]
