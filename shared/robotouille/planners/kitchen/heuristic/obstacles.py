"""What lies in the way; part of the estimate."""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
    ATOP,
    BASE,
    BELOW,
    CLASSES,
    INTO,
    ITEMS,
    OBJECTS,
    PILE,
    PLAYERS,
    ROLE,
    STATION_CLASS,
    STATIONS,
    TABLE,
    TOP,
)
from robotouille.planners.kitchen.heuristic.scratch_rows import (
    ABOVE,
    CHAIN,
    CLEAR_ONLY,
    DEAD,
    HERE,
    JOINED,
    LEAVES,
    LEGS,
    NEEDS,
    WORK,
)
from robotouille.planners.kitchen.heuristic.walks import walk_to
from robotouille.planners.kitchen.kernels import Ints, kernel

__all__ = ["crowded_stations", "obstacles"]


@kernel
def obstacles(k: Ints, g: Ints, s: Ints, row: int, w: Ints) -> None:
    """Note what has to be taken off what, until nothing more follows from it."""
    changed = True
    while changed:
        changed = False
        for o in range(k[ITEMS]):
            if w[LEAVES + o] or s[k[BELOW] + o] >= k[TABLE]:
                continue
            under = s[k[BELOW] + o]
            if under < k[OBJECTS] and w[LEAVES + under] + w[HERE + under] > 0:
                remove(k, g, s, row, o, w)
                changed = True
            elif under < k[OBJECTS] and must_be_clear(k, g, row, under, o, w):
                w[CLEAR_ONLY] += 0 if has_place(k, g, row * k[OBJECTS] + o) else 1
                remove(k, g, s, row, o, w)
                changed = True
            elif is_finished_too_soon(k, g, row, o, w):
                remove(k, g, s, row, o, w)
                changed = True
        for o in range(k[ITEMS]):
            on_table = s[k[BELOW] + o] == k[TABLE]
            if on_table and not w[LEAVES + o] and is_finished_too_soon(k, g, row, o, w):
                remove(k, g, s, row, o, w)
                changed = True


@kernel
def remove(k: Ints, g: Ints, s: Ints, row: int, o: int, w: Ints) -> None:
    """An object has to leave its place, where nothing else would have made it leave.

    If that is where it belongs it has to come back, and with one player to lie elsewhere meanwhile.
    """
    w[LEAVES + o] = 1
    if w[LEGS + o] > 0:
        return
    at = row * k[OBJECTS] + o
    placed = has_place(k, g, at)
    walk = walk_to(k, s, o, w) if w[HERE + o] == 0 else 0
    work = 3 + walk
    if not g[g[ROLE] + at]:
        w[JOINED] += 1
    elif k[PLAYERS] == 1 and placed:
        w[LEGS + o] = 2
        work += 4
    else:
        w[LEGS + o] = 1
    w[WORK + o] += work
    if placed and w[CHAIN + o] == 0:
        w[CHAIN + o] = work


@kernel
def has_place(k: Ints, g: Ints, at: int) -> bool:
    """Whether the goal says where an object has to be in the end (`at` is its entry)."""
    if g[g[BASE] + at] or g[g[ATOP] + at]:
        return True
    return bool(g[g[PILE] + at] or g[g[INTO] + at])


@kernel
def must_be_clear(k: Ints, g: Ints, row: int, under: int, upper: int, w: Ints) -> bool:
    """Whether the goal wants nothing on an item, or something else than what is there."""
    if g[g[TOP] + row * k[OBJECTS] + under]:
        return True
    for o in range(k[ITEMS]):
        if o != upper and g[g[ATOP] + row * k[OBJECTS] + o] == under + 1 and w[LEGS + o] > 0:
            return True
    return False


@kernel
def is_finished_too_soon(k: Ints, g: Ints, row: int, o: int, w: Ints) -> bool:
    """Whether the top of a pile is in place while something that goes below it is not."""
    at = row * k[OBJECTS] + o
    if not g[g[TOP] + at] or not g[g[PILE] + at]:
        return False
    for other in range(k[ITEMS]):
        if (
            other != o
            and g[g[PILE] + row * k[OBJECTS] + other] == g[g[PILE] + at]
            and w[LEGS + other] > 0
        ):
            return True
    return w[LEGS + g[g[PILE] + at] - 1] > 0


@kernel
def crowded_stations(k: Ints, s: Ints, w: Ints) -> int:
    """The work of clearing stations that are needed and taken by what would stay there."""
    needed = 0
    for o in range(k[OBJECTS]):
        needed |= w[NEEDS + o]
    work = 0
    for c in range(k[CLASSES]):
        if not needed >> c & 1:
            continue
        least = DEAD
        for station in range(k[STATIONS]):
            if k[k[STATION_CLASS] + station] == c:
                least = min(least, clearing(k, s, station, w))
        if least == DEAD:
            return DEAD
        work += least
    return work


@kernel
def clearing(k: Ints, s: Ints, station: int, w: Ints) -> int:
    """The work of clearing a station, besides that of what leaves it anyway."""
    foot = -1
    for o in range(k[OBJECTS]):
        if s[k[BELOW] + o] == k[OBJECTS] + station:
            foot = o
    if foot < 0 or w[LEAVES + foot]:
        return 0
    work = 0
    o = foot
    for _ in range(k[OBJECTS]):
        if not w[LEAVES + o]:
            work += 3 + (walk_to(k, s, o, w) if w[HERE + o] == 0 else 0)
            w[JOINED] += 1
        o = w[ABOVE + o]
        if o < 0:
            break
    return work
