"""Find a shortest plan for one player by breadth-first search.

python examples/search/breadth_first.py [TASK]
"""

from __future__ import annotations

import sys
from collections import deque

from robotouille import GroundAction, State, World


def breadth_first(start: State) -> list[GroundAction] | None:
    (player,) = start.world.players
    queue = deque([start])
    came_from: dict[State, tuple[State, GroundAction] | None] = {start: None}
    while queue:
        state = queue.popleft()
        if state.goal_reached:
            plan = []
            while (step := came_from[state]) is not None:
                state, action = step
                plan.append(action)
            return plan[::-1]
        for action in state.actions(player):
            after = state.world.successor(state, action)
            if after not in came_from:
                came_from[after] = (state, action)
                queue.append(after)
    return None


if __name__ == "__main__":
    plan = breadth_first(World(sys.argv[1] if len(sys.argv) > 1 else "synchronous/01").initial)
    print("no plan" if plan is None else "\n".join(action.sentence for action in plan))
