"""The heuristic's work on meals of the goal, and on the pots and bowls that contain them.

The relaxation considers each meal alone, with the pot that suits it best. The pot is brought to a
sink, filled, brought to a stove, boiled, brought to the bowl and poured, as far as these actions
are still needed. Each transport counts as pick up, walk and put down. A walk to the pot comes
first, and a walk back follows each delay of more than a step.

The sum is a lower bound, since each of these steps is about the pot or its meal, and no item's work
counts steps about pots. Two cases are subtracted again:

* A player who adds an item to the meal stands at the pot afterwards and need not walk back. So
  walks to a pot with water (`Scratch.water_walks`) are subtracted once for each item that may have
  been added (`Scratch.maybe_added`).
* One pot may serve several meals. The first meal counts with the cheapest pot. Each further meal
  counts `SAVED_IN_TURN` steps less, and still less if the pot may contain two meals.

A pot that is brought to a stove serves all meals that were heated in it there, also those that were
poured too soon. So the work to bring it back counts once, and not at all if the pot is brought to a
stove for the next meal.
"""

from __future__ import annotations

from robotouille.planning.kitchen.applicable import is_empty
from robotouille.planning.kitchen.bound.meal_route import TRANSPORT, route, still_boils
from robotouille.planning.kitchen.bound.scratch import DEAD_END, Scratch, walk_before_put, walk_to
from robotouille.planning.kitchen.compact_state import (
    FILLING,
    NONE,
    POT,
    CompactState,
    GoalSpec,
    Kitchen,
)
from robotouille.planning.kitchen.kernels import kernel

SAVED_IN_TURN = 3
"""Steps that a further meal of a pot may save.

The pot may still be in hand after pouring, so nobody walks to it and picks it up. And nobody has to
wait for a meal that can boil on in its bowl.
"""


@kernel
def add_vessel_work(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, scratch: Scratch
) -> bool:
    """Note the work on the goal's meals and their vessels. Return False if a meal is lost."""
    for c in range(kitchen.items, kitchen.objects):
        if goal.on_table[c] and state.below[c] != kitchen.table_code:
            add_serving(kitchen, state, c, scratch)
    cooked = 0
    scratch.pots_open = 1 if meals_to_cook(kitchen, goal, state) > 1 else 0
    for pot in range(kitchen.items, kitchen.objects):
        add_return_of_pot(kitchen, goal, state, pot, scratch)
    for m in range(kitchen.meals):
        if not goal.wanted_meal[m]:
            continue
        container = state.inside[m] - 1
        vessel = goal.vessel[m]
        if container >= 0 and (container == vessel or kitchen.container_kind[container] != POT):
            # Only pots can be poured, so a meal in a wrong bowl stays there.
            if vessel not in (NONE, container):
                return False
            if not add_meal_in_vessel(kitchen, goal, state, m, scratch):
                return False
        else:
            if not add_cooking(kitchen, goal, state, m, container, cooked, scratch):
                return False
            cooked += 1
    turns = turns_at_sinks(kitchen, goal, state)
    if may_fill_twice(kitchen, state):
        turns = 0
    if turns > 0 and scratch.filling_chain < DEAD_END:
        # A pot is filled, taken away and replaced: the player leaves, and the next one fills.
        later = (turns - 1) * (kitchen.fill_total + 3)
        scratch.meal_chain = max(scratch.meal_chain, scratch.filling_chain + later)
    return True


@kernel
def turns_at_sinks(kitchen: Kitchen, goal: GoalSpec, state: CompactState) -> int:
    """Return how many pots have to be filled one after another, without those being filled."""
    unfilled = 0
    for m in range(kitchen.meals):
        if goal.wanted_meal[m] and state.inside[m] == 0:
            unfilled += 1
    for pot in range(kitchen.items, kitchen.objects):
        if is_filling(kitchen, state, pot):
            unfilled -= 1
    return -(-unfilled // max(1, sinks(kitchen)))


@kernel
def is_filling(kitchen: Kitchen, state: CompactState, pot: int) -> bool:
    """Return whether the filling of a pot was started."""
    for station in range(kitchen.stations):
        counter = kitchen.fill_timer[pot][station]
        if counter != NONE and state.counters[counter] > 0:
            return True
    return False


@kernel
def meals_to_cook(kitchen: Kitchen, goal: GoalSpec, state: CompactState) -> int:
    """Return the number of the goal's meals that are in a pot or do not exist yet."""
    count = 0
    for m in range(kitchen.meals):
        container = state.inside[m] - 1
        if goal.wanted_meal[m] and (container < 0 or kitchen.container_kind[container] == POT):
            count += 1
    return count


@kernel
def add_serving(kitchen: Kitchen, state: CompactState, c: int, scratch: Scratch) -> None:
    """Note that a container has to be brought to a plain table."""
    scratch.deliveries[c] += 1
    if state.below[c] >= kitchen.hand_code:
        scratch.work[c] += 1 + walk_with_bowl(kitchen, state, c)
    else:
        scratch.work[c] += 3 + walk_to(kitchen, state, c, scratch)
        scratch.leaves[c] = 1
    scratch.chain[c] = scratch.work[c]


@kernel
def walk_with_bowl(kitchen: Kitchen, state: CompactState, c: int) -> int:
    """Return 1 if a held container has to be carried elsewhere before it can be served, else 0."""
    if kitchen.players == 1:
        return walk_before_put(kitchen, state)
    return 0 if state.place[state.below[c] - kitchen.hand_code] == kitchen.table_code else 1


@kernel
def add_meal_in_vessel(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, scratch: Scratch
) -> bool:
    """Note the chain of a meal that is in its final vessel. Return False if the meal is lost."""
    for o in range(kitchen.items):
        if goal.added_to[o] == m and state.below[o] != kitchen.meal_code + m:
            return False
    if not still_boils(goal, state, m):
        return True
    soonest = DEAD_END
    for pot in range(kitchen.items, kitchen.objects):
        for station in range(kitchen.stations):
            counter = kitchen.boil_timer[m][pot][station]
            if counter == NONE or state.counters[counter] == 0:
                continue
            left = kitchen.boil_total + 1 - state.counters[counter]
            work = work_to_put_back(kitchen, state, pot, station, scratch)
            soonest = min(soonest, left + max(0, work - 1))
    scratch.meal_chain = max(scratch.meal_chain, soonest)
    return soonest < DEAD_END


@kernel
def work_to_put_back(
    kitchen: Kitchen, state: CompactState, pot: int, station: int, scratch: Scratch
) -> int:
    """Return the least work to bring a pot to a stove.

    A player of a team who holds the pot may stand at the stove already.
    """
    if state.below[pot] == kitchen.objects + station:
        return 0
    if state.below[pot] >= kitchen.hand_code:
        return 1 + walk_before_put(kitchen, state)
    return TRANSPORT + walk_to(kitchen, state, pot, scratch)


@kernel
def add_return_of_pot(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, pot: int, scratch: Scratch
) -> None:
    """Note the work to bring a pot to a stove for meals that were poured before they boiled."""
    work = 0
    for m in range(kitchen.meals):
        container = state.inside[m] - 1
        is_poured = container >= 0 and kitchen.container_kind[container] != POT
        if not goal.wanted_meal[m] or not is_poured or not still_boils(goal, state, m):
            continue
        least = DEAD_END
        for station in range(kitchen.stations):
            counter = kitchen.boil_timer[m][pot][station]
            if counter != NONE and state.counters[counter] > 0:
                least = min(least, work_to_put_back(kitchen, state, pot, station, scratch))
        # One return serves all meals: no sum, since their delays run at the same time.
        if least < DEAD_END:
            work = max(work, least)
    if work == 0:
        return
    scratch.leaves[pot] = 1
    for m in range(kitchen.meals):
        if goal.wanted_meal[m] and state.inside[m] in (0, pot + 1):
            # The order of the pot's deliveries is open.
            scratch.pots_open = 1
            if still_boils(goal, state, m):
                # The work on this meal may contain the way to that stove.
                return
            # After that meal was poured, the pot only has to be carried to the stove.
            work = min(work, 2)
    if not is_empty(kitchen, state, pot):
        scratch.water_walks += max(0, work - 3)
    scratch.work[pot] += work


@kernel
def is_unmade(kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int) -> bool:
    """Return whether a meal of the goal has no water and none is on its way."""
    if not goal.wanted_meal[m] or state.inside[m] > 0:
        return False
    for timer in range(kitchen.timers):
        is_filling = kitchen.timer_kind[timer] == FILLING
        if is_filling and state.counters[kitchen.timer_counter[timer]] > 0:
            return False
    return True


@kernel
def add_cooking(
    kitchen: Kitchen,
    goal: GoalSpec,
    state: CompactState,
    m: int,
    only_pot: int,
    cooked: int,
    scratch: Scratch,
) -> bool:
    """Note the work on a meal that is in the pot `only_pot`, or in none yet if it is NONE.

    `cooked` meals were handled before; the pot of the last one may serve for this meal.
    """
    least = DEAD_END
    soonest = DEAD_END
    walks = 0
    chosen = NONE
    candidates = 0
    for pot in range(kitchen.items, kitchen.objects):
        if kitchen.container_kind[pot] != POT or only_pot not in (NONE, pot):
            continue
        candidates += 1
        # The minimum over all pots is a lower bound, whichever pot a plan uses.
        work, chain, water_walks = route(kitchen, goal, state, m, pot, scratch)
        least = min(least, work)
        soonest = min(soonest, chain)
        if only_pot == NONE and not is_filling(kitchen, state, pot):
            scratch.filling_chain = min(scratch.filling_chain, chain)
        walks = max(walks, water_walks)
        chosen = pot
    if candidates == 0:
        return False
    scratch.meal_chain = max(scratch.meal_chain, soonest)
    scratch.water_walks += walks
    if not shares_pot(goal, state, m):
        saved = 0
        if cooked > 0:
            saved = SAVED_IN_TURN + saved_by_filling_twice(kitchen, state)
        scratch.work[chosen] += max(0, least - saved)
    if candidates == 1 and least > 0 and not scratch.pots_open:
        add_pot_deliveries(kitchen, goal, state, m, chosen, scratch)
    elif least > 0:
        scratch.pots_open = 1
        for pot in range(kitchen.items, kitchen.objects):
            # An undetermined pot counts as leaving, so that clearing its station costs nothing
            # extra.
            is_candidate = only_pot in (NONE, pot)
            if kitchen.container_kind[pot] == POT and is_candidate:
                scratch.leaves[pot] = 1
    return True


@kernel
def saved_by_filling_twice(kitchen: Kitchen, state: CompactState) -> int:
    """Return the steps that a meal may save because its pot contains two meals."""
    # One transport to the stove serves both meals.
    if may_fill_twice(kitchen, state):
        return TRANSPORT
    # To interrupt the first filling, a player first carries the pot to the other sink. The walk
    # and putting it down take two of these steps.
    can_interrupt = sinks(kitchen) > 1 and kitchen.fill_total > 1
    return TRANSPORT - 2 if can_interrupt else 0


@kernel
def may_fill_twice(kitchen: Kitchen, state: CompactState) -> bool:
    """Return whether a pot may get a second meal because its filling was interrupted."""
    # The interrupted filling goes on at its sink, also after another sink has filled the pot.
    if sinks(kitchen) < 2:
        return False
    for pot in range(kitchen.items, kitchen.objects):
        for station in range(kitchen.stations):
            counter = kitchen.fill_timer[pot][station]
            if counter != NONE and state.counters[counter] > 0:
                is_here = state.below[pot] == kitchen.objects + station
                if not is_here or not is_empty(kitchen, state, pot):
                    return True
    return False


@kernel
def sinks(kitchen: Kitchen) -> int:
    """Return the number of sinks."""
    count = 0
    for station in range(kitchen.stations):
        if kitchen.station_class[station] == kitchen.sink_class:
            count += 1
    return count


@kernel
def shares_pot(goal: GoalSpec, state: CompactState, m: int) -> bool:
    """Return whether an earlier meal of the goal is in the same pot."""
    # The work on one of the meals is a lower bound for both.
    for other in range(m):
        if goal.wanted_meal[other] and 0 < state.inside[m] == state.inside[other]:
            return True
    return False


@kernel
def add_pot_deliveries(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, pot: int, scratch: Scratch
) -> None:
    """Note the deliveries of the only pot for a meal."""
    under = state.below[pot]
    station = under - kitchen.objects
    here = kitchen.station_class[station] if 0 <= station < kitchen.stations else NONE
    first = NONE
    is_dry = state.inside[m] == 0
    if is_dry and here != kitchen.sink_class:
        scratch.stops[pot] |= 1 << kitchen.sink_class
        first = kitchen.sink_class
        scratch.deliveries[pot] += 1
    if goal.boiling[m] and not state.boiled[m] and (here != kitchen.stove_class or is_dry):
        scratch.stops[pot] |= 1 << kitchen.stove_class
        if first == NONE:
            first = kitchen.stove_class
        scratch.deliveries[pot] += 1
    if goal.vessel[m] != NONE:
        scratch.deliveries[pot] += 1
    scratch.first_stop[pot] = first
    if under < kitchen.hand_code and scratch.deliveries[pot] > 0:
        scratch.leaves[pot] = 1
