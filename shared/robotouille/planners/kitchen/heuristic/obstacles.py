"""What lies in the way: objects that have to leave their place though nothing needs them elsewhere.

*What is relaxed.* As for items, each object is alone. It has to leave its place if

* what is below it has to leave too, or is to be worked on;
* the goal wants nothing on what is below it, or something else;
* it is the top of a pile, in place, while something that goes below it is not;
* it stands on a station that something has to be brought to, and there is no other of the class.

That takes 3 steps, and 1 to walk to it. If it lies where it belongs, one player has to bring it
back from wherever it lay meanwhile: 4 more.

*Why it is a lower bound.* Each such object is picked up, walked with and put down, and these steps
are about it alone. Of a class with several stations only the one that is cleared with least
counts. Two things that cost less are taken off again by the caller: what is in the way may be
added to a pot, and is then not put down on a place of its own (`Scratch.maybe_added`); and what was
only taken off something may stay in a hand (`Scratch.free_hands`).

The sets are the least fixed point of these rules, as in a relaxed reachability analysis: an object
that leaves can only make more leave.

*Cost.* At most as many rounds as a pile is high, each a loop over items.
"""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
    NONE,
    CompactState,
    Goal,
    Kitchen,
)
from robotouille.planners.kitchen.heuristic.items import has_place
from robotouille.planners.kitchen.heuristic.scratch import DEAD_END, Scratch
from robotouille.planners.kitchen.heuristic.walks import walk_to
from robotouille.planners.kitchen.kernels import kernel

__all__ = ["add_obstacles", "clearing_work"]


@kernel
def add_obstacles(kitchen: Kitchen, goal: Goal, state: CompactState, scratch: Scratch) -> None:
    """Note what has to be taken off what, until nothing more follows from it."""
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
def remove(kitchen: Kitchen, goal: Goal, state: CompactState, o: int, scratch: Scratch) -> None:
    """An object has to leave its place, where nothing else would have made it leave.

    If that is where it belongs it has to come back, and with one player to lie elsewhere meanwhile.
    """
    scratch.leaves[o] = 1
    if scratch.deliveries[o] > 0:
        return
    walk = 0 if scratch.works_here[o] else walk_to(kitchen, state, o, scratch)
    work = 3 + walk
    if not goal.about[o]:
        scratch.maybe_added += 1
    elif kitchen.players == 1 and has_place(goal, o):
        scratch.deliveries[o] = 2
        work += 4
    else:
        scratch.deliveries[o] = 1
    scratch.work[o] += work
    if has_place(goal, o) and scratch.chain[o] == 0:
        scratch.chain[o] = work


@kernel
def must_be_clear(kitchen: Kitchen, goal: Goal, under: int, upper: int, scratch: Scratch) -> bool:
    """Whether the goal wants nothing on an item, or something else than what is there."""
    if goal.clear[under]:
        return True
    for o in range(kitchen.items):
        if o != upper and goal.atop[o] == under and scratch.deliveries[o] > 0:
            return True
    return False


@kernel
def is_top_too_soon(kitchen: Kitchen, goal: Goal, o: int, scratch: Scratch) -> bool:
    """Whether the top of a pile is in place while something that goes below it is not."""
    if not goal.clear[o] or goal.pile[o] == NONE:
        return False
    for other in range(kitchen.items):
        if other != o and goal.pile[other] == goal.pile[o] and scratch.deliveries[other] > 0:
            return True
    return scratch.deliveries[goal.pile[o]] > 0


@kernel
def clearing_work(kitchen: Kitchen, state: CompactState, scratch: Scratch) -> int:
    """The work of clearing stations that are needed and taken by what would stay there."""
    needed = 0
    for o in range(kitchen.objects):
        needed |= scratch.stops[o]
    work = 0
    for c in range(kitchen.classes):
        if not needed >> c & 1:
            continue
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
    """The work of clearing a station, besides that of what leaves it anyway."""
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
