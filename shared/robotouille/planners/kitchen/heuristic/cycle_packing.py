"""Stops that no order of the deliveries can avoid: a packing of cycles, for one player.

One player has one hand, so a delivery, once begun, is finished before the next, unless it is
interrupted by a *stop*: put down, come back, pick up, walk on. Some deliveries have to come before
others:

* what lies above is taken away before what lies below it;
* what goes below is placed before what goes on top, and the top of a pile last;
* an object leaves the only station of a class before something else is brought there;
* there is water before something is added to it, and it is poured after that;
* what is in hand is delivered before anything else.

*What is relaxed.* Everything but this order. Its graph has an edge from each delivery to those that
come after it. Deliveries on a cycle wait for one another, so at least one of them has to be
interrupted: a set of stops that suffices is a feedback vertex set. The least such set is hard to
find, but any packing of cycles without a common object is no larger. It is the bound of the blocks
world's deadlocks (Gupta and Nau 1992; Slaney and Thiébaux 2001).

*Why it is a lower bound.* No other part counts these steps: a delivery counts as one pick-up, one
walk and one putting down, however often it is interrupted. A stop on an item costs 4 steps, one on
a container perhaps 3: whoever adds something to it stands there already, and need not come back. A
cycle counts with the cheapest of its objects, and cycles that share no object share no stop.

*Which cycles.* The shortest first, the lowest numbers first among them, until none is left: more
cycles fit in if they are short. Any choice is a lower bound.

*Cost.* A breadth-first search from each of up to 63 nodes, with sets of nodes as bits of integers,
for each cycle found. Nodes that are on no cycle are stripped off before.
"""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
    NONE,
    POT,
    CompactState,
    Goal,
    Kitchen,
)
from robotouille.planners.kitchen.heuristic.scratch import Scratch
from robotouille.planners.kitchen.heuristic.vessels import is_unmade
from robotouille.planners.kitchen.kernels import kernel

__all__ = ["cycle_packing"]

MAX_PACKED_OBJECTS = 28
"""More objects than that are not looked at: two nodes for each, and one for each meal, are bits of
one integer."""

MAX_PACKED_MEALS = 6

ITEM_STOP, CONTAINER_STOP = 4, 3
"""Steps of a stop."""


# Nodes: o the first delivery of an object, objects + o its last if it has several, and
# 2 * objects + m the making of a meal.


@kernel
def last_delivery(kitchen: Kitchen, o: int, scratch: Scratch) -> int:
    """The node of the last delivery of an object."""
    return kitchen.objects + o if scratch.deliveries[o] > 1 else o


@kernel
def making_of(kitchen: Kitchen, m: int) -> int:
    """The node of the making of a meal."""
    return 2 * kitchen.objects + m


@kernel
def cycle_packing(kitchen: Kitchen, goal: Goal, state: CompactState, scratch: Scratch) -> int:
    """Steps of additional stops that are needed at least."""
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
    """What lies above goes first."""
    for o in range(kitchen.items):
        if not scratch.leaves[o] or scratch.deliveries[o] == 0:
            continue
        under = state.below[o]
        while under < kitchen.objects:
            if scratch.leaves[under] and scratch.deliveries[under] > 0:
                put_before(o, under, scratch)
            under = state.below[under]


@kernel
def order_piles_built(kitchen: Kitchen, goal: Goal, scratch: Scratch) -> None:
    """What goes below comes first; so does the lowest of a pile; its top comes last."""
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
    """Note that the last delivery of one object has to come before that of another."""
    before, after = last_delivery(kitchen, o, scratch), last_delivery(kitchen, other, scratch)
    put_before(before, after, scratch)


@kernel
def order_uses_of_stations(kitchen: Kitchen, state: CompactState, scratch: Scratch) -> None:
    """What stands on the only station of a class leaves before something else is brought there."""
    for c in range(kitchen.classes):
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
    """The only station of a class; NONE if there are several, or none."""
    only = NONE
    for station in range(kitchen.stations):
        if kitchen.station_class[station] == c:
            if only != NONE:
                return NONE
            only = station
    return only


@kernel
def order_cooking(kitchen: Kitchen, goal: Goal, state: CompactState, scratch: Scratch) -> None:
    """Nothing is added before there is water, nor after it is poured."""
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
    """The pot for the one meal there is to cook; NONE if there are several of either."""
    if scratch.pots_open:
        return NONE
    for c in range(kitchen.items, kitchen.objects):
        if kitchen.container_kind[c] == POT and scratch.deliveries[c] > 0:
            return c
    return NONE


@kernel
def order_after_hand(kitchen: Kitchen, goal: Goal, state: CompactState, scratch: Scratch) -> None:
    """What is in hand comes first."""
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
    """The steps of a stop for each of the cycles that are packed."""
    alive = 0
    for node in range(nodes):
        if scratch.before[node]:
            alive |= 1 << node
    steps = 0
    while True:
        alive = on_cycles(nodes, alive, scratch)
        if alive == 0:
            return steps
        cycle = shortest_cycle(nodes, alive, scratch)
        stop = ITEM_STOP
        for o in range(kitchen.objects):
            both = 1 << o | 1 << (kitchen.objects + o)
            if cycle & both:
                alive &= ~both
                if o >= kitchen.items:
                    stop = CONTAINER_STOP
        steps += stop


@kernel
def on_cycles(nodes: int, alive: int, scratch: Scratch) -> int:
    """The nodes that are left when those are stripped off that nothing precedes or follows."""
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
    """The nodes of a shortest cycle, as a bit set."""
    best = alive
    shortest = nodes + 1
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
    """The nodes that directly follow any of some nodes."""
    found = 0
    for node in range(nodes):
        if front >> node & 1:
            found |= scratch.before[node]
    return found


@kernel
def cycle_through(nodes: int, alive: int, start: int, length: int, scratch: Scratch) -> int:
    """The nodes of a cycle of a given length through a node."""
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
    """Whether one node leads to another in so many steps."""
    front = 1 << node
    for _ in range(steps):
        front = successors(nodes, front, scratch) & alive
    return front >> goal & 1 == 1
