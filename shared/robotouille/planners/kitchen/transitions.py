"""What can be done in a compact state, and what becomes of it: the kitchen's transition function.

It says what the domain's actions say (`rules.py` checks that they do). An action is coded as
`kind + 16 x + 1024 y`: PICK x, PUT on x, PROCESS x by y, FILL x, BOIL meal x, ADD to meal x,
POUR meal y into x, MOVE to x. Left out is what cannot be of use: work that the goal does not ask
for, filling more than is wanted, and, for one player, putting something back where it was.
"""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
    ABLE,
    ADD,
    AFTER,
    BELOW,
    BOIL,
    BOILED,
    BOILING,
    DONE,
    FILL,
    FILLING,
    HAND,
    HELD,
    HOT,
    INSIDE,
    INTO,
    IS_POT,
    ITEMS,
    LOOSE,
    MEAL,
    MEALS,
    MOVE,
    NEED,
    OBJECTS,
    PICK,
    PLACE,
    PLAYERS,
    POUR,
    PROCESS,
    PROCESS_CLASS,
    PROCESSES,
    PUT,
    ROLE,
    ROOT,
    SHIFT,
    SINK_CLASS,
    SIZE,
    STATION_CLASS,
    STATIONS,
    STOVE_CLASS,
    TABLE,
    TABLES,
    TIMED,
    TIMER,
    TIMER_EFFECT,
    TIMER_KIND,
    TIMER_OBJECT,
    TIMER_SLOT,
    TIMER_STATION,
    TIMER_TOTAL,
    TIMERS,
    TOTAL,
    WANTED,
    WORD,
    WORDS,
)
from robotouille.planners.kitchen.kernels import Ints, kernel

__all__ = [
    "act",
    "holds_nothing",
    "in_order",
    "is_done",
    "options",
    "pack",
    "pile_place",
    "running",
    "spot",
    "tick",
    "unpack",
    "walks",
]


@kernel
def code(kind: int, x: int, y: int) -> int:
    """An action as one integer."""
    return kind + 16 * x + 1024 * y


@kernel
def pile_place(k: Ints, s: Ints, o: int) -> int:
    """The place at which an object is; beyond all places if it is in a hand or a meal."""
    while s[k[BELOW] + o] < k[OBJECTS]:
        o = s[k[BELOW] + o]
    under = s[k[BELOW] + o]
    return o if under == k[TABLE] else under


@kernel
def is_clear(k: Ints, s: Ints, o: int) -> bool:
    """Whether nothing is on an object."""
    for other in range(k[ITEMS]):
        if s[k[BELOW] + other] == o:
            return False
    return True


@kernel
def is_free(k: Ints, s: Ints, station: int) -> bool:
    """Whether nothing is on a station (by its code)."""
    for o in range(k[OBJECTS]):
        if s[k[BELOW] + o] == station:
            return False
    return True


@kernel
def free_tables(k: Ints, s: Ints) -> int:
    """How many plain tables have nothing on them."""
    free = k[TABLES]
    for o in range(k[OBJECTS]):
        if s[k[BELOW] + o] == k[TABLE]:
            free -= 1
    return free


@kernel
def running(k: Ints, s: Ints) -> bool:
    """Whether time alone changes something."""
    for i in range(k[TIMERS]):
        if (
            s[k[k[TIMER_SLOT] + i]] > 0
            and s[k[BELOW] + k[k[TIMER_OBJECT] + i]] == k[k[TIMER_STATION] + i]
        ):
            return True
    return False


@kernel
def tick(k: Ints, s: Ints) -> None:
    """Let a step's time pass."""
    for i in range(k[TIMERS]):
        slot = k[k[TIMER_SLOT] + i]
        if s[slot] > 0 and s[k[BELOW] + k[k[TIMER_OBJECT] + i]] == k[k[TIMER_STATION] + i]:
            s[slot] += 1
            if s[slot] > k[k[TIMER_TOTAL] + i]:
                s[slot] = 0
                if k[k[TIMER_KIND] + i] == 1:
                    make_meal(k, s, k[k[TIMER_EFFECT] + i])
                else:
                    finish(k, s, k[k[TIMER_EFFECT] + i])


@kernel
def finish(k: Ints, s: Ints, flag: int) -> None:
    """Set a flag and forget the counters that would set it again."""
    s[flag] = 1
    for i in range(k[TIMERS]):
        if k[k[TIMER_KIND] + i] != 1 and k[k[TIMER_EFFECT] + i] == flag:
            s[k[k[TIMER_SLOT] + i]] = 0


@kernel
def make_meal(k: Ints, s: Ints, container: int) -> None:
    """Create the next meal in a container."""
    for m in range(k[MEALS]):
        if s[k[INSIDE] + m] == 0:
            s[k[INSIDE] + m] = container + 1
            return


@kernel
def spot(k: Ints, s: Ints, action: int) -> int:
    """The place at which an action is done; a plain table that is free is all the same."""
    kind = action % 16
    x = action // 16 % 64
    if kind == PUT:
        return x if x >= k[OBJECTS] else pile_place(k, s, x)
    if kind in (BOIL, ADD):
        return pile_place(k, s, s[k[INSIDE] + x] - 1)
    if kind == MOVE:
        return x
    return pile_place(k, s, x)


@kernel
def act(k: Ints, s: Ints, p: int, action: int) -> None:
    """Change a state by an action of a player who stands where it is done."""
    kind = action % 16
    x = action // 16 % 64
    y = action // 1024
    held = s[k[HELD] + p] - 1
    if kind == MOVE:
        s[k[PLACE] + p] = x
    elif kind == PICK:
        if s[k[BELOW] + x] == k[TABLE]:
            s[k[PLACE] + p] = k[TABLE]
        s[k[BELOW] + x] = k[HAND] + p
        s[k[HELD] + p] = x + 1
        s[LOOSE] = 0
    elif kind == PUT:
        s[k[BELOW] + held] = x
        s[k[HELD] + p] = 0
        if x == k[TABLE]:
            s[k[PLACE] + p] = held
    elif kind == PROCESS:
        process(k, s, x, y)
    elif kind == FILL:
        s[k[k[FILLING] + (x - k[ITEMS]) * k[STATIONS] + s[k[BELOW] + x] - k[OBJECTS]]] = 1
    elif kind == BOIL:
        c = s[k[INSIDE] + x] - 1
        at = (
            (x * (k[OBJECTS] - k[ITEMS]) + c - k[ITEMS]) * k[STATIONS]
            + s[k[BELOW] + c]
            - k[OBJECTS]
        )
        s[k[k[BOILING] + at]] = 1
    elif kind == ADD:
        s[k[BELOW] + held] = k[MEAL] + x
        s[k[HELD] + p] = 0
    elif kind == POUR:
        s[k[INSIDE] + y] = x + 1


@kernel
def process(k: Ints, s: Ints, o: int, q: int) -> None:
    """Perform a repeated process once, or start a timed one."""
    at = q * k[ITEMS] + o
    if k[k[TIMED] + q]:
        s[k[k[TIMER] + at * k[STATIONS] + s[k[BELOW] + o] - k[OBJECTS]]] = 1
    else:
        s[k[k[DONE] + at]] += 1


@kernel
def is_done(k: Ints, s: Ints, q: int, o: int) -> bool:
    """Whether a process has taken effect on an item."""
    at = q * k[ITEMS] + o
    if k[k[DONE] + at] < 0:
        return False
    return s[k[k[DONE] + at]] >= (1 if k[k[TIMED] + q] else k[k[TOTAL] + at])


@kernel
def options(k: Ints, g: Ints, s: Ints, p: int, here: bool, out: Ints, start: int) -> int:
    """Write the actions of a player into `out`, from `start` on; returns how many.

    With `here`, those at its place; else those anywhere else, to which it would walk first.
    """
    if s[k[HELD] + p] == 0:
        count = empty_handed(k, g, s, out, start)
    elif s[k[HELD] + p] <= k[ITEMS]:
        count = with_item(k, g, s, p, out, start)
    else:
        count = with_container(k, s, p, out, start)
    kept = start
    for i in range(start, start + count):
        if (spot(k, s, out[i]) == s[k[PLACE] + p]) == here and is_of_use(k, s, p, here, out[i]):
            out[kept] = out[i]
            kept += 1
    return kept - start


@kernel
def is_of_use(k: Ints, s: Ints, p: int, here: bool, action: int) -> bool:
    """Whether one player does not just put something back, or on another table that is alike."""
    if k[PLAYERS] > 1 or action % 16 != PUT:
        return True
    if here:
        return bool(s[LOOSE])
    return action // 16 % 64 != k[TABLE] or s[k[PLACE] + p] != k[TABLE]


@kernel
def walks(k: Ints, s: Ints, p: int, out: Ints, start: int) -> int:
    """Write the walks of one of several players into `out`, from `start` on; returns how many."""
    count = 0
    for place in range(k[TABLE] + 1):
        if place == s[k[PLACE] + p] or (place < k[OBJECTS] and s[k[BELOW] + place] != k[TABLE]):
            continue
        if not taken(k, s, p, place):
            out[start + count] = code(MOVE, place, 0)
            count += 1
    return count


@kernel
def in_order(k: Ints, s: Ints, who: Ints) -> None:
    """Bring several players into the order of their places, for they are alike; and `who` too."""
    for i in range(1, k[PLAYERS]):
        for p in range(i, 0, -1):
            place, held = s[k[PLACE] + p], s[k[HELD] + p]
            before, hold = s[k[PLACE] + p - 1], s[k[HELD] + p - 1]
            if before * 64 + hold <= place * 64 + held:
                break
            s[k[PLACE] + p], s[k[HELD] + p] = before, hold
            s[k[PLACE] + p - 1], s[k[HELD] + p - 1] = place, held
            who[p], who[p - 1] = who[p - 1], who[p]
    for p in range(k[PLAYERS]):
        if s[k[HELD] + p]:
            s[k[BELOW] + s[k[HELD] + p] - 1] = k[HAND] + p


@kernel
def taken(k: Ints, s: Ints, p: int, place: int) -> bool:
    """Whether somebody else is in the way of a player who wants to go to a place."""
    if k[PLAYERS] == 1:
        return False
    if place == k[TABLE]:
        free = free_tables(k, s)
        for other in range(k[PLAYERS]):
            if s[k[PLACE] + other] == k[TABLE]:
                free -= 1
        return free <= 0
    for other in range(k[PLAYERS]):
        if other != p and s[k[PLACE] + other] == place:
            return True
    return False


@kernel
def empty_handed(k: Ints, g: Ints, s: Ints, out: Ints, start: int) -> int:
    """The actions that need an empty hand."""
    count = 0
    row = s[ROOT]
    for o in range(k[OBJECTS]):
        under = s[k[BELOW] + o]
        if under >= k[HAND] or not is_clear(k, s, o):
            continue
        out[start + count] = code(PICK, o, 0)
        count += 1
        if o < k[ITEMS] and k[OBJECTS] <= under < k[TABLE]:
            for q in range(k[PROCESSES]):
                if may_process(k, g, s, row, q, o, under - k[OBJECTS]):
                    out[start + count] = code(PROCESS, o, q)
                    count += 1
    return count + with_pots(k, g, s, row, out, start + count)


@kernel
def may_process(k: Ints, g: Ints, s: Ints, row: int, q: int, o: int, station: int) -> bool:
    """Whether it is possible and of use to perform a process on a clear item on a station."""
    at = q * k[ITEMS] + o
    if k[k[STATION_CLASS] + station] != k[k[PROCESS_CLASS] + q]:
        return False
    if not k[k[ABLE] + at] or k[k[DONE] + at] < 0 or is_done(k, s, q, o):
        return False
    if not g[g[NEED] + row * k[PROCESSES] * k[ITEMS] + at]:
        return False
    if k[k[AFTER] + at] and not is_done(k, s, k[k[AFTER] + at] - 1, o):
        return False
    return not k[k[TIMED] + q] or s[k[k[TIMER] + at * k[STATIONS] + station]] == 0


@kernel
def with_pots(k: Ints, g: Ints, s: Ints, row: int, out: Ints, start: int) -> int:
    """Filling and boiling; written from `start` on."""
    count = 0
    if may_fill(k, g, s, row):
        for c in range(k[ITEMS], k[OBJECTS]):
            station = s[k[BELOW] + c] - k[OBJECTS]
            if k[k[IS_POT] + c] != 1 or not 0 <= station < k[STATIONS]:
                continue
            idle = s[k[k[FILLING] + (c - k[ITEMS]) * k[STATIONS] + station]] == 0
            at_sink = k[k[STATION_CLASS] + station] == k[SINK_CLASS]
            if at_sink and idle and holds_nothing(k, s, c):
                out[start + count] = code(FILL, c, 0)
                count += 1
    for m in range(k[MEALS]):
        c = s[k[INSIDE] + m] - 1
        if c < 0 or k[k[IS_POT] + c] != 1 or s[k[BOILED] + m] or not g[g[HOT] + row * k[MEALS] + m]:
            continue
        station = s[k[BELOW] + c] - k[OBJECTS]
        if 0 <= station < k[STATIONS] and k[k[STATION_CLASS] + station] == k[STOVE_CLASS]:
            at = (m * (k[OBJECTS] - k[ITEMS]) + c - k[ITEMS]) * k[STATIONS] + station
            if s[k[k[BOILING] + at]] == 0:
                out[start + count] = code(BOIL, m, 0)
                count += 1
    return count


@kernel
def holds_nothing(k: Ints, s: Ints, c: int) -> bool:
    """Whether a container is empty."""
    for m in range(k[MEALS]):
        if s[k[INSIDE] + m] == c + 1:
            return False
    return True


@kernel
def may_fill(k: Ints, g: Ints, s: Ints, row: int) -> bool:
    """Whether more water is wanted than there is and is on its way."""
    wanted = 0
    for m in range(k[MEALS]):
        if s[k[INSIDE] + m] == 0 and g[g[WANTED] + row * k[MEALS] + m]:
            wanted += 1
    for i in range(k[TIMERS]):
        if k[k[TIMER_KIND] + i] == 1 and s[k[k[TIMER_SLOT] + i]] > 0:
            wanted -= 1
    return wanted > 0


@kernel
def puts(k: Ints, s: Ints, out: Ints, start: int) -> int:
    """Putting down what is held, where nothing is."""
    count = 0
    for station in range(k[OBJECTS], k[OBJECTS] + k[STATIONS]):
        if is_free(k, s, station):
            out[start + count] = code(PUT, station, 0)
            count += 1
    if free_tables(k, s) > 0:
        out[start + count] = code(PUT, k[TABLE], 0)
        count += 1
    return count


@kernel
def with_item(k: Ints, g: Ints, s: Ints, p: int, out: Ints, start: int) -> int:
    """The actions with an item in hand."""
    item = s[k[HELD] + p] - 1
    count = puts(k, s, out, start)
    for o in range(k[ITEMS]):
        if o != item and s[k[BELOW] + o] < k[HAND] and is_clear(k, s, o):
            out[start + count] = code(PUT, o, 0)
            count += 1
    at = s[ROOT] * k[OBJECTS] + item
    for m in range(k[MEALS]):
        c = s[k[INSIDE] + m] - 1
        if c < 0 or k[k[IS_POT] + c] != 1 or s[k[BELOW] + c] >= k[HAND]:
            continue
        if g[g[INTO] + at] == m + 1 or not g[g[ROLE] + at]:
            out[start + count] = code(ADD, m, 0)
            count += 1
    return count


@kernel
def with_container(k: Ints, s: Ints, p: int, out: Ints, start: int) -> int:
    """The actions with a container in hand."""
    held = s[k[HELD] + p] - 1
    count = puts(k, s, out, start)
    if k[k[IS_POT] + held] != 1:
        return count
    for m in range(k[MEALS]):
        if s[k[INSIDE] + m] != held + 1:
            continue
        for c in range(k[ITEMS], k[OBJECTS]):
            if k[k[IS_POT] + c] == 2 and s[k[BELOW] + c] < k[HAND] and holds_nothing(k, s, c):
                out[start + count] = code(POUR, c, m)
                count += 1
    return count


@kernel
def pack(k: Ints, s: Ints, key: Ints, at: int) -> None:
    """Write a state's key, `words` integers, from `at` on."""
    for i in range(k[WORDS]):
        key[at + i] = 0
    for i in range(k[SIZE]):
        key[at + k[k[WORD] + i]] += s[i] << k[k[SHIFT] + i]


@kernel
def unpack(k: Ints, key: Ints, at: int, s: Ints) -> None:
    """Read a state from its key."""
    for i in range(k[SIZE] - 1, -1, -1):
        value = key[at + k[k[WORD] + i]] >> k[k[SHIFT] + i]
        if i + 1 < k[SIZE] and k[k[WORD] + i + 1] == k[k[WORD] + i]:
            value &= (1 << (k[k[SHIFT] + i + 1] - k[k[SHIFT] + i])) - 1
        s[i] = value
