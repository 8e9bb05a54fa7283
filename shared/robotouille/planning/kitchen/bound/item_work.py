"""The heuristic's work on items of the goal: a sum over processes and deliveries.

The relaxation considers each item alone. Nothing is in its way and every station is free. The
remaining work on the item is:

* for each wanted process that is not done, its performances, or 1 to start its delay (0 if it was
  started and interrupted: it continues when the item is put back);
* a *delivery* for each class of stations that the item still has to reach, and one more if it then
  is not at its final place: pick up, walk, put down, so 3 steps;
* 1 for the walk to the item, unless a player with free hands is there;
* 1 for each delay of more than a step: the player walks back to the item, or stays.

The sum is a lower bound. A stop at a station cannot serve two classes, because each station has at
most one class, and a process cannot be done at a station of another class. So each counted delivery
happens, and in each of its three steps the player deals with this item only.
"""

from __future__ import annotations

from robotouille.planning.kitchen.bound.delays import least_left, return_walk
from robotouille.planning.kitchen.bound.scratch import DEAD_END, Scratch, walk_before_put, walk_to
from robotouille.planning.kitchen.compact_state import NONE, POT, CompactState, GoalSpec, Kitchen
from robotouille.planning.kitchen.kernels import kernel
from robotouille.planning.kitchen.transitions import is_done, place_of_object

IMPOSSIBLE = -1


@kernel
def add_item_work(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, o: int, scratch: Scratch
) -> bool:
    """Note the work on an item of the goal and its chain. Return False if the goal is lost."""
    under = state.below[o]
    stops = add_process_work(kitchen, goal, state, o, scratch)
    # An added item never leaves the meal, so no station can be reached any more.
    if under >= kitchen.meal_code:
        return goal.added_to[o] == under - kitchen.meal_code and stops == 0
    if stops == IMPOSSIBLE:
        return False
    is_added = goal.added_to[o] != NONE
    is_held = under >= kitchen.hand_code
    deliveries = stops
    # After a stop the item is at a station with a purpose, and no goal wants an item there.
    if has_place(goal, o) and (
        stops > 0 or is_added or is_held or not is_in_place(kitchen, goal, state, o)
    ):
        deliveries += 1
    if is_added:
        scratch.maybe_added += 1
    scratch.deliveries[o] = deliveries
    scratch.chain[o] += 3 * deliveries
    if deliveries == 0 and scratch.works_here[o] == 0:
        return True
    scratch.work[o] += 3 * deliveries
    if is_held:
        # A held item needs no pick-up, and perhaps no walk.
        saved = 2 - walk_with_item(kitchen, goal, state, o, scratch) if deliveries else 0
        scratch.work[o] -= saved
        scratch.chain[o] -= saved
        return True
    scratch.leaves[o] = 1 if deliveries else 0
    # While a process runs, some player has to come back for the item, or wait next to it.
    walk = walk_to(kitchen, state, o, scratch)
    if scratch.works_here[o] == 0 and is_running_here(kitchen, goal, state, o):
        scratch.work[o] += return_walk(least_rest(kitchen, goal, state, o), walk, scratch)
    else:
        scratch.work[o] += walk
        scratch.chain[o] += walk
    return True


@kernel
def walk_with_item(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, o: int, scratch: Scratch
) -> int:
    """Return 1 if a held item has to be carried elsewhere before its next delivery ends, else 0."""
    if kitchen.players == 1:
        return walk_before_put(kitchen, state)
    # Nothing can be brought to the place while the player stands there with a full hand.
    place = state.place[state.below[o] - kitchen.hand_code]
    station = place - kitchen.objects
    if scratch.stops[o]:
        is_station = 0 <= station < kitchen.stations
        return 0 if is_station and scratch.stops[o] >> kitchen.station_class[station] & 1 else 1
    if goal.added_to[o] != NONE:
        return 0 if is_pot_at(kitchen, state, place) else 1
    if goal.on_table[o]:
        return 0 if place == kitchen.table_code else 1
    if goal.atop[o] != NONE:
        return 0 if place_of_object(kitchen, state, goal.atop[o]) == place else 1
    return 0 if place == goal.pile[o] else 1


@kernel
def is_pot_at(kitchen: Kitchen, state: CompactState, place: int) -> bool:
    """Return whether a pot is at a place."""
    for c in range(kitchen.items, kitchen.objects):
        if kitchen.container_kind[c] == POT and place_of_object(kitchen, state, c) == place:
            return True
    return False


@kernel
def has_place(goal: GoalSpec, o: int) -> bool:
    """Return whether the goal determines an object's final place."""
    if goal.on_table[o] or goal.atop[o] != NONE:
        return True
    return goal.pile[o] != NONE or goal.added_to[o] != NONE


@kernel
def is_in_place(kitchen: Kitchen, goal: GoalSpec, state: CompactState, o: int) -> bool:
    """Return whether an item is at its final place, judging only by the objects below it."""
    if goal.on_table[o]:
        return state.below[o] == kitchen.table_code
    if goal.atop[o] != NONE and state.below[o] != goal.atop[o]:
        return False
    if goal.pile[o] != NONE:
        lowest = o
        while state.below[lowest] < kitchen.objects:
            lowest = state.below[lowest]
        return lowest == goal.pile[o]
    return True


@kernel
def add_process_work(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, o: int, scratch: Scratch
) -> int:
    """Note the work of an item's processes.

    Return the number of stations that the item has to reach, or IMPOSSIBLE.
    """
    stops = candidates = returns = 0
    station = state.below[o] - kitchen.objects
    is_on_station = 0 <= station < kitchen.stations
    is_busy_here = False
    for q in range(kitchen.processes):
        if not goal.wanted_process[q][o] or is_done(kitchen, state, q, o):
            continue
        if not kitchen.possible[q][o]:
            return IMPOSSIBLE
        first = kitchen.prerequisite[q][o]
        waits = first != NONE and not is_done(kitchen, state, first, o)
        only = kitchen.process_class[q]
        chain = scratch.chain[o]
        if is_on_station and not waits and kitchen.station_class[station] == only:
            returns += add_work_here(kitchen, state, q, o, station, scratch)
            scratch.stay[o] = scratch.chain[o] - chain
            is_busy_here = True
            continue
        stops += 1
        scratch.stops[o] |= 1 << only
        returns += add_work_elsewhere(kitchen, state, q, o, scratch)
        if not waits and scratch.works_here[o] == 0:
            candidates += 1
            scratch.first_stop[o] = only if candidates == 1 else NONE
            if not is_busy_here:
                scratch.stay[o] = scratch.chain[o] - chain
    # After the last delay, nobody needs to return to an item that can stay where it is.
    if not has_place(goal, o):
        returns = max(0, returns - 1)
    scratch.work[o] += returns
    return stops


@kernel
def add_work_here(
    kitchen: Kitchen, state: CompactState, q: int, o: int, station: int, scratch: Scratch
) -> int:
    """Note the work of a process at the item's place. Return 1 if a player has to return."""
    total = kitchen.total[q][o]
    if not kitchen.timed[q]:
        left = total - state.counters[kitchen.progress[q][o]]
        scratch.works_here[o] = 1
        scratch.work[o] += left
        scratch.chain[o] += left
        return 0
    # Another station at which the delay was interrupted may be quicker.
    counters = kitchen.process_timer[q][o]
    elsewhere = 3 + least_left(state, counters, total, kitchen.stations, station)
    count = state.counters[counters[station]]
    if count > 0:
        scratch.chain[o] += min(total + 1 - count, elsewhere)
        return 0
    scratch.works_here[o] = 1
    scratch.work[o] += 1
    scratch.chain[o] += min(total, elsewhere)
    return 1 if total > 1 else 0


@kernel
def add_work_elsewhere(
    kitchen: Kitchen, state: CompactState, q: int, o: int, scratch: Scratch
) -> int:
    """Note the work of a process at another station. Return 1 if a player has to return."""
    total = kitchen.total[q][o]
    if not kitchen.timed[q]:
        left = total - state.counters[kitchen.progress[q][o]]
        scratch.work[o] += left
        scratch.chain[o] += left
        return 0
    # An interrupted delay continues in the step in which the item is put back. The bound uses the
    # station with the least time left.
    left = least_left(state, kitchen.process_timer[q][o], total, kitchen.stations, NONE)
    start = 0 if left < total else 1
    scratch.work[o] += start
    scratch.chain[o] += left
    return 1 if left > start else 0


@kernel
def is_running_here(kitchen: Kitchen, goal: GoalSpec, state: CompactState, o: int) -> bool:
    """Return whether a wanted process runs on an item at its place."""
    return least_rest(kitchen, goal, state, o) < DEAD_END


@kernel
def least_rest(kitchen: Kitchen, goal: GoalSpec, state: CompactState, o: int) -> int:
    """Return the steps until a wanted process ends that runs on an item at its place."""
    station = state.below[o] - kitchen.objects
    rest = DEAD_END
    if not 0 <= station < kitchen.stations:
        return rest
    for q in range(kitchen.processes):
        if goal.wanted_process[q][o] and kitchen.timed[q]:
            counter = kitchen.process_timer[q][o][station]
            if counter != NONE and state.counters[counter] > 0:
                rest = min(rest, kitchen.total[q][o] + 1 - state.counters[counter])
    return rest
