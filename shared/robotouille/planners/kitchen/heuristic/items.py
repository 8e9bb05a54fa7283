"""The work on items of the goal: a sum over processes and deliveries.

*What is relaxed.* Each item is alone in the kitchen: nothing is in its way, every station is free,
and nobody is kept from it by work on another. What remains of the item's plan is counted:

* for each wanted process that is not done, its performances, or 1 to start its delay (0 where it
  was started and interrupted: it goes on by itself when the item is put back);
* a *delivery* for each class of stations that it still has to be brought to, and one more if it
  is then not where the goal wants it: pick up, walk, put down, so 3 steps;
* 1 for the walk to it, unless a player with free hands is there;
* 1 for each delay of more than a step: whoever started it walks back to the item, or stays.

*Why it is a lower bound.* A stop at a station cannot serve two classes, since a station has one
class at most; and a process cannot be done where the class is another. So each delivery counted
happens, and each is three steps in which the player deals with this item and no other.

*Cost.* A loop over processes and, for delays, stations.
"""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
    NONE,
    CompactState,
    Goal,
    Kitchen,
)
from robotouille.planners.kitchen.heuristic.scratch import Scratch
from robotouille.planners.kitchen.heuristic.walks import walk_before_put, walk_to
from robotouille.planners.kitchen.kernels import kernel
from robotouille.planners.kitchen.transitions import is_done

__all__ = ["add_item_work", "has_place"]

IMPOSSIBLE = -1


@kernel
def add_item_work(
    kitchen: Kitchen, goal: Goal, state: CompactState, o: int, scratch: Scratch
) -> bool:
    """Note the work on an item of the goal and its chain of events; False if it is lost."""
    under = state.below[o]
    stops = add_process_work(kitchen, goal, state, o, scratch)
    if under >= kitchen.meal_code:
        return goal.added_to[o] == under - kitchen.meal_code and stops == 0
    if stops == IMPOSSIBLE:
        return False
    is_added = goal.added_to[o] != NONE
    is_held = under >= kitchen.hand_code
    deliveries = stops
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
        saved = 2 - walk_before_put(kitchen, state) if deliveries else 0
        scratch.work[o] -= saved
        scratch.chain[o] -= saved
        return True
    scratch.leaves[o] = 1 if deliveries else 0
    if scratch.works_here[o] == 0 and is_running_here(kitchen, goal, state, o):
        scratch.work[o] += 1
    else:
        walk = walk_to(kitchen, state, o, scratch)
        scratch.work[o] += walk
        scratch.chain[o] += walk
    return True


@kernel
def has_place(goal: Goal, o: int) -> bool:
    """Whether the goal says where an object has to be in the end."""
    if goal.on_table[o] or goal.atop[o] != NONE:
        return True
    return goal.pile[o] != NONE or goal.added_to[o] != NONE


@kernel
def is_in_place(kitchen: Kitchen, goal: Goal, state: CompactState, o: int) -> bool:
    """Whether an item is where the goal wants it, as far as what is below it tells."""
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
    kitchen: Kitchen, goal: Goal, state: CompactState, o: int, scratch: Scratch
) -> int:
    """Note the work of an item's processes; returns how many stations it has to be brought to, or
    IMPOSSIBLE.

    A delay needs somebody to come back for the item, or to stay: one more step. Where the goal
    does not say where the item has to be, the last delay needs nobody.
    """
    stops = candidates = returns = 0
    station = state.below[o] - kitchen.objects
    is_on_station = 0 <= station < kitchen.stations
    for q in range(kitchen.processes):
        if not goal.wanted_process[q][o] or is_done(kitchen, state, q, o):
            continue
        if not kitchen.possible[q][o]:
            return IMPOSSIBLE
        first = kitchen.prerequisite[q][o]
        waits = first != NONE and not is_done(kitchen, state, first, o)
        only = kitchen.process_class[q]
        if is_on_station and not waits and kitchen.station_class[station] == only:
            returns += add_work_here(kitchen, state, q, o, station, scratch)
            continue
        stops += 1
        scratch.stops[o] |= 1 << only
        if not waits and scratch.works_here[o] == 0:
            candidates += 1
            scratch.first_stop[o] = only if candidates == 1 else NONE
        returns += add_work_elsewhere(kitchen, state, q, o, scratch)
    if not has_place(goal, o):
        returns = max(0, returns - 1)
    scratch.work[o] += returns
    return stops


@kernel
def add_work_here(
    kitchen: Kitchen, state: CompactState, q: int, o: int, station: int, scratch: Scratch
) -> int:
    """Note the work of a process where an item is; returns 1 if one has to come back for it."""
    total = kitchen.total[q][o]
    if not kitchen.timed[q]:
        left = total - state.counters[kitchen.progress[q][o]]
        scratch.works_here[o] = 1
        scratch.work[o] += left
        scratch.chain[o] += left
        return 0
    count = state.counters[kitchen.process_timer[q][o][station]]
    if count > 0:
        scratch.chain[o] += total + 1 - count
        return 0
    scratch.works_here[o] = 1
    scratch.work[o] += 1
    scratch.chain[o] += total
    return 1 if total > 1 else 0


@kernel
def add_work_elsewhere(
    kitchen: Kitchen, state: CompactState, q: int, o: int, scratch: Scratch
) -> int:
    """Note the work of a process at another station; returns 1 if one has to come back for it.

    A delay that was interrupted goes on in the very step in which the item is put back.
    """
    left = kitchen.total[q][o]
    if not kitchen.timed[q]:
        left -= state.counters[kitchen.progress[q][o]]
        scratch.work[o] += left
        scratch.chain[o] += left
        return 0
    start = 1
    for station in range(kitchen.stations):
        counter = kitchen.process_timer[q][o][station]
        if counter != NONE and state.counters[counter] > 0:
            start = 0
            left = min(left, kitchen.total[q][o] - state.counters[counter])
    scratch.work[o] += start
    scratch.chain[o] += left
    return 1 if left > start else 0


@kernel
def is_running_here(kitchen: Kitchen, goal: Goal, state: CompactState, o: int) -> bool:
    """Whether a wanted process runs on an item where it is."""
    station = state.below[o] - kitchen.objects
    if not 0 <= station < kitchen.stations:
        return False
    for q in range(kitchen.processes):
        if goal.wanted_process[q][o] and kitchen.timed[q]:
            counter = kitchen.process_timer[q][o][station]
            if counter != NONE and state.counters[counter] > 0:
                return True
    return False
