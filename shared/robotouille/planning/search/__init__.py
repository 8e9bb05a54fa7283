"""Best-first search in any domain, on the world's own steps: A* with proof, and greedy search."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.planning.search.best_first import astar_search, greedy_search
    from robotouille.planning.search.heuristics import BLIND, CriticalPath, Heuristic, LandmarkCut
    from robotouille.planning.search.unsolvable import unreachable_goal
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.planning.search.heuristics",
        "robotouille.planning.search.best_first",
        "robotouille.planning.search.best_first",
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
