"""Shortest plans with proof, plans for play, and policies that follow them.

The package is pure and deterministic: it reads no clock, file or global random generator.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.planning.plan import (
        UNLIMITED,
        Limits,
        Plan,
        PlanReport,
        Proof,
        Rejection,
        SearchResult,
        Watch,
        read_plan,
        replay,
        write_plan,
    )
    from robotouille.planning.plugins import AnytimeSearch, DomainPlanner
    from robotouille.planning.solvers import AnytimePlanner, Search, solve
    from robotouille.planning.steps_to_go import StepsLeft, StepsToGo
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.planning.plan",
        "robotouille.planning.plugins",
        "robotouille.planning.solvers",
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
