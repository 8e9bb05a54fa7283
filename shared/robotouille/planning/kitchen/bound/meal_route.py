"""The heuristic's way of one meal through one pot: filled, heated and poured.

The delay of boiling belongs to a meal, a pot and a stove. A meal that was poured too soon boils on
in its bowl while that pot stands on that stove, also with other water in it.
"""

from __future__ import annotations

from robotouille.planning.kitchen.applicable import is_empty
from robotouille.planning.kitchen.bound.scratch import (
    DEAD_END,
    Scratch,
    return_walk,
    walk_before_put,
    walk_to,
)
from robotouille.planning.kitchen.compact_state import (
    BOWL,
    NONE,
    CompactState,
    GoalSpec,
    Kitchen,
)
from robotouille.planning.kitchen.kernels import kernel
from robotouille.planning.kitchen.transitions import place_of_object


@kernel
def route(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, pot: int, scratch: Scratch
) -> tuple[int, int, int]:
    """Return the work and chain of a meal in a pot, and the walks to the pot while it has water."""
    under = state.below[pot]
    is_held = under >= kitchen.hand_code
    walk = 0 if is_held else walk_to(kitchen, state, pot, scratch)
    first = 1 + walk_with_pot(kitchen, goal, state, m, pot) if is_held else 3 + walk
    is_dry = state.inside[m] == 0
    work, chain, back = 0, 0, walk
    if is_dry:
        work, chain, back = filling(kitchen, state, pot, walk, first, scratch)
    water_walks = 0
    boils = goal.boiling[m] and not state.boiled[m]
    pours = goal.vessel[m] != NONE
    if boils:
        water_walks = back
        more, later, back = heating(kitchen, goal, state, m, pot, first, back, scratch)
        if more == 0:
            water_walks = 0
        work += more
        chain += later
    if pours and is_held and not is_dry and not boils:
        work += first
        chain += first
    elif pours:
        work += back + 3
        water_walks += back
        chain += 3 if is_dry or boils else 3 + back
    if pours:
        chain += adding_steps(kitchen, goal, state, m, pot, walk)
    return work, chain, water_walks


@kernel
def walk_with_pot(kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, pot: int) -> int:
    """Return 1 if a held pot has to be carried elsewhere before the next work on a meal, else 0."""
    if kitchen.players == 1:
        return walk_before_put(kitchen, state)
    place = state.place[state.below[pot] - kitchen.hand_code]
    station = place - kitchen.objects
    only = NONE
    if 0 <= station < kitchen.stations:
        only = kitchen.station_class[station]
    if state.inside[m] == 0:
        # A pot with another meal may be poured first.
        return 1 if is_empty(kitchen, state, pot) and only != kitchen.sink_class else 0
    if goal.boiling[m] and not state.boiled[m]:
        # Water that was heated may boil on in the bowl.
        for i in range(kitchen.stations):
            counter = kitchen.boil_timer[m][pot][i]
            if counter != NONE and state.counters[counter] > 0:
                return 0
        return 0 if only == kitchen.stove_class else 1
    for bowl in range(kitchen.items, kitchen.objects):
        is_bowl = kitchen.container_kind[bowl] == BOWL
        if is_bowl and place_of_object(kitchen, state, bowl) == place:
            return 0
    return 1


@kernel
def adding_steps(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, pot: int, walk: int
) -> int:
    """Return how much longer a meal's chain becomes because items have to be added before pouring.

    In a step in which a player adds something, nobody else deals with the pot.
    """
    adding = 0
    for o in range(kitchen.items):
        if goal.added_to[o] == m and state.below[o] < kitchen.meal_code:
            adding += 1
    # The player who adds an item need not walk to the pot.
    meanwhile = walk if state.inside[m] > 0 else 0
    # While the water boils, an item can be added in every second step.
    if goal.boiling[m] and not state.boiled[m]:
        delay = kitchen.boil_total - 2
        for station in range(kitchen.stations):
            counter = kitchen.boil_timer[m][pot][station]
            if counter != NONE and state.counters[counter] > 0:
                delay = max(delay, kitchen.boil_total + 1 - state.counters[counter])
        meanwhile += (delay + 1) // 2
    return max(0, adding - meanwhile)


@kernel
def filling(
    kitchen: Kitchen, state: CompactState, pot: int, walk: int, first: int, scratch: Scratch
) -> tuple[int, int, int]:
    """Return work and chain until a pot contains water, and whether a player has to come back.

    `walk` is the walk to the pot; `first` is the work to bring it to another station.
    """
    station = station_of(kitchen, state, pot)
    left = kitchen.fill_total
    start = 1
    for i in range(kitchen.stations):
        counter = kitchen.fill_timer[pot][i]
        if i != station and counter != NONE and state.counters[counter] > 0:
            start = 0
            left = min(left, kitchen.fill_total - state.counters[counter])
    if station != NONE and kitchen.station_class[station] == kitchen.sink_class:
        # Another sink at which the filling was interrupted may be quicker.
        elsewhere = first + left
        count = state.counters[kitchen.fill_timer[pot][station]]
        if count > 0:
            rest = kitchen.fill_total + 1 - count
            return 0, min(rest, elsewhere), return_walk(rest, walk, scratch)
        soonest = min(walk + kitchen.fill_total, elsewhere)
        return walk + 1, soonest, 1 if kitchen.fill_total > 1 else 0
    # A pot with another meal is poured and carried to the sink: two steps more.
    soonest = first if start == 0 or is_empty(kitchen, state, pot) else first + 2
    soonest = max(soonest, steps_until_sink(kitchen, state))
    return first + start, soonest + left, 1 if left > start else 0


@kernel
def steps_until_sink(kitchen: Kitchen, state: CompactState) -> int:
    """Return the steps until a pot that is not at a sink can be put there."""
    soonest = DEAD_END
    for station in range(kitchen.stations):
        if kitchen.station_class[station] != kitchen.sink_class:
            continue
        steps = 0
        for o in range(kitchen.objects):
            if state.below[o] == kitchen.objects + station:
                # The object is taken away, its player leaves, and the next one puts the pot there.
                steps = 3
                counter = NONE if o < kitchen.items else kitchen.fill_timer[o][station]
                if counter != NONE and state.counters[counter] > 0:
                    steps += kitchen.fill_total + 1 - state.counters[counter]
        soonest = min(soonest, steps)
    return soonest


@kernel
def heating(
    kitchen: Kitchen,
    goal: GoalSpec,
    state: CompactState,
    m: int,
    pot: int,
    first: int,
    back: int,
    scratch: Scratch,
) -> tuple[int, int, int]:
    """Return work and chain until a meal boils, and whether a player has to come back.

    `back` is the walk to the pot once it contains water; `first` is the work to bring it elsewhere.
    """
    if state.inside[m] == 0:
        return back + 4, 3 + kitchen.boil_total, 1 if kitchen.boil_total > 1 else 0
    station = station_of(kitchen, state, pot)
    left = kitchen.boil_total
    start = 1
    for i in range(kitchen.stations):
        counter = kitchen.boil_timer[m][pot][i]
        if i != station and counter != NONE and state.counters[counter] > 0:
            start = 0
            left = min(left, kitchen.boil_total - state.counters[counter])
    # After an interruption it is one step less to pour first and then put the pot back on the
    # stove: the water boils in the bowl.
    pours_first = start == 0 and goal.vessel[m] != NONE
    elsewhere = first + left - (1 if pours_first else 0)
    stays = is_on_stove(kitchen, state, pot)
    work, returns = first + start, 1 if left > start or stays else 0
    if pours_first and returns_anyway(kitchen, goal, state):
        work, returns = first - 3, 0
    elif pours_first:
        work -= 1 + returns
    if not stays:
        return work, elsewhere, returns
    count = state.counters[kitchen.boil_timer[m][pot][station]]
    if count > 0:
        rest = kitchen.boil_total + 1 - count
        return 0, min(rest, elsewhere), return_walk(rest, back, scratch)
    if not pours_first:
        work, returns = back + 1, 1 if kitchen.boil_total > 1 else 0
    return work, min(back + kitchen.boil_total, elsewhere), returns


@kernel
def returns_anyway(kitchen: Kitchen, goal: GoalSpec, state: CompactState) -> bool:
    """Return whether a pot is brought to a stove for a meal that still has to be made."""
    for m in range(kitchen.meals):
        if goal.wanted_meal[m] and state.inside[m] == 0 and goal.boiling[m]:
            return True
    return False


@kernel
def station_of(kitchen: Kitchen, state: CompactState, o: int) -> int:
    """Return the station with a purpose on which an object stands, or NONE."""
    station = state.below[o] - kitchen.objects
    return station if 0 <= station < kitchen.stations else NONE


@kernel
def is_on_stove(kitchen: Kitchen, state: CompactState, pot: int) -> bool:
    """Return whether a pot stands on a stove."""
    station = station_of(kitchen, state, pot)
    return station != NONE and kitchen.station_class[station] == kitchen.stove_class
