"""The heuristic's way of one meal through one pot: filled, heated and poured.

The delay of boiling belongs to a meal, a pot and a stove. A meal that was poured too soon boils on
in its bowl while that pot stands on that stove, also with other water in it.
"""

from __future__ import annotations

from typing import NamedTuple

from robotouille.planning.kitchen.applicable import is_empty
from robotouille.planning.kitchen.bound.delays import least_left, return_walk
from robotouille.planning.kitchen.bound.scratch import DEAD_END, Scratch, walk_before_put, walk_to
from robotouille.planning.kitchen.compact_state import (
    BOWL,
    NONE,
    CompactState,
    GoalSpec,
    Kitchen,
)
from robotouille.planning.kitchen.kernels import kernel
from robotouille.planning.kitchen.transitions import place_of_object

TRANSPORT = 3
"""Work to bring a pot elsewhere: pick up, walk and put down. The last step may also be pouring."""


class Pot(NamedTuple):
    """A pot that may serve for a meal."""

    number: int
    walk: int
    """Steps to walk to the pot."""
    transport: int
    """Steps until the pot is at another station or its meal is poured. They contain `walk`."""


class Stage(NamedTuple):
    """Steps of filling or heating."""

    work: int
    """Steps of players."""
    chain: int
    """All steps, with the delay."""
    back: int
    """Steps in which a player walks back to the pot afterwards, or waits there for the end."""


class Route(NamedTuple):
    """Steps of a meal until it is in its vessel."""

    work: int
    """Steps of players."""
    chain: int
    """All steps, with delays."""
    water_walks: int
    """Walks to the pot while it contains water."""


@kernel
def route(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, number: int, scratch: Scratch
) -> Route:
    """Return the steps of a meal that is in a pot or has to be made in it."""
    pot = access(kitchen, goal, state, m, number, scratch)
    if state.inside[m] == 0:
        found = route_of_new_meal(kitchen, goal, state, m, pot, scratch)
    else:
        found = route_of_meal(kitchen, goal, state, m, pot, scratch)
    if goal.vessel[m] == NONE:
        return found
    later = adding_steps(kitchen, goal, state, m, pot)
    return Route(found.work, found.chain + later, found.water_walks)


@kernel
def access(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, number: int, scratch: Scratch
) -> Pot:
    """Return the pot with a number, and the steps to reach and move it for a meal."""
    if state.below[number] >= kitchen.hand_code:
        return Pot(number, 0, 1 + walk_with_pot(kitchen, goal, state, m, number))
    walk = walk_to(kitchen, state, number, scratch)
    return Pot(number, walk, walk + TRANSPORT)


@kernel
def route_of_new_meal(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, pot: Pot, scratch: Scratch
) -> Route:
    """Return the steps of a meal that has to be made in a pot."""
    filled = filling(kitchen, state, pot, scratch)
    work, chain, back = filled.work, filled.chain, filled.back
    water_walks = 0
    if goal.boiling[m]:
        # The last step of work begins the boiling.
        work += back + TRANSPORT + 1
        chain += TRANSPORT + kitchen.boil_total
        water_walks += back
        back = 1 if kitchen.boil_total > 1 else 0
    if goal.vessel[m] != NONE:
        work += back + TRANSPORT
        chain += TRANSPORT
        water_walks += back
    return Route(work, chain, water_walks)


@kernel
def route_of_meal(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, pot: Pot, scratch: Scratch
) -> Route:
    """Return the steps of a meal that is in a pot."""
    pours = goal.vessel[m] != NONE
    if not still_boils(goal, state, m):
        return Route(pot.transport, pot.transport, pot.walk) if pours else Route(0, 0, 0)
    heated = heating(kitchen, goal, state, m, pot, scratch)
    water_walks = pot.walk if heated.work > 0 else 0
    if not pours:
        return Route(heated.work, heated.chain, water_walks)
    work = heated.work + heated.back + TRANSPORT
    return Route(work, heated.chain + TRANSPORT, water_walks + heated.back)


@kernel
def still_boils(goal: GoalSpec, state: CompactState, m: int) -> bool:
    """Return whether a meal of the goal still has to boil."""
    return goal.boiling[m] == 1 and not state.boiled[m]


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
    if still_boils(goal, state, m):
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
def adding_steps(kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, pot: Pot) -> int:
    """Return how much longer a meal's chain becomes because items have to be added before pouring.

    In a step in which a player adds something, nobody else deals with the pot.
    """
    adding = 0
    for o in range(kitchen.items):
        if goal.added_to[o] == m and state.below[o] < kitchen.meal_code:
            adding += 1
    # The player who adds an item need not walk to the pot.
    meanwhile = pot.walk if state.inside[m] > 0 else 0
    # While the water boils, an item can be added in every second step.
    if still_boils(goal, state, m):
        delay = kitchen.boil_total - 2
        for station in range(kitchen.stations):
            counter = kitchen.boil_timer[m][pot.number][station]
            if counter != NONE and state.counters[counter] > 0:
                delay = max(delay, kitchen.boil_total + 1 - state.counters[counter])
        meanwhile += (delay + 1) // 2
    return max(0, adding - meanwhile)


@kernel
def filling(kitchen: Kitchen, state: CompactState, pot: Pot, scratch: Scratch) -> Stage:
    """Return the steps until a pot contains water."""
    station = station_of(kitchen, state, pot.number)
    counters, total = kitchen.fill_timer[pot.number], kitchen.fill_total
    left = least_left(state, counters, total, kitchen.stations, station)
    if station != NONE and kitchen.station_class[station] == kitchen.sink_class:
        # Another sink at which the filling was interrupted may be quicker.
        elsewhere = pot.transport + left
        count = state.counters[counters[station]]
        if count > 0:
            rest = total + 1 - count
            return Stage(0, min(rest, elsewhere), return_walk(rest, pot.walk, scratch))
        return Stage(pot.walk + 1, min(pot.walk + total, elsewhere), 1 if total > 1 else 0)
    start = 0 if left < total else 1
    soonest = pot.transport
    if start == 1 and not is_empty(kitchen, state, pot.number):
        # The other meal is poured, then the pot is carried to the sink: two steps more.
        soonest += 2
    soonest = max(soonest, steps_until_sink(kitchen, state))
    return Stage(pot.transport + start, soonest + left, 1 if left > start else 0)


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
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, pot: Pot, scratch: Scratch
) -> Stage:
    """Return the steps until a meal boils that is in a pot."""
    station = station_of(kitchen, state, pot.number)
    counters, total = kitchen.boil_timer[m][pot.number], kitchen.boil_total
    left = least_left(state, counters, total, kitchen.stations, station)
    start = 0 if left < total else 1
    # After an interruption it is one step less to pour first and then put the pot back on the
    # stove: the water boils in the bowl.
    pours_first = start == 0 and goal.vessel[m] != NONE
    soonest = pot.transport + left - (1 if pours_first else 0)
    back = 1 if left > start else 0
    if station != NONE and kitchen.station_class[station] == kitchen.stove_class:
        count = state.counters[counters[station]]
        if count > 0:
            rest = total + 1 - count
            return Stage(0, min(rest, soonest), return_walk(rest, pot.walk, scratch))
        soonest = min(soonest, pot.walk + total)
        if not pours_first:
            return Stage(pot.walk + 1, soonest, 1 if total > 1 else 0)
        back = 1
    if not pours_first:
        return Stage(pot.transport + start, soonest, back)
    # The meal is poured at the end of the pot's transport. The caller adds `back` and a transport
    # for pouring after every heating, so both are subtracted here.
    if returns_anyway(kitchen, goal, state):
        # The way back to a stove counts with the next meal.
        return Stage(pot.transport - TRANSPORT, soonest, 0)
    # A player walks on to the stove and puts the pot there: two steps.
    return Stage(pot.transport + 2 - (back + TRANSPORT), soonest, back)


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
