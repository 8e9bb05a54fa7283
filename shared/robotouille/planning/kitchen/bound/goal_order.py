"""Order in which the goal makes players place and add items."""

from __future__ import annotations

from robotouille.planning.kitchen.compact_state import NONE, GoalSpec, Kitchen
from robotouille.planning.kitchen.kernels import kernel


@kernel
def steps_after_adding(goal: GoalSpec, o: int) -> int:
    """Return the steps that follow when the last item was added to a meal."""
    # The meal has to be poured: pick up, walk, pour.
    meal = goal.added_to[o]
    return 3 if meal != NONE and goal.vessel[meal] != NONE else 0


@kernel
def share_place(goal: GoalSpec, o: int, other: int) -> bool:
    """Return whether the goal wants two items in the same pile or meal."""
    if goal.added_to[o] != NONE:
        return goal.added_to[o] == goal.added_to[other]
    return goal.pile[o] != NONE and goal.pile[o] == goal.pile[other]


@kernel
def goes_on_later(kitchen: Kitchen, goal: GoalSpec, upper: int, lower: int) -> bool:
    """Return whether the goal wants one item above another, so that it is placed later."""
    if goal.on_table[lower] and goal.pile[upper] == lower:
        return True
    pile = goal.pile[lower]
    is_top = goal.clear[upper] and not goal.clear[lower]
    if pile != NONE and goal.pile[upper] == pile and is_top:
        return True
    return rests_on(kitchen, goal, upper, lower)


@kernel
def rests_on(kitchen: Kitchen, goal: GoalSpec, upper: int, lower: int) -> bool:
    """Return whether the goal wants an item on another one, directly or through others."""
    for _ in range(kitchen.items):
        upper = goal.atop[upper]
        if upper == lower:
            return True
        if upper == NONE:
            return False
    return False
