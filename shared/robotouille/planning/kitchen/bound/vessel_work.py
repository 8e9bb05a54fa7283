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
  counts 3 steps less, because the pot may still be in hand after it was poured.
"""

from __future__ import annotations

from robotouille.planning.kitchen.applicable import is_empty
from robotouille.planning.kitchen.bound.scratch import DEAD_END, Scratch, walk_before_put, walk_to
from robotouille.planning.kitchen.compact_state import (
    BOWL,
    FILLING,
    NONE,
    POT,
    CompactState,
    GoalSpec,
    Kitchen,
)
from robotouille.planning.kitchen.kernels import kernel
from robotouille.planning.kitchen.transitions import place_of_object


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
    for m in range(kitchen.meals):
        if not goal.wanted_meal[m]:
            continue
        container = state.inside[m] - 1
        vessel = goal.vessel[m]
        if container >= 0 and (container == vessel or kitchen.container_kind[container] != POT):
            # Only pots can be poured, so a meal in a wrong bowl stays there.
            if vessel not in (NONE, container):
                return False
            if not add_work_in_vessel(kitchen, goal, state, m, scratch):
                return False
        else:
            if not add_cooking(kitchen, goal, state, m, container, cooked, scratch):
                return False
            cooked += 1
    turns = turns_at_sinks(kitchen, goal, state)
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
    sinks = 0
    for station in range(kitchen.stations):
        if kitchen.station_class[station] == kitchen.sink_class:
            sinks += 1
    return -(-unfilled // max(1, sinks))


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
def add_work_in_vessel(
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, scratch: Scratch
) -> bool:
    """Note the work on a meal that is in its final vessel. Return False if the meal is lost."""
    for o in range(kitchen.items):
        if goal.added_to[o] == m and state.below[o] != kitchen.meal_code + m:
            return False
    # Boiling continues while the pot is on the stove, even after the meal was poured.
    if not goal.boiling[m] or state.boiled[m]:
        return True
    soonest = DEAD_END
    least = DEAD_END
    chosen = NONE
    for pot in range(kitchen.items, kitchen.objects):
        for station in range(kitchen.stations):
            counter = kitchen.boil_timer[m][pot][station]
            if counter == NONE or state.counters[counter] == 0:
                continue
            left = kitchen.boil_total + 1 - state.counters[counter]
            work = 0
            if state.below[pot] != kitchen.objects + station:
                if state.below[pot] >= kitchen.hand_code:
                    work = 1 + walk_before_put(kitchen, state)
                else:
                    work = 3 + walk_to(kitchen, state, pot, scratch)
                left += work - 1
            soonest = min(soonest, left)
            least = min(least, work)
            if chosen != NONE:
                scratch.pots_open = 1
            chosen = pot
    if chosen == NONE:
        return False
    scratch.meal_chain = max(scratch.meal_chain, soonest)
    scratch.work[chosen] += least
    return True


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
    scratch.work[chosen] += least if cooked == 0 else max(0, least - 3)
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
        work, chain, back = filling(kitchen, state, pot, walk, first)
    water_walks = 0
    boils = goal.boiling[m] and not state.boiled[m]
    pours = goal.vessel[m] != NONE
    if boils:
        water_walks = back
        more, later, back = heating(kitchen, goal, state, m, pot, first, back)
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
def station_of(kitchen: Kitchen, state: CompactState, o: int) -> int:
    """Return the station with a purpose on which an object stands, or NONE."""
    station = state.below[o] - kitchen.objects
    return station if 0 <= station < kitchen.stations else NONE


@kernel
def filling(
    kitchen: Kitchen, state: CompactState, pot: int, walk: int, first: int
) -> tuple[int, int, int]:
    """Return work and chain until a pot contains water, and whether a player has to come back.

    `walk` is the walk to the pot; `first` is the work to bring it to another station.
    """
    station = station_of(kitchen, state, pot)
    if station != NONE and kitchen.station_class[station] == kitchen.sink_class:
        count = state.counters[kitchen.fill_timer[pot][station]]
        if count > 0:
            return 0, kitchen.fill_total + 1 - count, 1
        return walk + 1, walk + kitchen.fill_total, 1 if kitchen.fill_total > 1 else 0
    left = kitchen.fill_total
    start = 1
    for i in range(kitchen.stations):
        counter = kitchen.fill_timer[pot][i]
        if counter != NONE and state.counters[counter] > 0:
            start = 0
            left = min(left, kitchen.fill_total - state.counters[counter])
    # A pot with another meal is poured and carried to the sink: two steps more.
    soonest = first if is_empty(kitchen, state, pot) else first + 2
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
    kitchen: Kitchen, goal: GoalSpec, state: CompactState, m: int, pot: int, first: int, back: int
) -> tuple[int, int, int]:
    """Return work and chain until a meal boils, and whether a player has to come back.

    `back` is the walk to the pot once it contains water; `first` is the work to bring it elsewhere.
    """
    station = station_of(kitchen, state, pot)
    is_dry = state.inside[m] == 0
    left = kitchen.boil_total
    start = 1
    boils_here = False
    for i in range(kitchen.stations):
        counter = kitchen.boil_timer[m][pot][i]
        if counter != NONE and state.counters[counter] > 0:
            start = 0
            here = i == station and not is_dry
            boils_here = boils_here or here
            left = min(left, kitchen.boil_total - state.counters[counter] + (1 if here else 0))
    if boils_here:
        return 0, left, 1
    if not is_dry and station != NONE and kitchen.station_class[station] == kitchen.stove_class:
        return back + 1, back + kitchen.boil_total, 1 if kitchen.boil_total > 1 else 0
    returns = 1 if left > start else 0
    if is_dry:
        return back + 3 + start, 3 + left, returns
    # After an interruption it is one step less to pour first and then put the pot back on the
    # stove: the water boils in the bowl.
    if start == 0 and goal.vessel[m] != NONE:
        return first - 1 - returns, first + left - 1, returns
    return first + start, first + left, returns
