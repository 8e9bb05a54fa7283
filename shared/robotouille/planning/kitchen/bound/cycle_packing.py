"""Stops that no order of the deliveries can avoid: a packing of cycles, for one player.

One player has one hand. So a delivery ends before the next one begins, unless it is interrupted by
a *stop*: put down, come back, pick up, walk on. Some deliveries have to come before others:

* objects above are taken away before the objects below;
* objects below are placed before the objects above, and the top of a pile last;
* an object leaves the only station of a class before another one is brought there;
* water comes before the items that are added to it, and pouring after them;
* a held object is delivered before anything else.

The relaxation keeps only this order. Its graph has an edge from each delivery to the later ones.
Deliveries on a cycle wait for one another, so at least one of them is interrupted: a sufficient set
of stops is a feedback vertex set. The smallest set is hard to find, but no packing of cycles
without a common object exceeds it. The same bound applies to deadlocks of the blocks world (Gupta
and Nau 1992; Slaney and Thiébaux 2001).

No other part of the heuristic counts these steps: a delivery counts as one pick-up, one walk and
one put, however often it is interrupted.
"""

from __future__ import annotations

from robotouille.planning.kitchen.bound.scratch import Scratch
from robotouille.planning.kitchen.bound.vessel_work import is_unmade
from robotouille.planning.kitchen.compact_state import NONE, POT, CompactState, GoalSpec, Kitchen
from robotouille.planning.kitchen.kernels import kernel

# The graph has two nodes for each object and one for each meal, which are bits of one integer.
# Larger kitchens do without this part, which stays a lower bound.
MAX_PACKED_OBJECTS = 28

MAX_PACKED_MEALS = 6

# An interrupted item costs put down, walk back, pick up and walk on. A container may cost one step
# less: a player who adds something to it stands there already.
ITEM_STOP, CONTAINER_STOP = 4, 3
"""Steps of a stop."""


# Nodes: o is the first delivery of an object, objects + o its last one if it has several, and
# 2 * objects + m the making of a meal. Every order concerns one of them.


@kernel
def last_delivery(kitchen: Kitchen, o: int, scratch: Scratch) -> int:
    """Return the node of an object's last delivery."""
    return kitchen.objects + o if scratch.deliveries[o] > 1 else o


@kernel
def making_of(kitchen: Kitchen, m: int) -> int:
    """Return the node of the making of a meal."""
    return 2 * kitchen.objects + m


@kernel
def cycle_packing(kitchen: Kitchen, goal: GoalSpec, state: CompactState, scratch: Scratch) -> int:
    """Return a lower bound of the steps of additional stops."""
    if kitchen.objects > MAX_PACKED_OBJECTS or kitchen.meals > MAX_PACKED_MEALS:
        return 0
    nodes = 2 * kitchen.objects + kitchen.meals
    for node in range(nodes):
        scratch.before[node] = 0
    for o in range(kitchen.objects):
        if scratch.deliveries[o] > 1:
            put_before(o, last_delivery(kitchen, o, scratch), scratch)
    order_piles_taken_apart(kitchen, state, scratch)
    order_piles_built(kitchen, goal, scratch)
    order_uses_of_stations(kitchen, state, scratch)
    order_cooking(kitchen, goal, state, scratch)
    order_after_hand(kitchen, goal, state, scratch)
    return packed_stops(kitchen, nodes, scratch)


@kernel
def put_before(node: int, other: int, scratch: Scratch) -> None:
    """Note that one node has to come before another."""
    scratch.before[node] |= 1 << other


# The order of deliveries


@kernel
def order_piles_taken_apart(kitchen: Kitchen, state: CompactState, scratch: Scratch) -> None:
    """Order objects above before objects below."""
    for o in range(kitchen.items):
        if not scratch.leaves[o] or scratch.deliveries[o] == 0:
            continue
        under = state.below[o]
        while under < kitchen.objects:
            if scratch.leaves[under] and scratch.deliveries[under] > 0:
                put_before(o, under, scratch)
            under = state.below[under]


@kernel
def order_piles_built(kitchen: Kitchen, goal: GoalSpec, scratch: Scratch) -> None:
    """Order objects of a goal's pile from the lowest to the top."""
    for o in range(kitchen.items):
        if scratch.deliveries[o] == 0:
            continue
        under, lowest = goal.atop[o], goal.pile[o]
        if under != NONE and scratch.deliveries[under] > 0:
            put_last_before_last(kitchen, under, o, scratch)
        if lowest == NONE:
            continue
        if scratch.deliveries[lowest] > 0:
            put_last_before_last(kitchen, lowest, o, scratch)
        if goal.clear[o]:
            for other in range(kitchen.items):
                is_of_pile = other != o and goal.pile[other] == lowest
                if is_of_pile and scratch.deliveries[other] > 0:
                    put_last_before_last(kitchen, other, o, scratch)


@kernel
def put_last_before_last(kitchen: Kitchen, o: int, other: int, scratch: Scratch) -> None:
    """Order the last delivery of one object before that of another."""
    before, after = last_delivery(kitchen, o, scratch), last_delivery(kitchen, other, scratch)
    put_before(before, after, scratch)


@kernel
def order_uses_of_stations(kitchen: Kitchen, state: CompactState, scratch: Scratch) -> None:
    """Order the object on the only station of a class before the objects brought there."""
    for c in range(kitchen.classes):
        # With several stations of a class, another one may be free.
        station = only_station(kitchen, c)
        if station == NONE:
            continue
        lowest = NONE
        for o in range(kitchen.objects):
            if state.below[o] == kitchen.objects + station:
                lowest = o
        if lowest == NONE or not scratch.leaves[lowest] or scratch.deliveries[lowest] == 0:
            continue
        for o in range(kitchen.objects):
            if o != lowest and scratch.stops[o] >> c & 1:
                is_first = scratch.first_stop[o] == c
                put_before(lowest, o if is_first else last_delivery(kitchen, o, scratch), scratch)


@kernel
def only_station(kitchen: Kitchen, c: int) -> int:
    """Return the only station of a class, or NONE if there are several or none."""
    only = NONE
    for station in range(kitchen.stations):
        if kitchen.station_class[station] == c:
            if only != NONE:
                return NONE
            only = station
    return only


@kernel
def order_cooking(kitchen: Kitchen, goal: GoalSpec, state: CompactState, scratch: Scratch) -> None:
    """Order filling before adding, and adding before pouring."""
    for m in range(kitchen.meals):
        if not goal.wanted_meal[m]:
            continue
        making = making_of(kitchen, m)
        missing = is_unmade(kitchen, goal, state, m)
        pot = only_pot(kitchen, scratch)
        if pot != NONE and missing and scratch.first_stop[pot] == kitchen.sink_class:
            put_before(pot, making, scratch)
        for o in range(kitchen.items):
            if goal.added_to[o] != m or scratch.deliveries[o] == 0:
                continue
            if missing:
                put_before(making, last_delivery(kitchen, o, scratch), scratch)
            if pot != NONE and goal.vessel[m] != NONE:
                put_last_before_last(kitchen, o, pot, scratch)


@kernel
def only_pot(kitchen: Kitchen, scratch: Scratch) -> int:
    """Return the pot of the only meal to cook, or NONE if it is not determined."""
    if scratch.pots_open:
        return NONE
    for c in range(kitchen.items, kitchen.objects):
        if kitchen.container_kind[c] == POT and scratch.deliveries[c] > 0:
            return c
    return NONE


@kernel
def order_after_hand(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, scratch: Scratch
) -> None:
    """Order the held object before everything else."""
    held = state.held[0] - 1
    if held < 0 or scratch.deliveries[held] == 0:
        return
    for o in range(kitchen.objects):
        if o != held and scratch.deliveries[o] > 0:
            put_before(held, o, scratch)
            put_before(held, last_delivery(kitchen, o, scratch), scratch)
    for m in range(kitchen.meals):
        if is_unmade(kitchen, goal, state, m):
            put_before(held, making_of(kitchen, m), scratch)


# Cycles


@kernel
def packed_stops(kitchen: Kitchen, nodes: int, scratch: Scratch) -> int:
    """Return the steps of one stop for each packed cycle."""
    alive = 0
    for node in range(nodes):
        if scratch.before[node]:
            alive |= 1 << node
    steps = 0
    while True:
        alive = on_cycles(nodes, alive, scratch)
        if alive == 0:
            return steps
        # Short cycles leave room for more cycles. Any choice is a lower bound.
        cycle = shortest_cycle(nodes, alive, scratch)
        stop = ITEM_STOP
        for o in range(kitchen.objects):
            # Cycles that share an object could share a stop, so both nodes of each object are
            # removed.
            both = 1 << o | 1 << (kitchen.objects + o)
            if cycle & both:
                alive &= ~both
                if o >= kitchen.items:
                    # The stop may be on any object of the cycle, so the cheapest one counts.
                    stop = CONTAINER_STOP
        steps += stop


@kernel
def on_cycles(nodes: int, alive: int, scratch: Scratch) -> int:
    """Return the nodes that are left after removing those without predecessor or successor."""
    # Most states have no cycle at all. This test is much cheaper than the searches for cycles.
    changed = True
    while changed:
        changed = False
        reached = 0
        for node in range(nodes):
            if alive >> node & 1:
                if scratch.before[node] & alive == 0:
                    alive &= ~(1 << node)
                    changed = True
                else:
                    reached |= scratch.before[node]
        if alive & ~reached:
            alive &= reached
            changed = True
    return alive


@kernel
def shortest_cycle(nodes: int, alive: int, scratch: Scratch) -> int:
    """Return the nodes of a shortest cycle as a bit set."""
    best = alive
    shortest = nodes + 1
    # Breadth-first search with bit sets. The lowest numbers win, so results are deterministic.
    for start in range(nodes):
        if not alive >> start & 1:
            continue
        length = 1
        front = scratch.before[start] & alive
        seen = front
        while front and not front >> start & 1 and length < shortest:
            front = successors(nodes, front, scratch) & alive & ~seen
            seen |= front
            length += 1
        if front >> start & 1 and length < shortest:
            shortest = length
            best = cycle_through(nodes, alive, start, length, scratch)
    return best


@kernel
def successors(nodes: int, front: int, scratch: Scratch) -> int:
    """Return the direct successors of a set of nodes."""
    found = 0
    for node in range(nodes):
        if front >> node & 1:
            found |= scratch.before[node]
    return found


@kernel
def cycle_through(nodes: int, alive: int, start: int, length: int, scratch: Scratch) -> int:
    """Return the nodes of a cycle of a given length through a node."""
    cycle = 1 << start
    node = start
    for left in range(length - 1, 0, -1):
        for after in range(nodes):
            is_next = scratch.before[node] & alive & ~cycle & (1 << after)
            if is_next and leads_to(nodes, alive, after, start, left, scratch):
                cycle |= 1 << after
                node = after
                break
    return cycle


@kernel
def leads_to(nodes: int, alive: int, node: int, goal: int, steps: int, scratch: Scratch) -> bool:
    """Return whether one node leads to another in a number of steps."""
    front = 1 << node
    for _ in range(steps):
        front = successors(nodes, front, scratch) & alive
    return front >> goal & 1 == 1
