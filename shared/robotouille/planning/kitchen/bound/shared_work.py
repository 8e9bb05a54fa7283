"""Work of the lower bound, shared among the players of a team."""

from __future__ import annotations

from robotouille.planning.kitchen.bound.goal_order import share_place, steps_after_adding
from robotouille.planning.kitchen.bound.scratch import Scratch
from robotouille.planning.kitchen.compact_state import GoalSpec, Kitchen
from robotouille.planning.kitchen.kernels import kernel


@kernel
def shared_work(
    kitchen: Kitchen, goal: GoalSpec, work: int, clearing: int, scratch: Scratch
) -> int:
    """Return the steps in which several players can do the work."""
    # Players do not find work for everybody until the end: each object occupies one player at a
    # time, and objects of one pile are placed one after another. So for each number of last steps,
    # the work that does not fit into them is shared by all players in the steps before.
    for o in range(kitchen.items):
        scratch.tail[o] = least_tail(kitchen, goal, o, scratch)
    vessels = vessels_at_work(kitchen, goal, scratch)
    vessel_work = 0
    for o in range(kitchen.items, kitchen.objects):
        vessel_work += scratch.work[o]
    longest = 0
    left = work
    last = 0
    while left > 0:
        longest = max(longest, last + -(-(left + scratch.turns) // kitchen.players))
        left -= clearing if last == 0 else 0
        for o in range(kitchen.items):
            if scratch.tail[o] <= last < scratch.tail[o] + scratch.work[o]:
                left -= 1
        left -= min(vessels, vessel_work)
        vessel_work -= min(vessels, vessel_work)
        last += 1
    return longest


@kernel
def least_tail(kitchen: Kitchen, goal: GoalSpec, o: int, scratch: Scratch) -> int:
    """Return the steps after the last work on an item, if those with more work come later."""
    if scratch.deliveries[o] == 0:
        return 0
    tail = steps_after_adding(goal, o)
    for other in range(kitchen.items):
        if other == o or scratch.deliveries[other] == 0 or not share_place(goal, other, o):
            continue
        more = scratch.work[other] - scratch.work[o]
        if more > 0 or (more == 0 and other < o):
            tail += 2
    return tail


@kernel
def vessels_at_work(kitchen: Kitchen, goal: GoalSpec, scratch: Scratch) -> int:
    """Return the number of meals and containers that players can work on at the same time."""
    count = 0
    for m in range(kitchen.meals):
        count += goal.wanted_meal[m]
    for c in range(kitchen.items, kitchen.objects):
        count += goal.on_table[c] if scratch.deliveries[c] else 0
    return count
