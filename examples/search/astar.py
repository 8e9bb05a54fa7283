"""Find a short plan for one player by A*; the heuristic is the number of unmet goal conditions.

python examples/search/astar.py [TASK]

One action can meet several conditions, so the heuristic is not admissible and the plan is not
proven to be shortest.
"""

from __future__ import annotations

import heapq
import sys
from itertools import count

from robotouille import GroundAction, State, World


def unmet(state: State) -> int:
    return sum(not holds for _, holds in state.world.goal_terms(state))


def astar(start: State) -> list[GroundAction] | None:
    (player,) = start.world.players
    number = count()  # a tie-breaker, because states have no order
    queue = [(unmet(start), next(number), start)]
    plans: dict[State, list[GroundAction]] = {start: []}
    while queue:
        _, _, state = heapq.heappop(queue)
        plan = plans[state]
        if state.goal_reached:
            return plan
        for action in state.actions(player):
            after = state.world.successor(state, action)
            if after not in plans or len(plan) + 1 < len(plans[after]):
                plans[after] = [*plan, action]
                heapq.heappush(queue, (len(plan) + 1 + unmet(after), next(number), after))
    return None


if __name__ == "__main__":
    plan = astar(World(sys.argv[1] if len(sys.argv) > 1 else "synchronous/04").initial)
    print("no plan" if plan is None else "\n".join(action.sentence for action in plan))
