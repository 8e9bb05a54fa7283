"""Stops that no order of the legs can avoid; part of the estimate for one player.

One player has one hand, so a leg, once begun, is finished before the next. Some legs have to come
before others: what lies above goes first; the top of a pile is placed last; a station has to be left
before it is used by something else; what is in hand comes first of all. If the legs of some objects
wait for one another in a circle, one of them has to be interrupted by a stop: put down, come back,
pick up, walk. Circles without a common object count each for itself.
"""

from __future__ import annotations

from robotouille.planning.kitchen.compiled import Ints, kernel
from robotouille.planning.kitchen.layout import Goals, Kitchen
from robotouille.planning.kitchen.rows import FIRST, LEAVES, LEGS, NEEDS, NEXT, SHARED
from robotouille.planning.kitchen.vessels import unmade

__all__ = ["detours"]

MOST = 28
"""More objects than that are not looked at: bit sets have 63 bits."""


@kernel
def detours(k: Kitchen, g: Goals, s: Ints, row: int, w: Ints) -> int:
    """Steps of additional stops that are needed at least."""
    if k.n > MOST or k.meals > 6:
        return 0
    nodes = 2 * k.n + k.meals
    for i in range(nodes):
        w[NEXT + i] = 0
    for o in range(k.n):
        if w[LEGS + o] > 1:
            w[NEXT + o] |= 1 << (k.n + o)
    above_before_below(k, g, s, row, w)
    below_before_top(k, g, row, w)
    stations_in_turn(k, s, w)
    water_first(k, g, s, row, w)
    hand_first(k, g, s, row, w)
    return circles(k, nodes, w)


@kernel
def last(k: Kitchen, o: int, w: Ints) -> int:
    """The node of the last leg of an object; that of the first is its number."""
    return k.n + o if w[LEGS + o] > 1 else o


@kernel
def above_before_below(k: Kitchen, g: Goals, s: Ints, row: int, w: Ints) -> None:
    for o in range(k.items):
        if not w[LEAVES + o] or w[LEGS + o] == 0:
            continue
        under = s[k.below + o]
        while under < k.n:
            if w[LEAVES + under] and w[LEGS + under] > 0:
                w[NEXT + o] |= 1 << under
            under = s[k.below + under]


@kernel
def below_before_top(k: Kitchen, g: Goals, row: int, w: Ints) -> None:
    for o in range(k.items):
        at = row * k.n + o
        if w[LEGS + o] == 0:
            continue
        if g.atop[at] and w[LEGS + g.atop[at] - 1] > 0:
            w[NEXT + last(k, g.atop[at] - 1, w)] |= 1 << last(k, o, w)
        if not g.pile[at]:
            continue
        base = g.pile[at] - 1
        if w[LEGS + base] > 0:
            w[NEXT + last(k, base, w)] |= 1 << last(k, o, w)
        if g.top[at]:
            for other in range(k.items):
                if other != o and w[LEGS + other] > 0 and g.pile[row * k.n + other] == g.pile[at]:
                    w[NEXT + last(k, other, w)] |= 1 << last(k, o, w)


@kernel
def stations_in_turn(k: Kitchen, s: Ints, w: Ints) -> None:
    for c in range(k.classes):
        only = -1
        many = 0
        for station in range(k.stations):
            if k.station_class[station] == c:
                only = station
                many += 1
        if many != 1:
            continue
        foot = -1
        for o in range(k.n):
            if s[k.below + o] == k.n + only:
                foot = o
        if foot < 0 or not w[LEAVES + foot] or w[LEGS + foot] == 0:
            continue
        for o in range(k.n):
            if o != foot and w[NEEDS + o] >> c & 1:
                w[NEXT + foot] |= 1 << (o if w[FIRST + o] == c + 1 else last(k, o, w))


@kernel
def water_first(k: Kitchen, g: Goals, s: Ints, row: int, w: Ints) -> None:
    """Nothing is added before there is water, nor after it is poured."""
    for m in range(k.meals):
        if not g.wanted[row * k.meals + m]:
            continue
        filling = 2 * k.n + m
        missing = unmade(k, g, s, row, m)
        pot = only_pot(k, w)
        if pot >= 0 and missing and w[FIRST + pot] == k.sink_class + 1:
            w[NEXT + pot] |= 1 << filling
        for o in range(k.items):
            if g.into[row * k.n + o] == m + 1 and w[LEGS + o] > 0:
                if missing:
                    w[NEXT + filling] |= 1 << last(k, o, w)
                if pot >= 0 and g.vessel[row * k.meals + m]:
                    w[NEXT + last(k, o, w)] |= 1 << last(k, pot, w)


@kernel
def only_pot(k: Kitchen, w: Ints) -> int:
    """The pot for the one meal there is to cook; -1 if there are several of either."""
    if w[SHARED]:
        return -1
    for c in range(k.items, k.n):
        if k.is_pot[c] == 1 and w[LEGS + c] > 0:
            return c
    return -1


@kernel
def hand_first(k: Kitchen, g: Goals, s: Ints, row: int, w: Ints) -> None:
    held = s[k.held] - 1
    if held < 0 or w[LEGS + held] == 0:
        return
    for o in range(k.n):
        if o != held and w[LEGS + o] > 0:
            w[NEXT + held] |= 1 << o
            w[NEXT + held] |= 1 << last(k, o, w)
    for m in range(k.meals):
        if unmade(k, g, s, row, m):
            w[NEXT + held] |= 1 << (2 * k.n + m)


@kernel
def circles(k: Kitchen, nodes: int, w: Ints) -> int:
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
        for o in range(k.n):
            if circle >> o & 1 or circle >> (k.n + o) & 1:
                alive &= ~(1 << o)
                alive &= ~(1 << (k.n + o))
                if o >= k.items:
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
            if w[NEXT + node] & alive & ~circle & (1 << i) and leads(nodes, alive, i, start, left, w):
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
