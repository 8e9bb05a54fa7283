"""Stops that no order of the legs can avoid; part of the estimate for one player.

One player has one hand, so a leg, once begun, is finished before the next. Some legs have to
come before others: what lies above goes first; the top of a pile is placed last; a station has to
be left before it is used by something else; what is in hand comes first of all. If the legs of some
objects wait for one another in a circle, one of them has to be interrupted by a stop: put down,
come back, pick up, walk. Circles without a common object count each for itself.
"""

from __future__ import annotations

from robotouille.planners.kitchen.compact_state import (
    ATOP,
    BELOW,
    CLASSES,
    HELD,
    INTO,
    IS_POT,
    ITEMS,
    MEALS,
    OBJECTS,
    PILE,
    SINK_CLASS,
    STATION_CLASS,
    STATIONS,
    TOP,
    VESSEL,
    WANTED,
)
from robotouille.planners.kitchen.heuristic.scratch_rows import (
    FIRST,
    LEAVES,
    LEGS,
    NEEDS,
    NEXT,
    SHARED,
)
from robotouille.planners.kitchen.heuristic.vessels import unmade
from robotouille.planners.kitchen.kernels import Ints, kernel

__all__ = ["detours"]

MOST = 28
"""More objects than that are not looked at: bit sets have 63 bits."""


@kernel
def detours(k: Ints, g: Ints, s: Ints, row: int, w: Ints) -> int:
    """Steps of additional stops that are needed at least."""
    if k[OBJECTS] > MOST or k[MEALS] > 6:
        return 0
    nodes = 2 * k[OBJECTS] + k[MEALS]
    for i in range(nodes):
        w[NEXT + i] = 0
    for o in range(k[OBJECTS]):
        if w[LEGS + o] > 1:
            w[NEXT + o] |= 1 << (k[OBJECTS] + o)
    above_before_below(k, g, s, row, w)
    below_before_top(k, g, row, w)
    stations_in_turn(k, s, w)
    water_first(k, g, s, row, w)
    hand_first(k, g, s, row, w)
    return circles(k, nodes, w)


@kernel
def last(k: Ints, o: int, w: Ints) -> int:
    """The node of the last leg of an object; that of the first is its number."""
    return k[OBJECTS] + o if w[LEGS + o] > 1 else o


@kernel
def above_before_below(k: Ints, g: Ints, s: Ints, row: int, w: Ints) -> None:
    for o in range(k[ITEMS]):
        if not w[LEAVES + o] or w[LEGS + o] == 0:
            continue
        under = s[k[BELOW] + o]
        while under < k[OBJECTS]:
            if w[LEAVES + under] and w[LEGS + under] > 0:
                w[NEXT + o] |= 1 << under
            under = s[k[BELOW] + under]


@kernel
def below_before_top(k: Ints, g: Ints, row: int, w: Ints) -> None:
    for o in range(k[ITEMS]):
        at = row * k[OBJECTS] + o
        if w[LEGS + o] == 0:
            continue
        if g[g[ATOP] + at] and w[LEGS + g[g[ATOP] + at] - 1] > 0:
            w[NEXT + last(k, g[g[ATOP] + at] - 1, w)] |= 1 << last(k, o, w)
        if not g[g[PILE] + at]:
            continue
        base = g[g[PILE] + at] - 1
        if w[LEGS + base] > 0:
            w[NEXT + last(k, base, w)] |= 1 << last(k, o, w)
        if g[g[TOP] + at]:
            for other in range(k[ITEMS]):
                if (
                    other != o
                    and w[LEGS + other] > 0
                    and g[g[PILE] + row * k[OBJECTS] + other] == g[g[PILE] + at]
                ):
                    w[NEXT + last(k, other, w)] |= 1 << last(k, o, w)


@kernel
def stations_in_turn(k: Ints, s: Ints, w: Ints) -> None:
    for c in range(k[CLASSES]):
        only = -1
        many = 0
        for station in range(k[STATIONS]):
            if k[k[STATION_CLASS] + station] == c:
                only = station
                many += 1
        if many != 1:
            continue
        foot = -1
        for o in range(k[OBJECTS]):
            if s[k[BELOW] + o] == k[OBJECTS] + only:
                foot = o
        if foot < 0 or not w[LEAVES + foot] or w[LEGS + foot] == 0:
            continue
        for o in range(k[OBJECTS]):
            if o != foot and w[NEEDS + o] >> c & 1:
                w[NEXT + foot] |= 1 << (o if w[FIRST + o] == c + 1 else last(k, o, w))


@kernel
def water_first(k: Ints, g: Ints, s: Ints, row: int, w: Ints) -> None:
    """Nothing is added before there is water, nor after it is poured."""
    for m in range(k[MEALS]):
        if not g[g[WANTED] + row * k[MEALS] + m]:
            continue
        filling = 2 * k[OBJECTS] + m
        missing = unmade(k, g, s, row, m)
        pot = only_pot(k, w)
        if pot >= 0 and missing and w[FIRST + pot] == k[SINK_CLASS] + 1:
            w[NEXT + pot] |= 1 << filling
        for o in range(k[ITEMS]):
            if g[g[INTO] + row * k[OBJECTS] + o] == m + 1 and w[LEGS + o] > 0:
                if missing:
                    w[NEXT + filling] |= 1 << last(k, o, w)
                if pot >= 0 and g[g[VESSEL] + row * k[MEALS] + m]:
                    w[NEXT + last(k, o, w)] |= 1 << last(k, pot, w)


@kernel
def only_pot(k: Ints, w: Ints) -> int:
    """The pot for the one meal there is to cook; -1 if there are several of either."""
    if w[SHARED]:
        return -1
    for c in range(k[ITEMS], k[OBJECTS]):
        if k[k[IS_POT] + c] == 1 and w[LEGS + c] > 0:
            return c
    return -1


@kernel
def hand_first(k: Ints, g: Ints, s: Ints, row: int, w: Ints) -> None:
    held = s[k[HELD]] - 1
    if held < 0 or w[LEGS + held] == 0:
        return
    for o in range(k[OBJECTS]):
        if o != held and w[LEGS + o] > 0:
            w[NEXT + held] |= 1 << o
            w[NEXT + held] |= 1 << last(k, o, w)
    for m in range(k[MEALS]):
        if unmade(k, g, s, row, m):
            w[NEXT + held] |= 1 << (2 * k[OBJECTS] + m)


@kernel
def circles(k: Ints, nodes: int, w: Ints) -> int:
    """The price of as many separate circles as are found, shortest first."""
    alive = 0
    for i in range(nodes):
        if w[NEXT + i]:
            alive |= 1 << i
    price = 0
    while True:
        alive = stripped(nodes, alive, w)
        if alive == 0:
            return price
        circle = shortest_circle(nodes, alive, w)
        least = 4
        for o in range(k[OBJECTS]):
            if circle >> o & 1 or circle >> (k[OBJECTS] + o) & 1:
                alive &= ~(1 << o)
                alive &= ~(1 << (k[OBJECTS] + o))
                if o >= k[ITEMS]:
                    least = 3
        price += least


@kernel
def stripped(nodes: int, alive: int, w: Ints) -> int:
    """Without the nodes that are on no circle because nothing precedes or follows them."""
    changed = True
    while changed:
        changed = False
        reached = 0
        for i in range(nodes):
            if alive >> i & 1:
                if w[NEXT + i] & alive == 0:
                    alive &= ~(1 << i)
                    changed = True
                else:
                    reached |= w[NEXT + i]
        if alive & ~reached:
            alive &= reached
            changed = True
    return alive


@kernel
def shortest_circle(nodes: int, alive: int, w: Ints) -> int:
    """The nodes of a shortest circle, as a bit set."""
    best = alive
    size = nodes + 1
    for start in range(nodes):
        if not alive >> start & 1:
            continue
        length = 1
        front = w[NEXT + start] & alive
        seen = front
        while front and not front >> start & 1 and length < size:
            after = 0
            for i in range(nodes):
                if front >> i & 1:
                    after |= w[NEXT + i]
            front = after & alive & ~seen
            seen |= front
            length += 1
        if front >> start & 1 and length < size:
            size = length
            best = along(nodes, alive, start, length, w)
    return best


@kernel
def along(nodes: int, alive: int, start: int, length: int, w: Ints) -> int:
    """The nodes of a circle of a given length through a node."""
    circle = 1 << start
    node = start
    for left in range(length - 1, 0, -1):
        for i in range(nodes):
            if w[NEXT + node] & alive & ~circle & (1 << i) and leads(
                nodes, alive, i, start, left, w
            ):
                circle |= 1 << i
                node = i
                break
    return circle


@kernel
def leads(nodes: int, alive: int, node: int, goal: int, steps: int, w: Ints) -> bool:
    """Whether one node leads to another in so many steps."""
    front = 1 << node
    for _ in range(steps):
        after = 0
        for i in range(nodes):
            if front >> i & 1:
                after |= w[NEXT + i]
        front = after & alive
    return front >> goal & 1 == 1
