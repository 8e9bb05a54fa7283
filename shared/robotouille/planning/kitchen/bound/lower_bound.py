"""Admissible heuristic of A* for kitchens: the larger of two lower bounds, work and chain.

A worked example. One cook stands at the bread. Cheese lies on the only board, and lettuce under a
tomato on the second table. Two tables are free. Cutting takes two performances. The goal is the
lettuce, cut and on the bread, and the cheese on the lettuce.

    board1    table2     table3     table4    table5
    cheese    bread      tomato     -         -
              (cook)     lettuce

*Items.* The bread is in place: 0. The lettuce has a stop at the board and then has to get onto the
bread: two deliveries of 3 steps, 2 cuts and a walk, 9. The cheese is not in place: one delivery and
a walk, 4.

*Obstacles.* The lettuce leaves, so the tomato on it has to go first: a delivery and a walk, 4. The
board is taken, but the cheese leaves anyway: 0.

*Cycles.* The cheese leaves the only board before the lettuce gets there. The lettuce gets there
before it gets onto the bread, and onto the bread before the cheese gets onto it. So the cheese's
only delivery and the lettuce's two are on a cycle, and a stop interrupts one of them: 4.

*Work* is 0 + 9 + 4 + 4 + 4 = 21.

*Chain.* The lettuce needs 6 + 2 + 1 = 9 steps. Then a player has to fetch and place the cheese: 4
more, 13. The cheese's own chain is 4.

The heuristic is max(21, 13) = 21, and the shortest plan has 21 steps: cheese to table4 (4), tomato
to table5 (4), lettuce to the board (4), two cuts (2), lettuce onto the bread (3), cheese onto the
lettuce (4).

With two cooks the sum would contain no stop (the other cook may hold the cheese) and would be
shared: 17 / 2, rounded up to 9. The chain, with 2 steps instead of 4 to place the cheese, would be
larger: 11.
"""

from __future__ import annotations

from robotouille.planning.kitchen.bound.chains import longest_chain, longest_queue
from robotouille.planning.kitchen.bound.cycle_packing import cycle_packing
from robotouille.planning.kitchen.bound.item_work import add_item_work
from robotouille.planning.kitchen.bound.obstacles import add_obstacles, clearing_work
from robotouille.planning.kitchen.bound.scratch import (
    DEAD_END,
    Scratch,
    clear_scratch,
    walk_before_put,
)
from robotouille.planning.kitchen.bound.shared_work import shared_work
from robotouille.planning.kitchen.bound.vessel_work import add_vessel_work
from robotouille.planning.kitchen.compact_state import POT, CompactState, GoalSpec, Kitchen
from robotouille.planning.kitchen.kernels import kernel


# Work. In a step a player walks, deals with one object, or does nothing. So each step belongs to at
# most one object, and the objects' lower bounds add up. This is a cost partitioning (Katz and
# Domshlak 2008), as in additive pattern databases (Felner, Korf and Hanan 2004). An object gets the
# whole cost of its actions and of the walks before them. The walk to an object is not needed if the
# last action there was about the same object; two other cases without it are subtracted. Players
# act in parallel, so the sum is divided among them and rounded up.
#
# Chain. The events of one object happen in order, delays included, and the objects on top of it are
# placed later. The goal is not met before the longest such chain ends: a critical path, like h-max
# (Bonet and Geffner 2001). Objects that share a place take turns there, as on one machine of a job
# shop. Delays count here and not as work, since players do other work in the meantime.
#
# Tests compare the heuristic with the exact distances of all reachable states of small kitchens. It
# is not consistent: an obstacle counts only once some object has to leave. The search
# compensates with pathmax (`nodes.insert`).
@kernel
def heuristic(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, scratch: Scratch, turns: int
) -> int:
    """Return a lower bound of the steps left, or DEAD_END if the goal cannot be met any more.

    `turns` players of a team have acted in the first of these steps.
    """
    clear_scratch(kitchen, state, turns, scratch)
    for o in range(kitchen.items):
        if goal.about[o] and not add_item_work(kitchen, goal, state, o, scratch):
            return DEAD_END
    if not add_vessel_work(kitchen, goal, state, scratch):
        return DEAD_END
    add_obstacles(kitchen, goal, state, scratch)
    clearing = clearing_work(kitchen, state, scratch)
    work = clearing
    for o in range(kitchen.objects):
        work += scratch.work[o]
    chain = longest_chain(kitchen, goal, scratch)
    # Only delays are left: no player has to act.
    if work == 0:
        return chain
    if kitchen.players == 1:
        work += useless_in_hand(kitchen, state, scratch)
    # A player who adds an item already stands at the pot.
    work -= min(scratch.water_walks, scratch.maybe_added)
    # Each player may end the plan with one object in hand, which saves a walk and a put.
    work -= 2 * min(kitchen.players, scratch.free_hands)
    # Cycles give no bound for teams: another player's hand can hold an object without a stop.
    if kitchen.players > 1:
        chain = max(chain, longest_queue(kitchen, goal, state, scratch))
        return max(chain, shared_work(kitchen, goal, work, clearing, scratch))
    return max(chain, work + cycle_packing(kitchen, goal, state, scratch))


@kernel
def useless_in_hand(kitchen: Kitchen, state: CompactState, scratch: Scratch) -> int:
    """Return the work to get rid of a held object without further work: a walk and a put."""
    held = state.held[0] - 1
    if held < 0 or scratch.work[held] > 0:
        return 0
    # It may be the pot for a meal.
    if scratch.pots_open and kitchen.container_kind[held] == POT:
        return 0
    if held < kitchen.items:
        scratch.maybe_added += 1
    return 1 + walk_before_put(kitchen, state)
