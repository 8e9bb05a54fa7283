"""Useful actions in a compact state.

Work that the goal does not require, unneeded water, and putting an object back are left out.
"""

from __future__ import annotations

from robotouille.planning.kitchen.compact_state import (
    ADD,
    BOIL,
    BOWL,
    FILL,
    FILLING,
    MOVE,
    NONE,
    PICK,
    POT,
    POUR,
    PROCESS,
    PUT,
    CompactState,
    GoalSpec,
    Kitchen,
    decode_action,
    encode_action,
)
from robotouille.planning.kitchen.kernels import Ints, kernel
from robotouille.planning.kitchen.transitions import is_done, place_of_action

# Functions with `found` and `count` write actions into `found` from `count` on and return the new
# count: kernels cannot return lists.


@kernel
def applicable_actions(
    kitchen: Kitchen,
    goal: GoalSpec,
    state: CompactState,
    p: int,
    here: bool,
    found: Ints,
    count: int,
) -> int:
    """Find the actions of a player: those at its place if `here`, else those elsewhere."""
    first = count
    if state.held[p] == 0:
        count = with_empty_hand(kitchen, goal, state, found, count)
    elif state.held[p] <= kitchen.items:
        count = with_item(kitchen, goal, state, p, found, count)
    else:
        count = with_container(kitchen, state, p, found, count)
    kept = first
    for i in range(first, count):
        is_here = place_of_action(kitchen, state, found[i]) == state.place[p]
        if is_here == here and is_of_use(kitchen, state, p, here, found[i]):
            found[kept] = found[i]
            kept += 1
    return kept


@kernel
def is_of_use(kitchen: Kitchen, state: CompactState, p: int, here: bool, action: int) -> bool:
    """Return whether an action is more than putting an object back, if there is one player."""
    kind, x, _ = decode_action(action)
    # With several players, putting something back can be useful: another player may take the
    # station in the meantime or need the free hand.
    if kitchen.players > 1 or kind != PUT:
        return True
    # Without a walk since the pick-up, putting the object back at the same place is never better
    # than waiting.
    if here:
        return state.may_have_walked != 0
    # Plain tables are interchangeable.
    return x != kitchen.table_code or state.place[p] != kitchen.table_code


@kernel
def applicable_moves(kitchen: Kitchen, state: CompactState, p: int, found: Ints, count: int) -> int:
    """Find the walks of one of several players."""
    for place in range(kitchen.table_code + 1):
        if place == state.place[p]:
            continue
        # Only the lowest object of a pile stands for a table.
        if place < kitchen.objects and state.below[place] != kitchen.table_code:
            continue
        if not is_taken(kitchen, state, p, place):
            found[count] = encode_action(MOVE, place, 0)
            count += 1
    return count


@kernel
def is_taken(kitchen: Kitchen, state: CompactState, p: int, place: int) -> bool:
    """Return whether another player stands at a place."""
    if place == kitchen.table_code:
        # Players at empty tables are counted, since empty tables have no identity.
        free = free_tables(kitchen, state)
        for other in range(kitchen.players):
            if state.place[other] == kitchen.table_code:
                free -= 1
        return free <= 0
    for other in range(kitchen.players):
        if other != p and state.place[other] == place:
            return True
    return False


@kernel
def with_empty_hand(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, found: Ints, count: int
) -> int:
    """Find pick-ups, processes, filling and boiling."""
    for o in range(kitchen.objects):
        under = state.below[o]
        if under >= kitchen.hand_code or not is_clear(kitchen, state, o):
            continue
        found[count] = encode_action(PICK, o, 0)
        count += 1
        if o < kitchen.items and kitchen.objects <= under < kitchen.table_code:
            for q in range(kitchen.processes):
                if may_process(kitchen, goal, state, q, o, under - kitchen.objects):
                    found[count] = encode_action(PROCESS, o, q)
                    count += 1
    if is_water_wanted(kitchen, goal, state):
        count = fillings(kitchen, state, found, count)
    return boilings(kitchen, goal, state, found, count)


@kernel
def may_process(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, q: int, o: int, station: int
) -> bool:
    """Return whether a process on a clear item at a station is possible and useful."""
    if kitchen.station_class[station] != kitchen.process_class[q]:
        return False
    if not kitchen.possible[q][o] or is_done(kitchen, state, q, o):
        return False
    # Work on other items never brings the goal closer: no goal that the planner supports requires
    # an item that is *not* processed.
    if not goal.wanted_process[q][o]:
        return False
    first = kitchen.prerequisite[q][o]
    if first != NONE and not is_done(kitchen, state, first, o):
        return False
    return not kitchen.timed[q] or state.counters[kitchen.process_timer[q][o][station]] == 0


@kernel
def is_water_wanted(kitchen: Kitchen, goal: GoalSpec, state: CompactState) -> bool:
    """Return whether the goal needs more water than exists or is on its way."""
    wanted = 0
    for m in range(kitchen.meals):
        if state.inside[m] == 0 and goal.wanted_meal[m]:
            wanted += 1
    for timer in range(kitchen.timers):
        is_filling = kitchen.timer_kind[timer] == FILLING
        if is_filling and state.counters[kitchen.timer_counter[timer]] > 0:
            wanted -= 1
    return wanted > 0


@kernel
def fillings(kitchen: Kitchen, state: CompactState, found: Ints, count: int) -> int:
    """Find the actions that fill an empty pot at a sink."""
    for pot in range(kitchen.items, kitchen.objects):
        station = state.below[pot] - kitchen.objects
        if kitchen.container_kind[pot] != POT or not 0 <= station < kitchen.stations:
            continue
        if kitchen.station_class[station] != kitchen.sink_class:
            continue
        idle = state.counters[kitchen.fill_timer[pot][station]] == 0
        if idle and is_empty(kitchen, state, pot):
            found[count] = encode_action(FILL, pot, 0)
            count += 1
    return count


@kernel
def boilings(kitchen: Kitchen, goal: GoalSpec, state: CompactState, found: Ints, count: int) -> int:
    """Find the actions that boil a meal in a pot on a stove."""
    for m in range(kitchen.meals):
        pot = state.inside[m] - 1
        if pot < 0 or kitchen.container_kind[pot] != POT:
            continue
        if state.boiled[m] or not goal.boiling[m]:
            continue
        station = state.below[pot] - kitchen.objects
        if not 0 <= station < kitchen.stations:
            continue
        if kitchen.station_class[station] != kitchen.stove_class:
            continue
        if state.counters[kitchen.boil_timer[m][pot][station]] == 0:
            found[count] = encode_action(BOIL, m, 0)
            count += 1
    return count


@kernel
def puts(kitchen: Kitchen, state: CompactState, found: Ints, count: int) -> int:
    """Find the free places on which to put the held object."""
    for code in range(kitchen.objects, kitchen.objects + kitchen.stations):
        if is_free(kitchen, state, code):
            found[count] = encode_action(PUT, code, 0)
            count += 1
    if free_tables(kitchen, state) > 0:
        found[count] = encode_action(PUT, kitchen.table_code, 0)
        count += 1
    return count


@kernel
def with_item(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, p: int, found: Ints, count: int
) -> int:
    """Find the actions of a player with an item: putting down, stacking and adding to a meal."""
    item = state.held[p] - 1
    count = puts(kitchen, state, found, count)
    for o in range(kitchen.items):
        if o != item and state.below[o] < kitchen.hand_code and is_clear(kitchen, state, o):
            found[count] = encode_action(PUT, o, 0)
            count += 1
    for m in range(kitchen.meals):
        pot = state.inside[m] - 1
        if pot < 0 or kitchen.container_kind[pot] != POT:
            continue
        if state.below[pot] >= kitchen.hand_code:
            continue
        # Added items never come back. Items outside the goal may be added anywhere to get rid of
        # them.
        if goal.added_to[item] == m or not goal.about[item]:
            found[count] = encode_action(ADD, m, 0)
            count += 1
    return count


@kernel
def with_container(kitchen: Kitchen, state: CompactState, p: int, found: Ints, count: int) -> int:
    """Find the actions of a player with a container: putting down and pouring into a bowl."""
    held = state.held[p] - 1
    count = puts(kitchen, state, found, count)
    if kitchen.container_kind[held] != POT:
        return count
    for m in range(kitchen.meals):
        if state.inside[m] != held + 1:
            continue
        for bowl in range(kitchen.items, kitchen.objects):
            if kitchen.container_kind[bowl] != BOWL or state.below[bowl] >= kitchen.hand_code:
                continue
            if is_empty(kitchen, state, bowl):
                found[count] = encode_action(POUR, bowl, m)
                count += 1
    return count


# Properties of a state


@kernel
def is_clear(kitchen: Kitchen, state: CompactState, o: int) -> bool:
    """Return whether nothing is on an object."""
    for other in range(kitchen.items):
        if state.below[other] == o:
            return False
    return True


@kernel
def is_free(kitchen: Kitchen, state: CompactState, code: int) -> bool:
    """Return whether nothing is on the station with a code."""
    for o in range(kitchen.objects):
        if state.below[o] == code:
            return False
    return True


@kernel
def free_tables(kitchen: Kitchen, state: CompactState) -> int:
    """Return the number of plain tables with nothing on them."""
    free = kitchen.tables
    for o in range(kitchen.objects):
        if state.below[o] == kitchen.table_code:
            free -= 1
    return free


@kernel
def is_empty(kitchen: Kitchen, state: CompactState, container: int) -> bool:
    """Return whether a container has no meal."""
    for m in range(kitchen.meals):
        if state.inside[m] == container + 1:
            return False
    return True
