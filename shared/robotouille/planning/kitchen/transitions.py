"""The kitchen's transition function: effects of actions and of time on a compact state.

`recognition.py` ensures that the domain's actions have the same effects.
"""

from __future__ import annotations

from robotouille.planning.kitchen.compact_state import (
    ADD,
    BOIL,
    FILL,
    FILLING,
    MOVE,
    NONE,
    PICK,
    POUR,
    PROCESS,
    PROCESSING,
    PUT,
    CompactState,
    Kitchen,
    copy_state,
    decode_action,
)
from robotouille.planning.kitchen.kernels import Ints, kernel

# Properties of a state


@kernel
def place_of_object(kitchen: Kitchen, state: CompactState, o: int) -> int:
    """Return an object's place, or a code beyond all places if it is in a hand or a meal."""
    while state.below[o] < kitchen.objects:
        o = state.below[o]
    under = state.below[o]
    return o if under == kitchen.table_code else under


@kernel
def is_done(kitchen: Kitchen, state: CompactState, q: int, o: int) -> bool:
    """Return whether a process has taken effect on an item."""
    if kitchen.progress[q][o] == NONE:
        return False
    progress = state.counters[kitchen.progress[q][o]]
    return progress >= (1 if kitchen.timed[q] else kitchen.total[q][o])


# Time


@kernel
def is_running(kitchen: Kitchen, state: CompactState, timer: int) -> bool:
    """Return whether a timer advances: it was started and its object is on its station."""
    if state.counters[kitchen.timer_counter[timer]] == 0:
        return False
    # A timer whose object was taken away keeps its count and continues when the object returns,
    # like the delays of the world.
    return state.below[kitchen.timer_object[timer]] == kitchen.timer_station[timer]


@kernel
def is_any_timer_running(kitchen: Kitchen, state: CompactState) -> bool:
    """Return whether time alone changes the state."""
    for timer in range(kitchen.timers):
        if is_running(kitchen, state, timer):
            return True
    return False


@kernel
def advance_timers(kitchen: Kitchen, state: CompactState) -> None:
    """Let the time of one step pass."""
    for timer in range(kitchen.timers):
        if is_running(kitchen, state, timer):
            counter = kitchen.timer_counter[timer]
            state.counters[counter] += 1
            if state.counters[counter] > kitchen.timer_total[timer]:
                state.counters[counter] = 0
                take_effect(kitchen, state, timer)


@kernel
def pass_time(kitchen: Kitchen, state: CompactState, after: CompactState) -> None:
    """Set `after` to the state after a step without actions."""
    copy_state(kitchen, state, after)
    advance_timers(kitchen, after)


@kernel
def take_effect(kitchen: Kitchen, state: CompactState, timer: int) -> None:
    """Apply a timer's effect and reset all timers with the same effect."""
    kind, effect = kitchen.timer_kind[timer], kitchen.timer_effect[timer]
    if kind == FILLING:
        make_meal(kitchen, state, effect)
        return
    if kind == PROCESSING:
        state.counters[effect] = 1
    else:
        state.boiled[effect] = 1
    # One item may have interrupted timers on several stations. Once it is processed they change
    # nothing, so equal states get equal keys.
    for other in range(kitchen.timers):
        if kitchen.timer_kind[other] == kind and kitchen.timer_effect[other] == effect:
            state.counters[kitchen.timer_counter[other]] = 0


@kernel
def make_meal(kitchen: Kitchen, state: CompactState, pot: int) -> None:
    """Create the next meal in a pot."""
    for m in range(kitchen.meals):
        if state.inside[m] == 0:
            state.inside[m] = pot + 1
            return


# Effects of actions


@kernel
def place_of_action(kitchen: Kitchen, state: CompactState, action: int) -> int:
    """Return the place of an action. All free plain tables have the same code."""
    kind, x, _ = decode_action(action)
    if kind == MOVE:
        return x
    if kind == PUT:
        return x if x >= kitchen.objects else place_of_object(kitchen, state, x)
    if kind in (BOIL, ADD):
        return place_of_object(kitchen, state, state.inside[x] - 1)
    return place_of_object(kitchen, state, x)


@kernel
def apply_action(kitchen: Kitchen, state: CompactState, p: int, action: int) -> None:
    """Apply an action of a player who stands at the action's place."""
    kind, x, y = decode_action(action)
    held = state.held[p] - 1
    if kind == MOVE:
        state.place[p] = x
    elif kind == PICK:
        if state.below[x] == kitchen.table_code:
            # The table that the object identified is now an empty one.
            state.place[p] = kitchen.table_code
        state.below[x] = kitchen.hand_code + p
        state.held[p] = x + 1
        state.may_have_walked = 0
    elif kind == PUT:
        state.below[held] = x
        state.held[p] = 0
        if x == kitchen.table_code:
            state.place[p] = held
    elif kind == PROCESS:
        perform_process(kitchen, state, x, y)
    elif kind == FILL:
        station = state.below[x] - kitchen.objects
        state.counters[kitchen.fill_timer[x][station]] = 1
    elif kind == BOIL:
        pot = state.inside[x] - 1
        station = state.below[pot] - kitchen.objects
        state.counters[kitchen.boil_timer[x][pot][station]] = 1
    elif kind == ADD:
        state.below[held] = kitchen.meal_code + x
        state.held[p] = 0
    elif kind == POUR:
        state.inside[y] = x + 1


@kernel
def perform_process(kitchen: Kitchen, state: CompactState, o: int, q: int) -> None:
    """Perform a repeated process once, or start a timed one."""
    if kitchen.timed[q]:
        station = state.below[o] - kitchen.objects
        state.counters[kitchen.process_timer[q][o][station]] = 1
    else:
        state.counters[kitchen.progress[q][o]] += 1


@kernel
def sort_players(kitchen: Kitchen, state: CompactState, order: Ints) -> None:
    """Sort several players by place and held object, and `order`, their identities, with them."""
    # Insertion sort, since there are at most four players.
    for i in range(1, kitchen.players):
        for p in range(i, 0, -1):
            place, held = state.place[p], state.held[p]
            place_before, held_before = state.place[p - 1], state.held[p - 1]
            if place_before < place or (place_before == place and held_before <= held):
                break
            state.place[p], state.held[p] = place_before, held_before
            state.place[p - 1], state.held[p - 1] = place, held
            order[p], order[p - 1] = order[p - 1], order[p]
    for p in range(kitchen.players):
        if state.held[p]:
            state.below[state.held[p] - 1] = kitchen.hand_code + p
