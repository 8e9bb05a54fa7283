"""A* (Hart, Nilsson and Raphael 1968) over compact states, in slices.

With a weight above 1 plans come sooner and are no longer proven shortest.
"""

from __future__ import annotations

from collections.abc import Sequence

from robotouille.planners.kitchen.compact_state import Goal, Kitchen
from robotouille.planners.kitchen.kernels import kernel
from robotouille.planners.kitchen.search.nodes import (
    BEST,
    COUNT,
    CUT,
    EXPANDED,
    LOWEST_F,
    MAX_F,
    UNIT,
    UNKNOWN,
    Nodes,
    max_successors,
    pop,
)
from robotouille.planners.kitchen.search.one_player import expand_alone
from robotouille.planners.kitchen.search.team import expand_together

__all__ = ["EMPTY", "FULL", "GROW", "PAUSED", "PROVEN", "astar"]

PAUSED, GROW, PROVEN, EMPTY, FULL = range(5)
"""Why `search` returned: enough expansions, no room, no better plan exists, nothing is left, or
nothing more can be proven since some states had no room."""


@kernel
def astar(
    kitchen: Kitchen, goals: Sequence[Goal], nodes: Nodes, weight: int, expansions: int
) -> int:
    """Go on with a search for so many expansions; returns why it stopped."""
    status = nodes.status
    until = status[EXPANDED] + expansions
    while status[EXPANDED] < until:
        if status[COUNT] + max_successors(kitchen.players) > len(nodes.g):
            return GROW
        if status[CUT] < MAX_F and status[LOWEST_F] >= status[CUT]:
            return FULL
        if weight == UNIT and status[LOWEST_F] >= status[BEST]:
            return PROVEN
        node = pop(nodes)
        if node < 0:
            if status[CUT] < MAX_F:
                return FULL
            return PROVEN if status[BEST] < UNKNOWN else EMPTY
        status[EXPANDED] += 1
        if kitchen.players == 1:
            expand_alone(kitchen, goals, nodes, node, weight, False)
        else:
            expand_together(kitchen, goals, nodes, node, weight)
    return PAUSED
