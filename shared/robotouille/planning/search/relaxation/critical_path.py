"""The critical path: a lower bound on the steps of a plan that takes account of delays.

What h^max is to costs (B. Bonet, H. Geffner: Planning as heuristic search, 2001), said of time: a
rule takes place after the last of its needs. An action takes a share of a step (a whole one with
one player: with k of them, each may use what another did before it in the same step), a delay
ends with the step that its last update belongs to.
"""

from __future__ import annotations

import math
from heapq import heappop, heappush

from robotouille.planning.search.relaxation.relaxed_task import RelaxedTask, Situation

__all__ = ["critical_path"]


def critical_path(task: RelaxedTask, situation: Situation, players: int) -> float:
    """A lower bound on the number of steps to the goal; infinite if there is no way."""
    unmet = task.counts.copy()
    time = dict.fromkeys(situation.props, 0)
    queue = [(0, prop) for prop in time]
    settled = bytearray(task.size)
    while queue:
        now, prop = heappop(queue)
        if prop == task.goal:
            return math.ceil(now / players)
        if settled[prop]:
            continue
        settled[prop] = 1
        for rule in task.users[prop]:
            unmet[rule] -= 1
            if unmet[rule]:
                continue
            after = now + task.cost[rule]
            if task.timed[rule]:
                delay = situation.left.get(rule, task.delay[rule])
                after = (max(-(-now // players), 1) + delay) * players
            for added in task.adds[rule]:
                if after < time.get(added, math.inf):
                    time[added] = after
                    heappush(queue, (after, added))
    return math.inf
