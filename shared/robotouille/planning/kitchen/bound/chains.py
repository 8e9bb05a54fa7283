"""Chain of the lower bound: events that have to happen one after another, delays included."""

from __future__ import annotations

from robotouille.planning.kitchen.bound.cycle_packing import only_station
from robotouille.planning.kitchen.bound.goal_order import (
    goes_on_later,
    share_place,
    steps_after_adding,
)
from robotouille.planning.kitchen.bound.item_work import is_running_here, walk_with_item
from robotouille.planning.kitchen.bound.scratch import DEAD_END, Scratch, walk_to
from robotouille.planning.kitchen.compact_state import NONE, CompactState, GoalSpec, Kitchen
from robotouille.planning.kitchen.kernels import kernel


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
