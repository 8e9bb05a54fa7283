"""The work on pots, bowls and what is in them; part of the estimate."""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
    BASE,
    BELOW,
    BOIL_TOTAL,
    BOILED,
    BOILING,
    FILL_TOTAL,
    FILLING,
    HAND,
    HOT,
    INSIDE,
    INTO,
    IS_POT,
    ITEMS,
    MEAL,
    MEALS,
    OBJECTS,
    SINK_CLASS,
    STATION_CLASS,
    STATIONS,
    STOVE_CLASS,
    TABLE,
    TIMER_KIND,
    TIMER_SLOT,
    TIMERS,
    VESSEL,
    WANTED,
)
from robotouille.planners.kitchen.heuristic.scratch_rows import (
    CHAIN,
    CHAIN_OF_MEALS,
    DEAD,
    FIRST,
    LEAVES,
    LEGS,
    NEEDS,
    SHARED,
    WET,
    WORK,
)
from robotouille.planners.kitchen.heuristic.walks import carry, walk_to
from robotouille.planners.kitchen.kernels import Ints, kernel

__all__ = ["unmade", "vessels"]


@kernel
def vessels(k: Ints, g: Ints, s: Ints, row: int, w: Ints) -> bool:
    """Note the work on the meals of the goal and their vessels; False if one is lost."""
    for c in range(k[ITEMS], k[OBJECTS]):
        if g[g[BASE] + row * k[OBJECTS] + c] and s[k[BELOW] + c] != k[TABLE]:
            bring(k, s, c, w)
    open_meals = 0
    w[SHARED] = 1 if meals_to_cook(k, g, s, row) > 1 else 0
    for m in range(k[MEALS]):
        at = row * k[MEALS] + m
        if not g[g[WANTED] + at]:
            continue
        c = s[k[INSIDE] + m] - 1
        vessel = g[g[VESSEL] + at] - 1
        if c >= 0 and (c == vessel or k[k[IS_POT] + c] != 1):
            if vessel >= 0 and c != vessel:
                return False
            if not poured(k, g, s, row, m, w):
                return False
        else:
            if not cook_in(k, g, s, row, m, c, open_meals, w):
                return False
            open_meals += 1
    return True


@kernel
def meals_to_cook(k: Ints, g: Ints, s: Ints, row: int) -> int:
    """How many meals of the goal are in a pot, or in none yet."""
    count = 0
    for m in range(k[MEALS]):
        c = s[k[INSIDE] + m] - 1
        if g[g[WANTED] + row * k[MEALS] + m] and (c < 0 or k[k[IS_POT] + c] == 1):
            count += 1
    return count


@kernel
def bring(k: Ints, s: Ints, c: int, w: Ints) -> None:
    """A container has to be brought to a plain table."""
    w[LEGS + c] += 1
    if s[k[BELOW] + c] >= k[HAND]:
        w[WORK + c] += 1 + carry(k, s)
    else:
        w[WORK + c] += 3 + walk_to(k, s, c, w)
        w[LEAVES + c] = 1
    w[CHAIN + c] = w[WORK + c]


@kernel
def poured(k: Ints, g: Ints, s: Ints, row: int, m: int, w: Ints) -> bool:
    """A meal that is where it has to be: it can still come to the boil, since boiling goes on as
    long as the pot is on the stove. False if that was never started, or something is missing."""
    for o in range(k[ITEMS]):
        if g[g[INTO] + row * k[OBJECTS] + o] == m + 1 and s[k[BELOW] + o] != k[MEAL] + m:
            return False
    if not g[g[HOT] + row * k[MEALS] + m] or s[k[BOILED] + m]:
        return True
    soonest = DEAD
    least = DEAD
    chosen = -1
    for c in range(k[ITEMS], k[OBJECTS]):
        for station in range(k[STATIONS]):
            slot = k[
                k[BOILING] + (m * (k[OBJECTS] - k[ITEMS]) + c - k[ITEMS]) * k[STATIONS] + station
            ]
            if slot < 0 or s[slot] == 0:
                continue
            left = k[BOIL_TOTAL] + 1 - s[slot]
            work = 0
            if s[k[BELOW] + c] != k[OBJECTS] + station:
                held = s[k[BELOW] + c] >= k[HAND]
                work = 1 + carry(k, s) if held else 3 + walk_to(k, s, c, w)
                left += work - 1
            soonest = min(soonest, left)
            least = min(least, work)
            if chosen >= 0:
                w[SHARED] = 1
            chosen = c
    if chosen < 0:
        return False
    w[CHAIN_OF_MEALS] = max(w[CHAIN_OF_MEALS], soonest)
    w[WORK + chosen] += least
    return True


@kernel
def unmade(k: Ints, g: Ints, s: Ints, row: int, m: int) -> bool:
    """Whether a meal of the goal is still to be started: no water, and none on its way."""
    if not g[g[WANTED] + row * k[MEALS] + m] or s[k[INSIDE] + m] > 0:
        return False
    for i in range(k[TIMERS]):
        if k[k[TIMER_KIND] + i] == 1 and s[k[k[TIMER_SLOT] + i]] > 0:
            return False
    return True


@kernel
def cook_in(k: Ints, g: Ints, s: Ints, row: int, m: int, pot: int, number: int, w: Ints) -> bool:
    """Note the work on a meal that is in a pot, or in none yet: then in the nearest.

    With more than one such meal the same pot may do for all, and comes from the last bowl.
    """
    best = DEAD
    chain = DEAD
    wet = 0
    chosen = -1
    choices = 0
    for c in range(k[ITEMS], k[OBJECTS]):
        if k[k[IS_POT] + c] != 1 or (pot >= 0 and c != pot):
            continue
        choices += 1
        packed = route(k, g, s, row, m, c, w)
        cost = packed % 64
        best = min(best, cost)
        chain = min(chain, packed // 64 % 1024)
        wet = max(wet, packed // 65536)
        chosen = c
    if choices == 0:
        return False
    w[CHAIN_OF_MEALS] = max(w[CHAIN_OF_MEALS], chain)
    w[WET] += wet
    w[WORK + chosen] += best if number == 0 else max(0, best - 3)
    if choices == 1 and best > 0 and not w[SHARED]:
        needs(k, g, s, row, m, chosen, w)
    elif best > 0:
        w[SHARED] = 1
        for c in range(k[ITEMS], k[OBJECTS]):
            if k[k[IS_POT] + c] == 1 and (pot < 0 or c == pot):
                w[LEAVES + c] = 1
    return True


@kernel
def needs(k: Ints, g: Ints, s: Ints, row: int, m: int, c: int, w: Ints) -> None:
    """Note the legs of the only pot there is for a meal."""
    under = s[k[BELOW] + c]
    station = under - k[OBJECTS]
    at = k[k[STATION_CLASS] + station] if 0 <= station < k[STATIONS] else -1
    first = 0
    if s[k[INSIDE] + m] == 0 and at != k[SINK_CLASS]:
        w[NEEDS + c] |= 1 << k[SINK_CLASS]
        first = k[SINK_CLASS] + 1
        w[LEGS + c] += 1
    boils = g[g[HOT] + row * k[MEALS] + m] and not s[k[BOILED] + m]
    if boils and (at != k[STOVE_CLASS] or s[k[INSIDE] + m] == 0):
        w[NEEDS + c] |= 1 << k[STOVE_CLASS]
        if first == 0:
            first = k[STOVE_CLASS] + 1
        w[LEGS + c] += 1
    if g[g[VESSEL] + row * k[MEALS] + m]:
        w[LEGS + c] += 1
    w[FIRST + c] = first
    if under < k[HAND] and w[LEGS + c] > 0:
        w[LEAVES + c] = 1


@kernel
def route(k: Ints, g: Ints, s: Ints, row: int, m: int, c: int, w: Ints) -> int:
    """What a meal in a certain pot takes: `work + 64 chain + 65536 wet`.

    `wet` counts the walks to the pot while there is water in it.
    """
    under = s[k[BELOW] + c]
    held = under >= k[HAND]
    station = under - k[OBJECTS] if k[OBJECTS] <= under < k[TABLE] else -1
    walk = 0 if held else walk_to(k, s, c, w)
    first = 1 + carry(k, s) if held else 3 + walk
    dry = s[k[INSIDE] + m] == 0
    work, chain, again = 0, 0, walk
    if dry:
        work, chain, again = filling(k, s, c, station, walk, first)
    wet = 0
    boils = g[g[HOT] + row * k[MEALS] + m] and not s[k[BOILED] + m]
    pours = g[g[VESSEL] + row * k[MEALS] + m] > 0
    if boils:
        wet = again
        more, later, again = heating(k, s, m, c, station, dry, first, again, pours)
        if more == 0:
            wet = 0
        work += more
        chain += later
    if pours and held and not dry and not boils:
        work += first
        chain += first
    elif pours:
        work += again + 3
        wet += again
        chain += 3 if dry or boils else 3 + again
    return work + 64 * chain + 65536 * wet


@kernel
def filling(k: Ints, s: Ints, c: int, station: int, walk: int, first: int) -> tuple[int, int, int]:
    """Work and chain until there is water in a pot, and whether one has to come back for it."""
    if station >= 0 and k[k[STATION_CLASS] + station] == k[SINK_CLASS]:
        count = s[k[k[FILLING] + (c - k[ITEMS]) * k[STATIONS] + station]]
        if count > 0:
            return 0, k[FILL_TOTAL] + 1 - count, 1
        return walk + 1, walk + k[FILL_TOTAL], 1 if k[FILL_TOTAL] > 1 else 0
    left = k[FILL_TOTAL]
    start = 1
    for i in range(k[STATIONS]):
        slot = k[k[FILLING] + (c - k[ITEMS]) * k[STATIONS] + i]
        if slot >= 0 and s[slot] > 0:
            start = 0
            left = min(left, k[FILL_TOTAL] - s[slot])
    return first + start, first + left, 1 if left > start else 0


@kernel
def heating(
    k: Ints, s: Ints, m: int, c: int, station: int, dry: bool, first: int, again: int, pours: bool
) -> tuple[int, int, int]:
    """Work and chain until a meal boils, and whether one has to come back for it.

    Where boiling was interrupted, it is one step less to pour first and then put the pot back: the
    water boils in the bowl.
    """
    left = k[BOIL_TOTAL]
    start = 1
    boiling_here = False
    for i in range(k[STATIONS]):
        slot = k[k[BOILING] + (m * (k[OBJECTS] - k[ITEMS]) + c - k[ITEMS]) * k[STATIONS] + i]
        if slot >= 0 and s[slot] > 0:
            start = 0
            here = i == station and not dry
            boiling_here = boiling_here or here
            left = min(left, k[BOIL_TOTAL] - s[slot] + (1 if here else 0))
    if boiling_here:
        return 0, left, 1
    if not dry and station >= 0 and k[k[STATION_CLASS] + station] == k[STOVE_CLASS]:
        return again + 1, again + k[BOIL_TOTAL], 1 if k[BOIL_TOTAL] > 1 else 0
    back = 1 if left > start else 0
    if dry:
        return again + 3 + start, 3 + left, back
    if start == 0 and pours:
        return first - 1 - back, first + left - 1, back
    return first + start, first + left, back
