"""A lower bound of the steps to the goal: the heuristic of A*, and half of its proofs.

It is the larger of two bounds, each a relaxation of the kitchen.

**Work.** In a step a player walks, or does something with one object, or nothing. So steps can be
attributed to objects, each to one at most, and what objects need at least adds up: a cost
partitioning (Katz and Domshlak 2008), as in additive pattern databases (Felner, Korf and Hanan
2004), in which every object is a projection of the kitchen, and gets the whole cost of the actions
about it and of the walks before them. The parts, each with its own proof:

* `items.py`: processes and deliveries of the goal's items;
* `vessels.py`: filling, boiling, pouring and serving of its meals;
* `obstacles.py`: what lies in the way;
* `cycle_packing.py`: stops that no order of the deliveries can avoid, for one player;
* in this module: getting rid of what is in hand and of no use.

A delivery is preceded by a walk to the object, unless the last thing done there was about the same
object. Two exceptions, where one thing makes another's walk unnecessary, are taken off the sum.
Several players do one thing each in a step, so the sum is divided among them and rounded up.

**Chain.** What happens to one object happens in order, delays included, and what goes on top of it
is placed later. So no sooner than the longest such chain of events can the goal be met (a critical
path, like h-max: Bonet and Geffner 2001). Delays count here and not as work, since other work can
be done meanwhile.

The larger of two lower bounds is one. Tests compare it with the exact distances of all states that
can be reached in small kitchens. It need not be consistent: what lies in the way counts only once
something is known to leave. The search sees to that (`search/nodes.py`).
"""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
    NONE,
    POT,
    CompactState,
    Goal,
    Kitchen,
)
from robotouille.planners.kitchen.heuristic.cycle_packing import cycle_packing
from robotouille.planners.kitchen.heuristic.items import add_item_work
from robotouille.planners.kitchen.heuristic.obstacles import add_obstacles, clearing_work
from robotouille.planners.kitchen.heuristic.scratch import DEAD_END, Scratch, clear_scratch
from robotouille.planners.kitchen.heuristic.vessels import add_vessel_work
from robotouille.planners.kitchen.heuristic.walks import walk_before_put
from robotouille.planners.kitchen.kernels import kernel

__all__ = ["heuristic"]


@kernel
def heuristic(kitchen: Kitchen, goal: Goal, state: CompactState, scratch: Scratch) -> int:
    """Steps that are needed at least; DEAD_END where the goal cannot be met any more."""
    clear_scratch(kitchen, state, scratch)
    for o in range(kitchen.items):
        if goal.about[o] and not add_item_work(kitchen, goal, state, o, scratch):
            return DEAD_END
    if not add_vessel_work(kitchen, goal, state, scratch):
        return DEAD_END
    add_obstacles(kitchen, goal, state, scratch)
    work = clearing_work(kitchen, state, scratch)
    for o in range(kitchen.objects):
        work += scratch.work[o]
    chain = longest_chain(kitchen, goal, scratch)
    if work == 0:
        return chain
    if kitchen.players == 1:
        work += useless_in_hand(kitchen, state, scratch)
    work -= min(scratch.water_walks, scratch.maybe_added)
    work -= 2 * min(kitchen.players, scratch.free_hands)
    if kitchen.players > 1:
        return max(chain, -(-work // kitchen.players))
    return max(chain, work + cycle_packing(kitchen, goal, state, scratch))


@kernel
def useless_in_hand(kitchen: Kitchen, state: CompactState, scratch: Scratch) -> int:
    """What it takes to get rid of something on which no work is left: put it down, after a walk."""
    held = state.held[0] - 1
    if held < 0 or scratch.work[held] > 0:
        return 0
    if scratch.pots_open and kitchen.container_kind[held] == POT:
        return 0
    if held < kitchen.items:
        scratch.maybe_added += 1
    return 1 + walk_before_put(kitchen, state)


@kernel
def longest_chain(kitchen: Kitchen, goal: Goal, scratch: Scratch) -> int:
    """The longest chain of events, delays included."""
    longest = scratch.meal_chain
    for o in range(kitchen.objects):
        if scratch.chain[o] > 0:
            longest = max(longest, scratch.chain[o] + followers(kitchen, goal, o, scratch))
    return longest


@kernel
def followers(kitchen: Kitchen, goal: Goal, o: int, scratch: Scratch) -> int:
    """Steps that have to follow the last delivery of an object.

    What goes on top of it is placed by somebody who has to fetch it, if there is one player, or
    by somebody who takes the other's place.
    """
    if scratch.deliveries[o] == 0 or o >= kitchen.items:
        return 0
    if goal.added_to[o] != NONE:
        return 3 if goal.vessel[goal.added_to[o]] != NONE else 0
    each = 4 if kitchen.players == 1 else 2
    steps = 0
    for other in range(kitchen.items):
        if other == o or scratch.deliveries[other] == 0:
            continue
        if goes_on_later(kitchen, goal, other, o):
            steps += each
    return steps


@kernel
def goes_on_later(kitchen: Kitchen, goal: Goal, upper: int, lower: int) -> bool:
    """Whether the goal wants one item somewhere above another, so that it is placed later."""
    if goal.on_table[lower] and goal.pile[upper] == lower:
        return True
    pile = goal.pile[lower]
    is_top = goal.clear[upper] and not goal.clear[lower]
    if pile != NONE and goal.pile[upper] == pile and is_top:
        return True
    return rests_on(kitchen, goal, upper, lower)


@kernel
def rests_on(kitchen: Kitchen, goal: Goal, upper: int, lower: int) -> bool:
    """Whether the goal wants an item directly or indirectly on another, piece by piece."""
    for _ in range(kitchen.items):
        upper = goal.atop[upper]
        if upper == lower:
            return True
        if upper == NONE:
            return False
    return False
