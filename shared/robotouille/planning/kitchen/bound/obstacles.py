"""Work of the lower bound to move objects that are in the way of others."""

from __future__ import annotations

from robotouille.planning.kitchen.applicable import is_empty
from robotouille.planning.kitchen.bound.item_work import has_place
from robotouille.planning.kitchen.bound.scratch import DEAD_END, Scratch, walk_to
from robotouille.planning.kitchen.compact_state import NONE, POT, CompactState, GoalSpec, Kitchen
from robotouille.planning.kitchen.kernels import kernel


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
                walk = walk_to(kitchen, state, o, scratch)
                work += walk
                # A player who adds something to a pot stands there already.
                scratch.water_walks += walk if has_water(kitchen, state, o) else 0
            scratch.maybe_added += 1
        o = scratch.above[o]
    return work


@kernel
def has_water(kitchen: Kitchen, state: CompactState, o: int) -> bool:
    """Return whether an object is a pot with a meal, to which items can be added."""
    return kitchen.container_kind[o] == POT and not is_empty(kitchen, state, o)
