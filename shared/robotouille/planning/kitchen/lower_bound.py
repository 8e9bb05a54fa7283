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

from robotouille.planning.kitchen.compact_state import NONE, POT, CompactState, GoalSpec, Kitchen
from robotouille.planning.kitchen.cycle_packing import cycle_packing, only_station
from robotouille.planning.kitchen.item_work import (
    add_item_work,
    has_place,
    is_running_here,
    walk_with_item,
)
from robotouille.planning.kitchen.kernels import kernel
from robotouille.planning.kitchen.scratch import (
    DEAD_END,
    Scratch,
    clear_scratch,
    walk_before_put,
    walk_to,
)
from robotouille.planning.kitchen.vessel_work import add_vessel_work


@kernel
def add_obstacles(kitchen: Kitchen, goal: GoalSpec, state: CompactState, scratch: Scratch) -> None:
    """Note which objects have to be taken off others, until nothing more follows."""
    # An obstacle that leaves can have another obstacle on top, hence the loop to a fixed point.
    changed = True
    while changed:
        changed = False
        for o in range(kitchen.items):
            under = state.below[o]
            if scratch.leaves[o] or under >= kitchen.table_code:
                continue
            is_on_object = under < kitchen.objects
            if is_on_object and scratch.leaves[under] + scratch.works_here[under] > 0:
                remove(kitchen, goal, state, o, scratch)
                changed = True
            elif is_on_object and must_be_clear(kitchen, goal, under, o, scratch):
                # The plan may end with this object in hand, so its put down is subtracted later.
                scratch.free_hands += 0 if has_place(goal, o) else 1
                remove(kitchen, goal, state, o, scratch)
                changed = True
            elif is_top_too_soon(kitchen, goal, o, scratch):
                remove(kitchen, goal, state, o, scratch)
                changed = True
        for o in range(kitchen.items):
            on_table = state.below[o] == kitchen.table_code
            if on_table and not scratch.leaves[o] and is_top_too_soon(kitchen, goal, o, scratch):
                remove(kitchen, goal, state, o, scratch)
                changed = True


@kernel
def remove(kitchen: Kitchen, goal: GoalSpec, state: CompactState, o: int, scratch: Scratch) -> None:
    """Note that an object has to leave its place although no other part counted it."""
    scratch.leaves[o] = 1
    if scratch.deliveries[o] > 0:
        return
    walk = 0 if scratch.works_here[o] else walk_to(kitchen, state, o, scratch)
    work = 3 + walk
    # An object outside the goal may end up in a pot instead of on a table.
    if not goal.about[o]:
        scratch.maybe_added += 1
    elif kitchen.players == 1 and has_place(goal, o):
        # An object that already is at its final place has to come back. A single player puts it
        # down elsewhere in the meantime; in a team another player may hold it.
        scratch.deliveries[o] = 2
        work += 4
    else:
        scratch.deliveries[o] = 1
    scratch.work[o] += work
    if has_place(goal, o) and scratch.chain[o] == 0:
        scratch.chain[o] = work


@kernel
def must_be_clear(
    kitchen: Kitchen, goal: GoalSpec, under: int, upper: int, scratch: Scratch
) -> bool:
    """Return whether the goal wants nothing on an item, or something other than `upper`."""
    if goal.clear[under]:
        return True
    for o in range(kitchen.items):
        if o != upper and goal.atop[o] == under and scratch.deliveries[o] > 0:
            return True
    return False


@kernel
def is_top_too_soon(kitchen: Kitchen, goal: GoalSpec, o: int, scratch: Scratch) -> bool:
    """Return whether the top of a pile is in place while something below is missing."""
    if not goal.clear[o] or goal.pile[o] == NONE:
        return False
    for other in range(kitchen.items):
        if other != o and goal.pile[other] == goal.pile[o] and scratch.deliveries[other] > 0:
            return True
    return scratch.deliveries[goal.pile[o]] > 0


@kernel
def clearing_work(kitchen: Kitchen, state: CompactState, scratch: Scratch) -> int:
    """Return the work to clear stations that are needed but blocked by objects that would stay."""
    needed = 0
    for o in range(kitchen.objects):
        needed |= scratch.stops[o]
    work = 0
    for c in range(kitchen.classes):
        if not needed >> c & 1:
            continue
        # The minimum over the stations of a class, since any of them serves.
        least = DEAD_END
        for station in range(kitchen.stations):
            if kitchen.station_class[station] == c:
                least = min(least, clearing_work_of(kitchen, state, station, scratch))
        if least == DEAD_END:
            return DEAD_END
        work += least
    return work


@kernel
def clearing_work_of(kitchen: Kitchen, state: CompactState, station: int, scratch: Scratch) -> int:
    """Return the work to clear a station, without the objects that leave it anyway."""
    lowest = NONE
    for o in range(kitchen.objects):
        if state.below[o] == kitchen.objects + station:
            lowest = o
    if lowest == NONE or scratch.leaves[lowest]:
        return 0
    work = 0
    o = lowest
    while o != NONE:
        if not scratch.leaves[o]:
            work += 3
            if scratch.works_here[o] == 0:
                work += walk_to(kitchen, state, o, scratch)
            scratch.maybe_added += 1
        o = scratch.above[o]
    return work


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
    clear_scratch(kitchen, state, scratch)
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
        return max(chain, shared_work(kitchen, goal, work, clearing, turns, scratch))
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


@kernel
def longest_chain(kitchen: Kitchen, goal: GoalSpec, scratch: Scratch) -> int:
    """Return the longest chain of events, delays included."""
    longest = scratch.meal_chain
    for o in range(kitchen.objects):
        if scratch.chain[o] > 0:
            longest = max(longest, scratch.chain[o] + followers(kitchen, goal, o, scratch))
    return longest


@kernel
def longest_queue(kitchen: Kitchen, goal: GoalSpec, state: CompactState, scratch: Scratch) -> int:
    """Return the longest chain if items have to take turns at the only station of a class."""
    longest = 0
    for c in range(kitchen.classes):
        station = only_station(kitchen, c)
        soonest, stays, count = DEAD_END, 0, 0
        for o in range(kitchen.items):
            if is_queued(kitchen, goal, state, o, c, station, scratch):
                soonest = min(soonest, arrival(kitchen, goal, state, o, scratch))
                stays += scratch.stay[o]
                count += 1
        if count < 2:
            continue
        # Between two items, one is taken away, its player leaves, and the next one is put down.
        done = soonest + stays + 3 * (count - 1)
        # Any of the items may be the last one.
        least = DEAD_END
        for o in range(kitchen.items):
            if is_queued(kitchen, goal, state, o, c, station, scratch):
                alone = scratch.chain[o]
                delay = done - arrival(kitchen, goal, state, o, scratch) - scratch.stay[o]
                scratch.chain[o] += max(0, delay)
                least = min(least, longest_chain(kitchen, goal, scratch))
                scratch.chain[o] = alone
        longest = max(longest, least)
    return longest


@kernel
def is_queued(
    kitchen: Kitchen,
    goal: GoalSpec,
    state: CompactState,
    o: int,
    c: int,
    station: int,
    scratch: Scratch,
) -> bool:
    """Return whether an item needs the only station of a class now or at its first stop."""
    if station == NONE:
        return False
    if state.below[o] == kitchen.objects + station:
        return is_at_work(kitchen, goal, state, o, scratch)
    if scratch.first_stop[o] != c or scratch.deliveries[o] == 0:
        return False
    return not is_at_work(kitchen, goal, state, o, scratch)


@kernel
def is_at_work(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, o: int, scratch: Scratch
) -> bool:
    """Return whether a process is possible or runs on an item at its place."""
    return scratch.works_here[o] > 0 or is_running_here(kitchen, goal, state, o)


@kernel
def arrival(kitchen: Kitchen, goal: GoalSpec, state: CompactState, o: int, scratch: Scratch) -> int:
    """Return the steps until a queued item is at its station and a player can work on it."""
    if is_at_work(kitchen, goal, state, o, scratch):
        return walk_to(kitchen, state, o, scratch) if scratch.works_here[o] else 0
    if state.below[o] >= kitchen.hand_code:
        return 1 + walk_with_item(kitchen, goal, state, o, scratch)
    return 3 + walk_to(kitchen, state, o, scratch)


@kernel
def followers(kitchen: Kitchen, goal: GoalSpec, o: int, scratch: Scratch) -> int:
    """Return the steps that have to follow the earliest time of an object's last delivery.

    Other objects that are brought to the same place need time, too, if they come later or cannot
    come sooner: a relaxation to one machine with release times (Carlier 1982).
    """
    if scratch.deliveries[o] == 0 or o >= kitchen.items:
        return 0
    steps = 0
    for other in range(kitchen.items):
        if other == o or scratch.deliveries[other] == 0:
            continue
        if goes_on_later(kitchen, goal, other, o) or (
            share_place(goal, other, o) and scratch.chain[other] >= scratch.chain[o]
        ):
            steps += steps_between(kitchen)
    return steps + steps_after_adding(goal, o)


@kernel
def steps_between(kitchen: Kitchen) -> int:
    """Return the steps from one delivery to the next one at the same place."""
    # A single player has to fetch the next object. In a team another player may hold it, and only
    # has to walk to the place after the first player has left.
    return 4 if kitchen.players == 1 else 2


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
def shared_work(
    kitchen: Kitchen, goal: GoalSpec, work: int, clearing: int, turns: int, scratch: Scratch
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
        longest = max(longest, last + -(-(left + turns) // kitchen.players))
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
