"""The work on meals of the goal, and on the pots and bowls they are in.

*What is relaxed.* As for items: each meal is alone, with the pot that suits it best. From where
the pot is it is brought to a sink, filled, brought to a stove, boiled, brought to the bowl and
poured, as far as that is still to be done: pick up, walk, put down for each, a walk to the pot
before, and a walk back after each delay of more than a step.

*Why it is a lower bound.* Each of these steps is about the pot (or the meal in it), and no item's
work counts steps about pots. Two exceptions are taken off again:

* Whoever adds an item to the meal stands at the pot afterwards, and has no walk back to it. So the
  walks to a pot with water in it (`Scratch.water_walks`) are taken off once for each thing that may
  have been added (`Scratch.maybe_added`).
* One pot may serve several meals. Where several are to be cooked, the first costs the least over
  all pots, and each further one 3 steps less: the pot comes from the last bowl, so it may be in
  hand already.

*Cost.* For each meal a loop over pots and stations.
"""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
    FILLING,
    NONE,
    POT,
    CompactState,
    Goal,
    Kitchen,
)
from robotouille.planners.kitchen.heuristic.scratch import DEAD_END, Scratch
from robotouille.planners.kitchen.heuristic.walks import walk_before_put, walk_to
from robotouille.planners.kitchen.kernels import kernel

__all__ = ["add_vessel_work", "is_unmade"]


@kernel
def add_vessel_work(kitchen: Kitchen, goal: Goal, state: CompactState, scratch: Scratch) -> bool:
    """Note the work on the meals of the goal and their vessels; False if one is lost."""
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
            if vessel not in (NONE, container):
                return False
            if not add_work_in_vessel(kitchen, goal, state, m, scratch):
                return False
        else:
            if not add_cooking(kitchen, goal, state, m, container, cooked, scratch):
                return False
            cooked += 1
    return True


@kernel
def meals_to_cook(kitchen: Kitchen, goal: Goal, state: CompactState) -> int:
    """How many meals of the goal are in a pot, or in none yet."""
    count = 0
    for m in range(kitchen.meals):
        container = state.inside[m] - 1
        if goal.wanted_meal[m] and (container < 0 or kitchen.container_kind[container] == POT):
            count += 1
    return count


@kernel
def add_serving(kitchen: Kitchen, state: CompactState, c: int, scratch: Scratch) -> None:
    """A container has to be brought to a plain table."""
    scratch.deliveries[c] += 1
    if state.below[c] >= kitchen.hand_code:
        scratch.work[c] += 1 + walk_before_put(kitchen, state)
    else:
        scratch.work[c] += 3 + walk_to(kitchen, state, c, scratch)
        scratch.leaves[c] = 1
    scratch.chain[c] = scratch.work[c]


@kernel
def add_work_in_vessel(
    kitchen: Kitchen, goal: Goal, state: CompactState, m: int, scratch: Scratch
) -> bool:
    """A meal that is where it has to be: it can still come to the boil, since boiling goes on as
    long as the pot is on the stove. False if that was never started, or something is missing."""
    for o in range(kitchen.items):
        if goal.added_to[o] == m and state.below[o] != kitchen.meal_code + m:
            return False
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
def is_unmade(kitchen: Kitchen, goal: Goal, state: CompactState, m: int) -> bool:
    """Whether a meal of the goal is still to be started: no water, and none on its way."""
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
    goal: Goal,
    state: CompactState,
    m: int,
    only_pot: int,
    cooked: int,
    scratch: Scratch,
) -> bool:
    """Note the work on a meal that is in a pot, or (`only_pot` is NONE) in none yet: then in the
    pot that takes least. `cooked` meals were dealt with before; their last pot may do for this."""
    least = DEAD_END
    soonest = DEAD_END
    walks = 0
    chosen = NONE
    candidates = 0
    for pot in range(kitchen.items, kitchen.objects):
        if kitchen.container_kind[pot] != POT or only_pot not in (NONE, pot):
            continue
        candidates += 1
        work, chain, water_walks = route(kitchen, goal, state, m, pot, scratch)
        least = min(least, work)
        soonest = min(soonest, chain)
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
            is_candidate = only_pot in (NONE, pot)
            if kitchen.container_kind[pot] == POT and is_candidate:
                scratch.leaves[pot] = 1
    return True


@kernel
def add_pot_deliveries(
    kitchen: Kitchen, goal: Goal, state: CompactState, m: int, pot: int, scratch: Scratch
) -> None:
    """Note the deliveries of the only pot there is for a meal."""
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
    kitchen: Kitchen, goal: Goal, state: CompactState, m: int, pot: int, scratch: Scratch
) -> tuple[int, int, int]:
    """What a meal in a certain pot takes: work, chain, and the walks to the pot while there is
    water in it."""
    under = state.below[pot]
    is_held = under >= kitchen.hand_code
    station = under - kitchen.objects if kitchen.objects <= under < kitchen.table_code else NONE
    walk = 0 if is_held else walk_to(kitchen, state, pot, scratch)
    first = 1 + walk_before_put(kitchen, state) if is_held else 3 + walk
    is_dry = state.inside[m] == 0
    work, chain, back = 0, 0, walk
    if is_dry:
        work, chain, back = filling(kitchen, state, pot, station, walk, first)
    water_walks = 0
    boils = goal.boiling[m] and not state.boiled[m]
    pours = goal.vessel[m] != NONE
    if boils:
        water_walks = back
        more, later, back = heating(kitchen, state, m, pot, station, is_dry, first, back, pours)
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
    return work, chain, water_walks


@kernel
def filling(
    kitchen: Kitchen, state: CompactState, pot: int, station: int, walk: int, first: int
) -> tuple[int, int, int]:
    """Work and chain until there is water in a pot, and whether one has to come back for it.

    `walk` leads to the pot, and `first` is what it takes to bring it to another station.
    """
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
    return first + start, first + left, 1 if left > start else 0


@kernel
def heating(
    kitchen: Kitchen,
    state: CompactState,
    m: int,
    pot: int,
    station: int,
    is_dry: bool,
    first: int,
    back: int,
    pours: bool,
) -> tuple[int, int, int]:
    """Work and chain until a meal boils, and whether one has to come back for it.

    Where boiling was interrupted, it is one step less to pour first and then put the pot back: the
    water boils in the bowl.
    """
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
    if start == 0 and pours:
        return first - 1 - returns, first + left - 1, returns
    return first + start, first + left, returns
