"""A* over compact states (Hart, Nilsson and Raphael 1968), on arrays that only grow.

A node is a state with the steps it took to get there. Nodes wait in stacks, one for each pair of
promise (steps so far plus estimate) and estimate; the lowest promise comes first, and of those
the node nearest the goal. A state reached again in fewer steps gets a new node; the old one is
skipped. With a weight above 1 plans come sooner and are no longer proven to be shortest.
"""

from __future__ import annotations

from typing import NamedTuple

from robotouille.planners.kitchen.compact_state import (
    PLACE,
    PLAYERS,
    SIZE,
    WAIT,
    WORDS,
)
from robotouille.planners.kitchen.heuristic.lower_bound import estimate
from robotouille.planners.kitchen.heuristic.scratch_rows import DEAD, SCRATCH
from robotouille.planners.kitchen.kernels import Ints, grown, ints, kernel, zeros
from robotouille.planners.kitchen.transitions import (
    act,
    in_order,
    options,
    pack,
    running,
    spot,
    tick,
    unpack,
    walks,
)

__all__ = [
    "BEST",
    "BITS",
    "COUNT",
    "CUT",
    "EMPTY",
    "EXPANDED",
    "FULL",
    "GOAL",
    "GROW",
    "ORDER",
    "PAUSED",
    "PROMISE",
    "PROMISES",
    "PROVEN",
    "Nodes",
    "margin",
    "new_nodes",
    "push",
    "run",
]

PAUSED, GROW, PROVEN, EMPTY, FULL = range(5)
"""Why `run` returned: enough expansions, no room, no better plan exists, nothing is left, or
nothing more can be proven since some states had no room."""

PROMISES, ESTIMATES = 512, 256
"""Promises and estimates that there are stacks for; longer plans are out of reach."""

UNKNOWN = 1 << 30
"""The length of the best plan as long as there is none."""

COUNT, EXPANDED, PROMISE, BEST, GOAL, CUT = range(6)
"""Positions in `Nodes.notes`: nodes, expansions, the lowest promise, the length of the best plan
known (plans have to be shorter) and its last node, -1 if it was not found here;
and the lowest promise of states that had no room."""

ROOM = 256
"""Actions of one player in one state that there is room for."""

ACTOR, CHOICE, CHOICES, KNOWN, JOINT = range(5)
"""What `Nodes.turns` says of each turn of a step: who acts, which of how many actions is next, how
many of them are nothing new, and what is done so far."""

BITS, ORDER = 13, 52
"""A joint action has 13 bits for each player's and, from bit 52 on, two for who acts in turn."""


class Nodes(NamedTuple):
    """All nodes of a search, as arrays, and its scratch space."""

    key: Ints
    steps: Ints
    estimate: Ints
    parent: Ints
    action: Ints
    next: Ints
    table: Ints
    first: Ints
    lowest: Ints
    notes: Ints
    s: Ints
    t: Ints
    u: Ints
    v: Ints
    y: Ints
    z: Ints
    who: Ints
    turns: Ints
    acts: Ints
    w: Ints
    packed: Ints


def new_nodes(k: Ints, room: int, like: Nodes | None = None) -> Nodes:
    """Room for so many nodes, with the nodes of another search taken over."""
    if like is None:
        arrays = [zeros(room * k[WORDS]), *(zeros(room) for _ in range(5))]
        notes = zeros(8)
        notes[BEST] = UNKNOWN
        notes[GOAL] = -1
        notes[PROMISE] = PROMISES
        notes[CUT] = PROMISES
        states = [zeros(k[SIZE]) for _ in range(6)]
        rest = [*states, zeros(4), zeros(40), zeros(8 * ROOM), zeros(SCRATCH)]
        stacks = [zeros(PROMISES * ESTIMATES), ints([ESTIMATES] * PROMISES), notes]
        return Nodes._make([*arrays, zeros(2 * room), *stacks, *rest, zeros(k[WORDS])])
    key = grown(like.key, room * k[WORDS])
    arrays = [grown(values, room) for values in like[1:6]]
    nodes = Nodes._make([key, *arrays, zeros(2 * room), *like[7:]])
    rehash(k, nodes)
    return nodes


@kernel
def rehash(k: Ints, x: Nodes) -> None:
    """Fill the hash table anew."""
    for node in range(x.notes[COUNT]):
        if x.estimate[node] < DEAD:
            for i in range(k[WORDS]):
                x.packed[i] = x.key[node * k[WORDS] + i]
            x.table[slot_of(k, x)] = node + 1


@kernel
def slot_of(k: Ints, x: Nodes) -> int:
    """Where the packed key is in the hash table, or belongs."""
    mask = len(x.table) - 1
    h = 0
    for i in range(k[WORDS]):
        h = (h ^ x.packed[i]) & 0xFFFFFFFFFFF
        h = (h * 0x9E3B1) & 0xFFFFFFFFFFFFFFF
        h ^= h >> 23
    h &= mask
    while True:
        node = x.table[h] - 1
        if node < 0:
            return h
        same = True
        for i in range(k[WORDS]):
            if x.key[node * k[WORDS] + i] != x.packed[i]:
                same = False
                break
        if same:
            return h
        h = (h + 1) & mask


@kernel
def push(k: Ints, g: Ints, x: Nodes, t: Ints, parent: int, action: int, steps: int,
         weight: int) -> None:  # fmt: skip
    """Add a state, if it is new or reached sooner, and promises to better the best plan."""
    pack(k, t, x.packed, 0)
    slot = slot_of(k, x)
    known = x.table[slot] - 1
    if known >= 0:
        if x.steps[known] <= steps:
            return
        left = x.estimate[known]
    else:
        left = estimate(k, g, t, x.w)
        if parent >= 0:
            left = max(left, x.estimate[parent] - (steps - x.steps[parent]))
    if left >= DEAD or steps + left >= x.notes[BEST]:
        return
    node = x.notes[COUNT]
    if node >= len(x.steps) or left >= ESTIMATES or steps + left >= PROMISES:
        x.notes[CUT] = min(x.notes[CUT], steps + left, PROMISES - 1)
        return
    if known >= 0:
        x.estimate[known] = DEAD
    for i in range(k[WORDS]):
        x.key[node * k[WORDS] + i] = x.packed[i]
    x.steps[node] = steps
    x.estimate[node] = left
    x.parent[node] = parent
    x.action[node] = action
    x.table[slot] = node + 1
    x.notes[COUNT] = node + 1
    if left == 0:
        x.notes[BEST] = steps
        x.notes[GOAL] = node
        return
    promise = min(PROMISES - 1, steps + left * weight // 4)
    stack = promise * ESTIMATES + left
    x.next[node] = x.first[stack]
    x.first[stack] = node + 1
    x.lowest[promise] = min(x.lowest[promise], left)
    x.notes[PROMISE] = min(x.notes[PROMISE], promise)


@kernel
def pop(x: Nodes) -> int:
    """The most promising node, -1 if there is none that could lead to a better plan."""
    while x.notes[PROMISE] < PROMISES:
        promise = x.notes[PROMISE]
        left = x.lowest[promise]
        while left < ESTIMATES:
            node = x.first[promise * ESTIMATES + left] - 1
            if node >= 0:
                x.first[promise * ESTIMATES + left] = x.next[node]
                if x.estimate[node] < DEAD and x.steps[node] + left < x.notes[BEST]:
                    x.lowest[promise] = left
                    return node
            else:
                left += 1
        x.lowest[promise] = ESTIMATES
        x.notes[PROMISE] += 1
    return -1


@kernel
def run(k: Ints, g: Ints, x: Nodes, weight: int, expansions: int) -> int:
    """Go on with a search for so many expansions."""
    until = x.notes[EXPANDED] + expansions
    while x.notes[EXPANDED] < until:
        if x.notes[COUNT] + margin(k[PLAYERS]) > len(x.steps):
            return GROW
        if x.notes[CUT] < PROMISES and x.notes[PROMISE] >= x.notes[CUT]:
            return FULL
        if weight == 4 and x.notes[PROMISE] >= x.notes[BEST]:
            return PROVEN
        node = pop(x)
        if node < 0:
            if x.notes[CUT] < PROMISES:
                return FULL
            return PROVEN if x.notes[BEST] < UNKNOWN else EMPTY
        x.notes[EXPANDED] += 1
        unpack(k, x.key, node * k[WORDS], x.s)
        if k[PLAYERS] == 1:
            expand_alone(k, g, x, node, weight)
        else:
            expand_together(k, g, x, node, weight)
    return PAUSED


@kernel
def margin(players: int) -> int:
    """Room for the successors of one state; those beyond it are counted in `notes[CUT]`."""
    if players == 1:
        return 2 * ROOM
    return 1 << 3 + 4 * min(players, 4)


@kernel
def expand_alone(k: Ints, g: Ints, x: Nodes, node: int, weight: int) -> None:
    """The successors of one player's state: what can be done here, elsewhere, or by waiting.

    Walks are not states of their own: who walks somewhere does something there. Walking takes a
    step, in which time passes.
    """
    steps = x.steps[node]
    count = options(k, g, x.s, 0, True, x.acts, 0)
    for i in range(count):
        copy(k, x.s, x.t)
        act(k, x.t, 0, x.acts[i])
        tick(k, x.t)
        push(k, g, x, x.t, node, x.acts[i], steps + 1, weight)
    copy(k, x.s, x.u)
    waits = running(k, x.u)
    tick(k, x.u)
    if waits:
        push(k, g, x, x.u, node, WAIT, steps + 1, weight)
    count = options(k, g, x.u, 0, False, x.acts, 0)
    for i in range(count):
        copy(k, x.u, x.t)
        x.t[k[PLACE]] = spot(k, x.t, x.acts[i])
        act(k, x.t, 0, x.acts[i])
        tick(k, x.t)
        push(k, g, x, x.t, node, x.acts[i], steps + 2, weight)


@kernel
def expand_together(k: Ints, g: Ints, x: Nodes, node: int, weight: int) -> None:
    """The successors of several players' state: everything all can do in one step.

    One acts after the other, in every order. Where two act against the order of their numbers,
    only what the first makes possible is new.
    """
    turn = 0
    begin_turn(x, 0, 0)
    while turn >= 0:
        if turn == k[PLAYERS]:
            copy(k, buffer(x, turn), x.t)
            tick(k, x.t)
            in_order(k, x.t, x.who)
            push(k, g, x, x.t, node, x.turns[8 * turn + JOINT], x.steps[node] + 1, weight)
            turn -= 1
        elif next_choice(k, g, x, turn):
            turn += 1
        else:
            turn -= 1


@kernel
def begin_turn(x: Nodes, turn: int, joint: int) -> None:
    """Let the next player choose; `joint` is what those before it do."""
    x.turns[8 * turn + ACTOR] = -1
    x.turns[8 * turn + CHOICE] = 0
    x.turns[8 * turn + CHOICES] = 0
    x.turns[8 * turn + JOINT] = joint


@kernel
def next_choice(k: Ints, g: Ints, x: Nodes, turn: int) -> bool:
    """Take the next action of this turn; False if no player has any left."""
    now = 8 * turn
    while True:
        while x.turns[now + CHOICE] == x.turns[now + CHOICES]:
            if not next_actor(k, g, x, turn):
                return False
        p = x.turns[now + ACTOR]
        action = x.acts[ROOM * turn + x.turns[now + CHOICE]]
        x.turns[now + CHOICE] += 1
        if contains(x.acts, ROOM * (turn + 4), x.turns[now + KNOWN], action):
            continue
        copy(k, buffer(x, turn), buffer(x, turn + 1))
        act(k, buffer(x, turn + 1), p, action)
        joint = x.turns[now + JOINT] + (action << BITS * p) + (p << ORDER + 2 * turn)
        begin_turn(x, turn + 1, joint)
        return True


@kernel
def next_actor(k: Ints, g: Ints, x: Nodes, turn: int) -> bool:
    """Go on to the next player who has not acted; False if there is none."""
    now = 8 * turn
    p = x.turns[now + ACTOR] + 1
    while p < k[PLAYERS] and has_acted(x, turn, p):
        p += 1
    x.turns[now + ACTOR] = p
    if p == k[PLAYERS]:
        return False
    x.turns[now + CHOICE] = 0
    x.turns[now + CHOICES] = choices(k, g, buffer(x, turn), p, x.acts, ROOM * turn)
    x.turns[now + KNOWN] = 0
    if turn > 0 and p < x.turns[now - 8 + ACTOR]:
        before = buffer(x, turn - 1)
        x.turns[now + KNOWN] = choices(k, g, before, p, x.acts, ROOM * (turn + 4))
    return True


@kernel
def has_acted(x: Nodes, turn: int, p: int) -> bool:
    """Whether a player had an earlier turn in this step."""
    for earlier in range(turn):
        if x.turns[8 * earlier + ACTOR] == p:
            return True
    return False


@kernel
def buffer(x: Nodes, turn: int) -> Ints:
    """The state after so many players have acted."""
    if turn == 0:
        return x.s
    if turn == 1:
        return x.u
    if turn == 2:
        return x.v
    if turn == 3:
        return x.y
    return x.z


@kernel
def choices(k: Ints, g: Ints, s: Ints, p: int, acts: Ints, start: int) -> int:
    """Write what one of several players can do in a step into `acts`, from `start` on: act, walk,
    or nothing; returns how many."""
    count = options(k, g, s, p, True, acts, start)
    count += walks(k, s, p, acts, start + count)
    acts[start + count] = WAIT
    return count + 1


@kernel
def contains(acts: Ints, start: int, count: int, action: int) -> bool:
    """Whether an action is among some others."""
    for i in range(start, start + count):
        if acts[i] == action:
            return True
    return False


@kernel
def copy(k: Ints, s: Ints, t: Ints) -> None:
    for i in range(k[SIZE]):
        t[i] = s[i]
