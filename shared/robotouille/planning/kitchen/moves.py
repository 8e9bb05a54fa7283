"""What can be done in a compact state, and what becomes of it: the kitchen's transition function.

It says what the domain's actions say (`rules.py` checks that they do). An action is coded as
`kind + 16 x + 4096 y`: PICK x, PUT on x, PROCESS x by y, FILL x, BOIL meal x, ADD to meal x,
POUR meal y into x, MOVE to x. Left out is what cannot be of use: work that the goal does not ask
for, filling more than is wanted, and, for one player, putting something back where it was.
"""

from __future__ import annotations

from robotouille.planning.kitchen.compiled import Ints, kernel
from robotouille.planning.kitchen.layout import (
    ADD,
    BOIL,
    FILL,
    LOOSE,
    MOVE,
    PICK,
    POUR,
    PROCESS,
    PUT,
    ROOT,
    Goals,
    Kitchen,
)

__all__ = ["act", "options", "pack", "pile_place", "running", "spot", "tick"]


@kernel
def code(kind: int, x: int, y: int) -> int:
    """An action as one integer."""
    return kind + 16 * x + 4096 * y


@kernel
def pile_place(k: Kitchen, s: Ints, o: int) -> int:
    """The place at which an object is; beyond all places if it is in a hand or a meal."""
    while s[k.below + o] < k.n:
        o = s[k.below + o]
    under = s[k.below + o]
    return o if under == k.table else under


@kernel
def is_clear(k: Kitchen, s: Ints, o: int) -> bool:
    """Whether nothing is on an object."""
    for other in range(k.items):
        if s[k.below + other] == o:
            return False
    return True


@kernel
def is_free(k: Kitchen, s: Ints, station: int) -> bool:
    """Whether nothing is on a station (by its code)."""
    for o in range(k.n):
        if s[k.below + o] == station:
            return False
    return True


@kernel
def free_tables(k: Kitchen, s: Ints) -> int:
    """How many plain tables have nothing on them."""
    free = k.tables
    for o in range(k.n):
        if s[k.below + o] == k.table:
            free -= 1
    return free


@kernel
def running(k: Kitchen, s: Ints) -> bool:
    """Whether time alone changes something."""
    for i in range(k.timers):
        if s[k.timer_slot[i]] > 0 and s[k.below + k.timer_object[i]] == k.timer_station[i]:
            return True
    return False


@kernel
def tick(k: Kitchen, s: Ints) -> None:
    """Let a step's time pass."""
    for i in range(k.timers):
        slot = k.timer_slot[i]
        if s[slot] > 0 and s[k.below + k.timer_object[i]] == k.timer_station[i]:
            s[slot] += 1
            if s[slot] > k.timer_total[i]:
                s[slot] = 0
                if k.timer_kind[i] == 1:
                    make_meal(k, s, k.timer_effect[i])
                else:
                    finish(k, s, k.timer_effect[i])


@kernel
def finish(k: Kitchen, s: Ints, flag: int) -> None:
    """Set a flag and forget the counters that would set it again."""
    s[flag] = 1
    for i in range(k.timers):
        if k.timer_kind[i] != 1 and k.timer_effect[i] == flag:
            s[k.timer_slot[i]] = 0


@kernel
def make_meal(k: Kitchen, s: Ints, container: int) -> None:
    """Create the next meal in a container."""
    for m in range(k.meals):
        if s[k.inside + m] == 0:
            s[k.inside + m] = container + 1
            return


@kernel
def spot(k: Kitchen, s: Ints, action: int) -> int:
    """The place at which an action is done; a plain table that is free is all the same."""
    kind = action % 16
    x = action // 16 % 256
    if kind == PUT:
        return x if x >= k.n else pile_place(k, s, x)
    if kind in (BOIL, ADD):
        return pile_place(k, s, s[k.inside + x] - 1)
    if kind == MOVE:
        return x
    return pile_place(k, s, x)


@kernel
def act(k: Kitchen, s: Ints, p: int, action: int) -> None:
    """Change a state by an action of a player who stands where it is done."""
    kind = action % 16
    x = action // 16 % 256
    y = action // 4096
    held = s[k.held + p] - 1
    if kind == MOVE:
        s[k.place + p] = x
    elif kind == PICK:
        if s[k.below + x] == k.table:
            s[k.place + p] = k.table
        s[k.below + x] = k.hand + p
        s[k.held + p] = x + 1
        s[LOOSE] = 0
    elif kind == PUT:
        s[k.below + held] = x
        s[k.held + p] = 0
        if x == k.table:
            s[k.place + p] = held
    elif kind == PROCESS:
        process(k, s, x, y)
    elif kind == FILL:
        s[k.fill[(x - k.items) * k.stations + s[k.below + x] - k.n]] = 1
    elif kind == BOIL:
        c = s[k.inside + x] - 1
        at = (x * (k.n - k.items) + c - k.items) * k.stations + s[k.below + c] - k.n
        s[k.boil[at]] = 1
    elif kind == ADD:
        s[k.below + held] = k.meal + x
        s[k.held + p] = 0
    elif kind == POUR:
        s[k.inside + y] = x + 1


@kernel
def process(k: Kitchen, s: Ints, o: int, q: int) -> None:
    """Perform a repeated process once, or start a timed one."""
    at = q * k.items + o
    if k.timed[q]:
        s[k.timer[at * k.stations + s[k.below + o] - k.n]] = 1
    else:
        s[k.done[at]] += 1


@kernel
def is_done(k: Kitchen, s: Ints, q: int, o: int) -> bool:
    """Whether a process has taken effect on an item."""
    at = q * k.items + o
    if k.done[at] < 0:
        return False
    return s[k.done[at]] >= (1 if k.timed[q] else k.total[at])


@kernel
def options(k: Kitchen, g: Goals, s: Ints, p: int, here: bool, out: Ints) -> int:
    """Write the actions of a player into `out`; returns how many.

    With `here`, those at its place; else those anywhere else, to which it would walk first.
    """
    if s[k.held + p] == 0:
        count = empty_handed(k, g, s, out)
    elif s[k.held + p] <= k.items:
        count = with_item(k, g, s, p, out)
    else:
        count = with_container(k, s, p, out)
    place = s[k.place + p]
    kept = 0
    alone = k.players == 1
    for i in range(count):
        at = spot(k, s, out[i])
        if (at == place) != here:
            continue
        if alone and out[i] % 16 == PUT:
            if here and not s[LOOSE]:
                continue
            if at == k.table and place == k.table and not (here and s[LOOSE]):
                continue
        if not here and taken(k, s, p, at):
            continue
        out[kept] = out[i]
        kept += 1
    return kept


@kernel
def taken(k: Kitchen, s: Ints, p: int, place: int) -> bool:
    """Whether somebody else is in the way of a player who wants to go to a place."""
    if k.players == 1:
        return False
    if place == k.table:
        free = free_tables(k, s)
        for other in range(k.players):
            if s[k.place + other] == k.table:
                free -= 1
        return free <= 0
    for other in range(k.players):
        if other != p and s[k.place + other] == place:
            return True
    return False


@kernel
def empty_handed(k: Kitchen, g: Goals, s: Ints, out: Ints) -> int:
    """The actions that need an empty hand."""
    count = 0
    row = s[ROOT]
    for o in range(k.n):
        under = s[k.below + o]
        if under >= k.hand or not is_clear(k, s, o):
            continue
        out[count] = code(PICK, o, 0)
        count += 1
        if o < k.items and k.n <= under < k.table:
            for q in range(k.processes):
                if may_process(k, g, s, row, q, o, under - k.n):
                    out[count] = code(PROCESS, o, q)
                    count += 1
    return count + with_pots(k, g, s, row, out, count)


@kernel
def may_process(k: Kitchen, g: Goals, s: Ints, row: int, q: int, o: int, station: int) -> bool:
    """Whether it is possible and of use to perform a process on a clear item on a station."""
    at = q * k.items + o
    if k.station_class[station] != k.process_class[q]:
        return False
    if not k.able[at] or k.done[at] < 0 or is_done(k, s, q, o):
        return False
    if not g.need[row * k.processes * k.items + at]:
        return False
    if k.after[at] and not is_done(k, s, k.after[at] - 1, o):
        return False
    return not k.timed[q] or s[k.timer[at * k.stations + station]] == 0


@kernel
def with_pots(k: Kitchen, g: Goals, s: Ints, row: int, out: Ints, start: int) -> int:
    """Filling and boiling; written from `start` on."""
    count = 0
    if may_fill(k, g, s, row):
        for c in range(k.items, k.n):
            station = s[k.below + c] - k.n
            if k.is_pot[c] != 1 or not 0 <= station < k.stations:
                continue
            if k.station_class[station] == k.sink_class and holds_nothing(k, s, c):
                if s[k.fill[(c - k.items) * k.stations + station]] == 0:
                    out[start + count] = code(FILL, c, 0)
                    count += 1
    for m in range(k.meals):
        c = s[k.inside + m] - 1
        if c < 0 or k.is_pot[c] != 1 or s[k.boiled + m] or not g.hot[row * k.meals + m]:
            continue
        station = s[k.below + c] - k.n
        if 0 <= station < k.stations and k.station_class[station] == k.stove_class:
            at = (m * (k.n - k.items) + c - k.items) * k.stations + station
            if s[k.boil[at]] == 0:
                out[start + count] = code(BOIL, m, 0)
                count += 1
    return count


@kernel
def holds_nothing(k: Kitchen, s: Ints, c: int) -> bool:
    """Whether a container is empty."""
    for m in range(k.meals):
        if s[k.inside + m] == c + 1:
            return False
    return True


@kernel
def may_fill(k: Kitchen, g: Goals, s: Ints, row: int) -> bool:
    """Whether more water is wanted than there is and is on its way."""
    wanted = 0
    for m in range(k.meals):
        if s[k.inside + m] == 0 and g.wanted[row * k.meals + m]:
            wanted += 1
    for i in range(k.timers):
        if k.timer_kind[i] == 1 and s[k.timer_slot[i]] > 0:
            wanted -= 1
    return wanted > 0


@kernel
def puts(k: Kitchen, s: Ints, p: int, out: Ints) -> int:
    """Putting down what is held, where nothing is."""
    count = 0
    for station in range(k.n, k.n + k.stations):
        if is_free(k, s, station):
            out[count] = code(PUT, station, 0)
            count += 1
    if free_tables(k, s) > 0:
        out[count] = code(PUT, k.table, 0)
        count += 1
    return count


@kernel
def with_item(k: Kitchen, g: Goals, s: Ints, p: int, out: Ints) -> int:
    """The actions with an item in hand."""
    item = s[k.held + p] - 1
    count = puts(k, s, p, out)
    for o in range(k.items):
        if o != item and s[k.below + o] < k.hand and is_clear(k, s, o):
            out[count] = code(PUT, o, 0)
            count += 1
    at = s[ROOT] * k.n + item
    for m in range(k.meals):
        c = s[k.inside + m] - 1
        if c < 0 or k.is_pot[c] != 1 or s[k.below + c] >= k.hand:
            continue
        if g.into[at] == m + 1 or not g.role[at]:
            out[count] = code(ADD, m, 0)
            count += 1
    return count


@kernel
def with_container(k: Kitchen, s: Ints, p: int, out: Ints) -> int:
    """The actions with a container in hand."""
    held = s[k.held + p] - 1
    count = puts(k, s, p, out)
    if k.is_pot[held] != 1:
        return count
    for m in range(k.meals):
        if s[k.inside + m] != held + 1:
            continue
        for c in range(k.items, k.n):
            if k.is_pot[c] == 2 and s[k.below + c] < k.hand and holds_nothing(k, s, c):
                out[count] = code(POUR, c, m)
                count += 1
    return count


@kernel
def pack(k: Kitchen, s: Ints, key: Ints, at: int) -> None:
    """Write a state's key, `words` integers, from `at` on."""
    for i in range(k.words):
        key[at + i] = 0
    for i in range(k.size):
        key[at + k.word[i]] += s[i] << k.shift[i]


@kernel
def unpack(k: Kitchen, key: Ints, at: int, s: Ints) -> None:
    """Read a state from its key."""
    for i in range(k.size - 1, -1, -1):
        value = key[at + k.word[i]] >> k.shift[i]
        if i + 1 < k.size and k.word[i + 1] == k.word[i]:
            value &= (1 << (k.shift[i + 1] - k.shift[i])) - 1
        s[i] = value
