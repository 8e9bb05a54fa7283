"""A lower bound of the steps to the goal: the search's compass, and half of its proofs.

Every action of a player moves it, or is about one object: so the steps that each object of the goal
still needs add up. A *leg* takes an object from one place to another: pick up, walk, put down.
Before it somebody has to walk there, unless the last thing done there was about the same object.
Added to that are:

* what lies in the way and has to be taken somewhere else (`obstacles.py`);
* stops that no order of the legs can avoid (`detours.py`);
* nothing for delays, during which other work can be done; but no sooner than its longest chain of
  events, delays included, can the goal be met.

The estimate is the larger of the work (divided among the players) and the longest chain. The tests
compare it with exact distances.
"""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
    ABLE,
    AFTER,
    ATOP,
    BASE,
    BELOW,
    DONE,
    HAND,
    HELD,
    INTO,
    IS_POT,
    ITEMS,
    MEAL,
    MEALS,
    NEED,
    OBJECTS,
    PILE,
    PLAYERS,
    PROCESS_CLASS,
    PROCESSES,
    ROLE,
    ROOT,
    STATION_CLASS,
    STATIONS,
    TABLE,
    TIMED,
    TIMER,
    TOP,
    TOTAL,
    VESSEL,
)
from robotouille.planners.kitchen.heuristic.cycle_cover import detours
from robotouille.planners.kitchen.heuristic.obstacles import crowded_stations, obstacles
from robotouille.planners.kitchen.heuristic.scratch_rows import (
    ABOVE,
    CHAIN,
    CHAIN_OF_MEALS,
    CLEAR_ONLY,
    DEAD,
    FIRST,
    HERE,
    JOINED,
    LEAVES,
    LEGS,
    NEEDS,
    SHARED,
    TOTALS,
    WET,
    WORK,
)
from robotouille.planners.kitchen.heuristic.vessels import vessels
from robotouille.planners.kitchen.heuristic.walks import carry, walk_to
from robotouille.planners.kitchen.kernels import Ints, kernel
from robotouille.planners.kitchen.transitions import is_done

__all__ = ["estimate"]


@kernel
def estimate(k: Ints, g: Ints, s: Ints, w: Ints) -> int:
    """Steps that are needed at least; DEAD where the goal cannot be met any more."""
    survey(k, s, w)
    row = s[ROOT]
    for o in range(k[ITEMS]):
        if g[g[ROLE] + row * k[OBJECTS] + o] and not item(k, g, s, row, o, w):
            return DEAD
    if not vessels(k, g, s, row, w):
        return DEAD
    obstacles(k, g, s, row, w)
    total = crowded_stations(k, s, w)
    longest = w[CHAIN_OF_MEALS]
    for o in range(k[OBJECTS]):
        total += w[WORK + o]
        chain = w[CHAIN + o]
        if chain > 0:
            longest = max(longest, chain + followers(k, g, s, row, o, w))
    if total == 0:
        return longest
    if k[PLAYERS] > 1:
        total -= min(w[WET], w[JOINED]) + 2 * min(k[PLAYERS], w[CLEAR_ONLY])
        return max(longest, -(-total // k[PLAYERS]))
    total += useless_in_hand(k, s, w)
    total -= min(w[WET], w[JOINED]) + 2 * min(1, w[CLEAR_ONLY])
    return max(longest, total + detours(k, g, s, row, w))


@kernel
def survey(k: Ints, s: Ints, w: Ints) -> None:
    """Clear the scratch space, and note what is on what."""
    for o in range(k[OBJECTS]):
        w[ABOVE + o] = -1
        w[LEGS + o] = 0
        w[HERE + o] = 0
        w[LEAVES + o] = 0
        w[NEEDS + o] = 0
        w[FIRST + o] = 0
        w[WORK + o] = 0
        w[CHAIN + o] = 0
    for i in range(TOTALS, TOTALS + 8):
        w[i] = 0
    for o in range(k[ITEMS]):
        under = s[k[BELOW] + o]
        if under < k[OBJECTS]:
            w[ABOVE + under] = o


@kernel
def in_place(k: Ints, g: Ints, s: Ints, at: int, o: int) -> bool:
    """Whether an item is where the goal wants it, as far as what is below it tells."""
    if g[g[BASE] + at]:
        return s[k[BELOW] + o] == k[TABLE]
    if g[g[ATOP] + at] and s[k[BELOW] + o] != g[g[ATOP] + at] - 1:
        return False
    if g[g[PILE] + at]:
        foot = o
        while s[k[BELOW] + foot] < k[OBJECTS]:
            foot = s[k[BELOW] + foot]
        return foot == g[g[PILE] + at] - 1
    return True


@kernel
def item(k: Ints, g: Ints, s: Ints, row: int, o: int, w: Ints) -> bool:
    """Note the work on an item of the goal and its chain of events; False if it is lost."""
    at = row * k[OBJECTS] + o
    under = s[k[BELOW] + o]
    stops = stops_of(k, g, s, row, o, under - k[OBJECTS], w)
    if under >= k[MEAL]:
        return g[g[INTO] + at] == under - k[MEAL] + 1 and stops == 0
    if stops < 0:
        return False
    placed = g[g[BASE] + at] or g[g[ATOP] + at] or g[g[PILE] + at] or g[g[INTO] + at]
    held = under >= k[HAND]
    legs = stops
    if placed and (stops > 0 or g[g[INTO] + at] or held or not in_place(k, g, s, at, o)):
        legs += 1
    if g[g[INTO] + at]:
        w[JOINED] += 1
    w[LEGS + o] = legs
    w[CHAIN + o] += 3 * legs
    if legs == 0 and w[HERE + o] == 0:
        return True
    w[WORK + o] += 3 * legs
    if held:
        saved = 2 - carry(k, s) if legs else 0
        w[WORK + o] -= saved
        w[CHAIN + o] -= saved
        return True
    w[LEAVES + o] = 1 if legs else 0
    if w[HERE + o] == 0 and runs(k, g, s, row, o, under - k[OBJECTS]):
        w[WORK + o] += 1
    else:
        walk = walk_to(k, s, o, w)
        w[WORK + o] += walk
        w[CHAIN + o] += walk
    return True


@kernel
def stops_of(k: Ints, g: Ints, s: Ints, row: int, o: int, station: int, w: Ints) -> int:
    """How many stations an item has to be brought to; notes the work there. -1 if impossible.

    A timed process needs somebody to come back for the item, or to stay: one more step.
    """
    stops = 0
    choices = 0
    back = 0
    here = 0 <= station < k[STATIONS]
    at_row = g[g[BASE] + row * k[OBJECTS] + o] or g[g[ATOP] + row * k[OBJECTS] + o]
    placed = at_row or g[g[PILE] + row * k[OBJECTS] + o] or g[g[INTO] + row * k[OBJECTS] + o]
    for q in range(k[PROCESSES]):
        at = q * k[ITEMS] + o
        if not g[g[NEED] + row * k[PROCESSES] * k[ITEMS] + at] or is_done(k, s, q, o):
            continue
        if not k[k[ABLE] + at] or k[k[DONE] + at] < 0:
            return -1
        waits = k[k[AFTER] + at] > 0 and not is_done(k, s, k[k[AFTER] + at] - 1, o)
        if here and not waits and k[k[STATION_CLASS] + station] == k[k[PROCESS_CLASS] + q]:
            back += work_here(k, s, at, o, station, w)
            continue
        stops += 1
        w[NEEDS + o] |= 1 << k[k[PROCESS_CLASS] + q]
        if not waits and w[HERE + o] == 0:
            choices += 1
            w[FIRST + o] = k[k[PROCESS_CLASS] + q] + 1 if choices == 1 else 0
        back += work_there(k, s, q, at, o, w)
    if not placed:
        back = max(0, back - 1)
    w[WORK + o] += back
    return stops


@kernel
def work_here(k: Ints, s: Ints, at: int, o: int, station: int, w: Ints) -> int:
    """Note the work of a process where an item is; returns 1 if one has to come back for it."""
    if not k[k[TIMED] + at // k[ITEMS]]:
        left = k[k[TOTAL] + at] - s[k[k[DONE] + at]]
        w[HERE + o] = 1
        w[WORK + o] += left
        w[CHAIN + o] += left
        return 0
    count = s[k[k[TIMER] + at * k[STATIONS] + station]]
    if count > 0:
        w[CHAIN + o] += k[k[TOTAL] + at] + 1 - count
        return 0
    w[HERE + o] = 1
    w[WORK + o] += 1
    w[CHAIN + o] += k[k[TOTAL] + at]
    return 1 if k[k[TOTAL] + at] > 1 else 0


@kernel
def work_there(k: Ints, s: Ints, q: int, at: int, o: int, w: Ints) -> int:
    """Note the work of a process at another station; returns 1 if one has to come back for it.

    A delay that was interrupted goes on in the very step in which the item is put back.
    """
    if not k[k[TIMED] + q]:
        left = k[k[TOTAL] + at] - s[k[k[DONE] + at]]
        w[WORK + o] += left
        w[CHAIN + o] += left
        return 0
    left = k[k[TOTAL] + at]
    start = 1
    for station in range(k[STATIONS]):
        slot = k[k[TIMER] + at * k[STATIONS] + station]
        if slot >= 0 and s[slot] > 0:
            start = 0
            left = min(left, k[k[TOTAL] + at] - s[slot])
    w[WORK + o] += start
    w[CHAIN + o] += left
    return 1 if left > start else 0


@kernel
def runs(k: Ints, g: Ints, s: Ints, row: int, o: int, station: int) -> bool:
    """Whether a wanted process runs on an item where it is."""
    if not 0 <= station < k[STATIONS]:
        return False
    for q in range(k[PROCESSES]):
        at = q * k[ITEMS] + o
        if g[g[NEED] + row * k[PROCESSES] * k[ITEMS] + at] and k[k[TIMED] + q]:
            slot = k[k[TIMER] + at * k[STATIONS] + station]
            if slot >= 0 and s[slot] > 0:
                return True
    return False


@kernel
def followers(k: Ints, g: Ints, s: Ints, row: int, o: int, w: Ints) -> int:
    """Steps that have to follow the last leg of an object.

    What goes on top of it is placed by somebody who has to fetch it, if there is one player, or
    by somebody who takes the other's place.
    """
    at = row * k[OBJECTS] + o
    each = 4 if k[PLAYERS] == 1 else 2
    if w[LEGS + o] == 0 or o >= k[ITEMS]:
        return 0
    if g[g[INTO] + at]:
        m = g[g[INTO] + at] - 1
        return 3 if g[g[VESSEL] + row * k[MEALS] + m] else 0
    later = 0
    for other in range(k[ITEMS]):
        if other == o or w[LEGS + other] == 0:
            continue
        also = row * k[OBJECTS] + other
        if (
            (g[g[BASE] + at] and g[g[PILE] + also] == o + 1)
            or (
                g[g[PILE] + at]
                and g[g[PILE] + also] == g[g[PILE] + at]
                and g[g[TOP] + also]
                and not g[g[TOP] + at]
            )
            or (g[g[ATOP] + also] and rests_on(k, g, row, other, o))
        ):
            later += each
    return later


@kernel
def rests_on(k: Ints, g: Ints, row: int, upper: int, lower: int) -> bool:
    """Whether the goal wants an item directly or indirectly on another, piece by piece."""
    for _ in range(k[ITEMS]):
        upper = g[g[ATOP] + row * k[OBJECTS] + upper] - 1
        if upper == lower:
            return True
        if upper < 0:
            return False
    return False


@kernel
def useless_in_hand(k: Ints, s: Ints, w: Ints) -> int:
    """What it takes to get rid of something on which no work is left."""
    held = s[k[HELD]] - 1
    if held < 0 or w[WORK + held] > 0:
        return 0
    if w[SHARED] and k[k[IS_POT] + held] == 1:
        return 0
    if held < k[ITEMS]:
        w[JOINED] += 1
    return 1 + carry(k, s)
