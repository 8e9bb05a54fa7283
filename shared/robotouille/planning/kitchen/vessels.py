"""The work on pots, bowls and what is in them; part of the estimate."""

from __future__ import annotations

from robotouille.planning.kitchen.compiled import Ints, kernel
from robotouille.planning.kitchen.layout import Goals, Kitchen
from robotouille.planning.kitchen.moves import holds_nothing
from robotouille.planning.kitchen.rows import (
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
from robotouille.planning.kitchen.walks import carry, walk_to

__all__ = ["unmade", "vessels"]


@kernel
def vessels(k: Kitchen, g: Goals, s: Ints, row: int, w: Ints) -> bool:
    """Note the work on the meals of the goal and their vessels; False if one is lost."""
    for c in range(k.items, k.n):
        if g.base[row * k.n + c] and s[k.below + c] != k.table:
            bring(k, s, c, w)
    open_meals = 0
    w[SHARED] = 1 if meals_to_cook(k, g, s, row) > 1 else 0
    for m in range(k.meals):
        at = row * k.meals + m
        if not g.wanted[at]:
            continue
        c = s[k.inside + m] - 1
        vessel = g.vessel[at] - 1
        if c >= 0 and (c == vessel or k.is_pot[c] != 1):
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
def meals_to_cook(k: Kitchen, g: Goals, s: Ints, row: int) -> int:
    """How many meals of the goal are in a pot, or in none yet."""
    count = 0
    for m in range(k.meals):
        c = s[k.inside + m] - 1
        if g.wanted[row * k.meals + m] and (c < 0 or k.is_pot[c] == 1):
            count += 1
    return count


@kernel
def bring(k: Kitchen, s: Ints, c: int, w: Ints) -> None:
    """A container has to be brought to a plain table."""
    w[LEGS + c] += 1
    if s[k.below + c] >= k.hand:
        w[WORK + c] += 1 + carry(k, s)
    else:
        w[WORK + c] += 3 + walk_to(k, s, c, w)
        w[LEAVES + c] = 1
    w[CHAIN + c] = w[WORK + c]


@kernel
def poured(k: Kitchen, g: Goals, s: Ints, row: int, m: int, w: Ints) -> bool:
    """A meal that is where it has to be: it can still come to the boil, since boiling goes on as
    long as the pot is on the stove. False if that was never started, or something is missing."""
    for o in range(k.items):
        if g.into[row * k.n + o] == m + 1 and s[k.below + o] != k.meal + m:
            return False
    if not g.hot[row * k.meals + m] or s[k.boiled + m]:
        return True
    soonest = DEAD
    least = DEAD
    chosen = -1
    for c in range(k.items, k.n):
        for station in range(k.stations):
            slot = k.boil[(m * (k.n - k.items) + c - k.items) * k.stations + station]
            if slot < 0 or s[slot] == 0:
                continue
            left = k.boil_total + 1 - s[slot]
            work = 0
            if s[k.below + c] != k.n + station:
                held = s[k.below + c] >= k.hand
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
def unmade(k: Kitchen, g: Goals, s: Ints, row: int, m: int) -> bool:
    """Whether a meal of the goal is still to be started: no water, and none on its way."""
    if not g.wanted[row * k.meals + m] or s[k.inside + m] > 0:
        return False
    for i in range(k.timers):
        if k.timer_kind[i] == 1 and s[k.timer_slot[i]] > 0:
            return False
    return True


@kernel
def cook_in(
    k: Kitchen, g: Goals, s: Ints, row: int, m: int, pot: int, number: int, w: Ints
) -> bool:
    """Note the work on a meal that is in a pot, or in none yet: then in the nearest.

    With more than one such meal the same pot may do for all, and comes from the last bowl.
    """
    best = DEAD
    chain = DEAD
    wet = 0
    chosen = -1
    choices = 0
    for c in range(k.items, k.n):
        if k.is_pot[c] != 1 or (pot >= 0 and c != pot):
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
        for c in range(k.items, k.n):
            if k.is_pot[c] == 1 and (pot < 0 or c == pot):
                w[LEAVES + c] = 1
    return True


@kernel
def needs(k: Kitchen, g: Goals, s: Ints, row: int, m: int, c: int, w: Ints) -> None:
    """Note the legs of the only pot there is for a meal."""
    under = s[k.below + c]
    station = under - k.n
    at = k.station_class[station] if 0 <= station < k.stations else -1
    first = 0
    if s[k.inside + m] == 0 and at != k.sink_class:
        w[NEEDS + c] |= 1 << k.sink_class
        first = k.sink_class + 1
        w[LEGS + c] += 1
    boils = g.hot[row * k.meals + m] and not s[k.boiled + m]
    if boils and (at != k.stove_class or s[k.inside + m] == 0):
        w[NEEDS + c] |= 1 << k.stove_class
        if first == 0:
            first = k.stove_class + 1
        w[LEGS + c] += 1
    if g.vessel[row * k.meals + m]:
        w[LEGS + c] += 1
    w[FIRST + c] = first
    if under < k.hand and w[LEGS + c] > 0:
        w[LEAVES + c] = 1


@kernel
def route(k: Kitchen, g: Goals, s: Ints, row: int, m: int, c: int, w: Ints) -> int:
    """What a meal in a certain pot takes: `work + 64 chain + 65536 wet`.

    `wet` counts the walks to the pot while there is water in it. Where boiling was interrupted,
    it is one step less to pour first and then put the pot back: the water boils in the bowl.
    """
    under = s[k.below + c]
    held = under >= k.hand
    station = under - k.n if k.n <= under < k.table else -1
    wet = 0
    first = 1 + carry(k, s) if held else 3 + walk_to(k, s, c, w)
    walk = 0 if held else walk_to(k, s, c, w)
    legs = 0
    work = 0
    chain = 0
    if s[k.inside + m] == 0:
        if station >= 0 and k.station_class[station] == k.sink_class:
            count = s[k.fill[(c - k.items) * k.stations + station]]
            if count > 0:
                chain += k.fill_total + 1 - count
            else:
                work += walk + 1
                chain += walk + k.fill_total
            again = 1 if count > 0 or k.fill_total > 1 else 0
        else:
            left = k.fill_total
            start = 1
            for i in range(k.stations):
                slot = k.fill[(c - k.items) * k.stations + i]
                if slot >= 0 and s[slot] > 0:
                    start = 0
                    left = min(left, k.fill_total - s[slot])
            work += first + start
            chain += first + left
            again = 1 if left > start else 0
        legs = 1
    else:
        again = walk
        if held:
            legs = 0
    boils = g.hot[row * k.meals + m] and not s[k.boiled + m]
    pours = g.vessel[row * k.meals + m] > 0
    if boils:
        at_stove = station >= 0 and k.station_class[station] == k.stove_class and legs == 0
        left = k.boil_total
        start = 1
        on_station = 0
        for i in range(k.stations):
            slot = k.boil[(m * (k.n - k.items) + c - k.items) * k.stations + i]
            if slot >= 0 and s[slot] > 0:
                start = 0
                if i == station and legs == 0:
                    on_station = 1
                    left = min(left, k.boil_total + 1 - s[slot])
                else:
                    left = min(left, k.boil_total - s[slot])
        if at_stove and on_station:
            chain += left
            again = 1
        elif at_stove:
            work += again + 1
            wet += again
            chain += again + k.boil_total
            again = 1 if k.boil_total > 1 else 0
        elif legs == 0:
            work += first + start
            chain += first + left
            wet += again
            again = 1 if left > start else 0
            legs = 1
            if start == 0 and pours:
                work -= 1 + again
                chain -= 1
        else:
            work += again + 3 + start
            wet += again
            chain += 3 + left
            again = 1 if left > start else 0
    if pours:
        if held and legs == 0 and not boils:
            work += first
            chain += first
        else:
            work += again + 3
            wet += again
            chain += 3
            if not boils and legs == 0:
                chain += again
    return work + 64 * chain + 65536 * wet
