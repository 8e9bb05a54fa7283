"""The critical path: a lower bound on the steps of a plan that takes account of delays.

What h^max is to costs (B. Bonet, H. Geffner: Planning as heuristic search, 2001), said of time: a
operator takes place after the last of its preconditions. An action takes a share of a step (a
whole one with one player: with k of them, each may use what another did before it in the same
step), a delay ends with the step that its last update belongs to.
"""

from __future__ import annotations

import math
from heapq import heappop, heappush

from robotouille.planning.search.relaxation.relaxed_task import RelaxedState, RelaxedTask

__all__ = ["critical_path"]


def critical_path(task: RelaxedTask, relaxed_state: RelaxedState, players: int) -> float:
    """A lower bound on the number of steps to the goal; infinite if there is no way."""
    unmet = task.counts.copy()
    time = dict.fromkeys(relaxed_state.props, 0)
    queue = [(0, prop) for prop in time]
    settled = bytearray(task.size)
    while queue:
        now, prop = heappop(queue)
        if prop == task.goal:
            return math.ceil(now / players)
        if settled[prop]:
            continue
        settled[prop] = 1
        for operator in task.precondition_of[prop]:
            unmet[operator] -= 1
            if unmet[operator]:
                continue
            after = now + task.cost[operator]
            if task.timed[operator]:
                delay = relaxed_state.left.get(operator, task.delay[operator])
                after = (max(-(-now // players), 1) + delay) * players
            for added in task.add_effects[operator]:
                if after < time.get(added, math.inf):
                    time[added] = after
                    heappush(queue, (after, added))
    return math.inf
