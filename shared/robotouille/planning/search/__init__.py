"""Best-first search in any domain, on the world's own steps: A* with proof, and greedy search."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.planning.search.astar import astar_search
    from robotouille.planning.search.greedy import greedy_search
    from robotouille.planning.search.heuristics import BLIND, CriticalPath, Heuristic, LandmarkCut
    from robotouille.planning.search.unsolvable import unreachable_goal
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.planning.search.heuristics",
        "robotouille.planning.search.astar",
        "robotouille.planning.search.greedy",
        "robotouille.planning.search.unsolvable",
    )

__all__ = [
    "BLIND",
    "CriticalPath",
    "Heuristic",
    "LandmarkCut",
    "astar_search",
    "greedy_search",
    "unreachable_goal",
]
