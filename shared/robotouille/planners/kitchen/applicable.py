"""What can be done in a compact state.

Left out is what cannot be of use: work that the goal does not ask for, filling more than is wanted,
and, for one player, putting something back where it was.
"""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
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
    Goal,
    Kitchen,
    decode_action,
    encode_action,
)
from robotouille.planners.kitchen.kernels import Ints, kernel
from robotouille.planners.kitchen.transitions import is_done, place_of_action

__all__ = ["applicable_actions", "applicable_moves"]

# Each of the functions that take `found` and `count` writes actions into `found`, from `count` on,
# and returns how many there are then.


@kernel
def applicable_actions(
    kitchen: Kitchen, goal: Goal, state: CompactState, p: int, here: bool, found: Ints, count: int
) -> int:
    """The actions of a player: with `here`, those at its place; else those anywhere else, to which
    it would walk first."""
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
    """Whether one player does not just put something back, or on another table that is alike."""
    kind, x, _ = decode_action(action)
    if kitchen.players > 1 or kind != PUT:
        return True
    if here:
        return state.may_have_walked != 0
    return x != kitchen.table_code or state.place[p] != kitchen.table_code


@kernel
def applicable_moves(kitchen: Kitchen, state: CompactState, p: int, found: Ints, count: int) -> int:
    """The walks of one of several players."""
    for place in range(kitchen.table_code + 1):
        if place == state.place[p]:
            continue
        if place < kitchen.objects and state.below[place] != kitchen.table_code:
            continue
        if not is_taken(kitchen, state, p, place):
            found[count] = encode_action(MOVE, place, 0)
            count += 1
    return count


@kernel
def is_taken(kitchen: Kitchen, state: CompactState, p: int, place: int) -> bool:
    """Whether somebody else is in the way of a player who wants to go to a place."""
    if place == kitchen.table_code:
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
    kitchen: Kitchen, goal: Goal, state: CompactState, found: Ints, count: int
) -> int:
    """Picking up, processes, filling and boiling."""
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
    kitchen: Kitchen, goal: Goal, state: CompactState, q: int, o: int, station: int
) -> bool:
    """Whether it is possible and of use to perform a process on a clear item on a station."""
    if kitchen.station_class[station] != kitchen.process_class[q]:
        return False
    if not kitchen.possible[q][o] or is_done(kitchen, state, q, o):
        return False
    if not goal.wanted_process[q][o]:
        return False
    first = kitchen.prerequisite[q][o]
    if first != NONE and not is_done(kitchen, state, first, o):
        return False
    return not kitchen.timed[q] or state.counters[kitchen.process_timer[q][o][station]] == 0


@kernel
def is_water_wanted(kitchen: Kitchen, goal: Goal, state: CompactState) -> bool:
    """Whether more water is wanted than there is and is on its way."""
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
    """Filling an empty pot at a sink."""
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
def boilings(kitchen: Kitchen, goal: Goal, state: CompactState, found: Ints, count: int) -> int:
    """Boiling a meal in a pot on a stove."""
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
    """Putting down what is held, where nothing is."""
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
    kitchen: Kitchen, goal: Goal, state: CompactState, p: int, found: Ints, count: int
) -> int:
    """Putting down, stacking, and adding to a meal in a pot."""
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
        if goal.added_to[item] == m or not goal.about[item]:
            found[count] = encode_action(ADD, m, 0)
            count += 1
    return count


@kernel
def with_container(kitchen: Kitchen, state: CompactState, p: int, found: Ints, count: int) -> int:
    """Putting down, and pouring from a pot into an empty bowl."""
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


# Questions about a state


@kernel
def is_clear(kitchen: Kitchen, state: CompactState, o: int) -> bool:
    """Whether nothing is on an object."""
    for other in range(kitchen.items):
        if state.below[other] == o:
            return False
    return True


@kernel
def is_free(kitchen: Kitchen, state: CompactState, code: int) -> bool:
    """Whether nothing is on a station with a purpose, of which this is the code."""
    for o in range(kitchen.objects):
        if state.below[o] == code:
            return False
    return True


@kernel
def free_tables(kitchen: Kitchen, state: CompactState) -> int:
    """How many plain tables have nothing on them."""
    free = kitchen.tables
    for o in range(kitchen.objects):
        if state.below[o] == kitchen.table_code:
            free -= 1
    return free


@kernel
def is_empty(kitchen: Kitchen, state: CompactState, container: int) -> bool:
    """Whether there is no meal in a container."""
    for m in range(kitchen.meals):
        if state.inside[m] == container + 1:
            return False
    return True
