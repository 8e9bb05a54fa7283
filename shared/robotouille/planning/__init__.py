"""Planning: shortest plans with proof, plans for play, and policies that play by them.

Pure and deterministic: nothing here reads a clock, a file or a global source of randomness.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.planning.anytime import AnytimePlanner
    from robotouille.planning.plan import Plan, read_plan, write_plan
    from robotouille.planning.plugins import AnytimeSearch, DomainPlanner
    from robotouille.planning.search_result import UNLIMITED, Limits, Proof, SearchResult, Watch
    from robotouille.planning.solvers import Search, solve
    from robotouille.planning.steps_to_go import StepsLeft, StepsToGo
    from robotouille.planning.validation import PlanReport, Rejection, replay
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.planning.plan",
        "robotouille.planning.search_result",
        "robotouille.planning.validation",
        "robotouille.planning.plugins",
        "robotouille.planning.solvers",
        "robotouille.planning.anytime",
        "robotouille.planning.steps_to_go",
    )

__all__ = [
    "UNLIMITED",
    "AnytimePlanner",
    "AnytimeSearch",
    "DomainPlanner",
    "Limits",
    "Plan",
    "PlanReport",
    "Proof",
    "Rejection",
    "Search",
    "SearchResult",
    "StepsLeft",
    "StepsToGo",
    "Watch",
    "read_plan",
    "replay",
    "solve",
    "write_plan",
]
