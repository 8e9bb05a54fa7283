"""The nodes of a search: reached states, how they were reached, and which of them are open.

A node is a state with `g`, the steps so far, and `h`, the heuristic's lower bound of the steps
left. f is their sum. With a weight above 1, an open node's f is g + weight * h (weighted A*, Pohl
1970).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, NamedTuple

from robotouille.planning.kitchen.bound.lower_bound import heuristic
from robotouille.planning.kitchen.bound.scratch import DEAD_END, Scratch, new_scratch
from robotouille.planning.kitchen.compact_state import (
    ACTION_BITS,
    WAIT,
    CompactState,
    GoalSpec,
    Kitchen,
    copy_state,
    empty_state,
    pack_state,
)
from robotouille.planning.kitchen.kernels import (
    SMALL,
    Ints,
    blank_records,
    grown,
    ints,
    kernel,
    zeros,
)

# Open nodes are in stacks, one for each pair of f and h: opening and popping take constant time,
# where a heap needs log n. The arrays limit f and h; longer plans are out of reach anyway.
MAX_F, MAX_H = 512, 256

UNKNOWN = 1 << 30
"""The length of the best plan before one is found."""

# Integer weights need no rounding, so compiled and plain searches agree.
UNIT = 4
"""The weight 1. Weights of the heuristic are in quarters."""

# An array, because kernels cannot write to a named tuple's fields.
COUNT, EXPANDED, LOWEST_F, BEST, GOAL, CUT, WEIGHT, LIMIT, PUT_OFF = range(9)
"""Positions in `Nodes.status`.

They contain the number of nodes, the number of expanded nodes, and the lowest f of an open node;
the length of the best known plan and its last node (-1 if another search found it); the lowest f of
the states without room; and the weight. In a partial expansion, successors with an f above LIMIT
are put off, and PUT_OFF is the lowest f of these.
"""

MAX_ACTIONS = 256
"""Maximum number of actions of one player in one state."""

# A joint action has ACTION_BITS for each player's action. From this bit on, it has two bits for the
# player of each turn. The action of a single player is stored as it is.
ORDER_SHIFT = 52


@dataclass(slots=True)
class Turn:
    """One player's turn in a step in which several players act one after another."""

    actor: int
    next_choice: int
    choices: int  # number of actions to choose from
    known: int  # number of actions tried in another order
    joint: int  # the earlier turns, as a joint action
    actions: Annotated[Ints, SMALL, MAX_ACTIONS]  # [choice]
    known_actions: Annotated[Ints, SMALL, MAX_ACTIONS]  # [number below `known`]


def _new_turn() -> Turn:
    return Turn(0, 0, 0, 0, 0, [0] * MAX_ACTIONS, [0] * MAX_ACTIONS)


class Nodes(NamedTuple):
    """All nodes of a search, and its work space.

    `table` is a hash table of the nodes by key. `newest` contains the top of each stack and `next`
    the node below each node. All three store a node plus 1, or 0 for none.
    """

    keys: Ints  # kitchen.words for each node
    g: Ints  # [node]
    h: Ints  # [node] DEAD_END: skipped
    parent: Ints  # [node] -1 for a start
    action: Ints  # [node] the action or joint action that led to the state
    next: Ints  # [node]
    table: Ints
    newest: Ints  # [f * MAX_H + h]
    lowest_h: Ints  # [f] no open node with this f has a lower h
    status: Ints
    key: Ints  # of the state to insert
    states: Sequence[CompactState]  # the expanded state, and those after each turn
    turns: Sequence[Turn]
    order: Ints  # of players
    scratch: Scratch


def new_nodes(kitchen: Kitchen, room: int, weight: int = UNIT) -> Nodes:
    """Return empty nodes with `room`, which must be a power of 2."""
    status = zeros(9)
    status[BEST] = UNKNOWN
    status[GOAL] = -1
    status[LOWEST_F] = MAX_F
    status[CUT] = MAX_F
    status[WEIGHT] = weight
    status[LIMIT] = MAX_F
    return Nodes(
        keys=zeros(room * kitchen.words),
        g=zeros(room),
        h=zeros(room),
        parent=zeros(room),
        action=zeros(room),
        next=zeros(room),
        table=zeros(2 * room),
        newest=zeros(MAX_F * MAX_H),
        lowest_h=ints([MAX_H] * MAX_F),
        status=status,
        key=zeros(kitchen.words),
        states=blank_records(partial(empty_state, kitchen), 6),
        turns=blank_records(_new_turn, 5),
        order=zeros(4),
        scratch=blank_records(new_scratch, 1)[0],
    )


def grown_nodes(kitchen: Kitchen, room: int, nodes: Nodes) -> Nodes:
    """Return the nodes with more room. The given ones must not be used any more."""
    found = nodes._replace(
        keys=grown(nodes.keys, room * kitchen.words),
        g=grown(nodes.g, room),
        h=grown(nodes.h, room),
        parent=grown(nodes.parent, room),
        action=grown(nodes.action, room),
        next=grown(nodes.next, room),
        table=zeros(2 * room),
    )
    rehash(found)
    return found


@kernel
def stack_of(f: int, h: int) -> int:
    """Return the stack of open nodes with the same f and h."""
    return f * MAX_H + h


@kernel
def rehash(nodes: Nodes) -> None:
    """Fill the hash table."""
    words = len(nodes.key)
    for node in range(nodes.status[COUNT]):
        # A skipped node has the same key as the node that replaced it.
        if nodes.h[node] < DEAD_END:
            for i in range(words):
                nodes.key[i] = nodes.keys[node * words + i]
            nodes.table[find_slot(nodes)] = node + 1


@kernel
def find_slot(nodes: Nodes) -> int:
    """Return the slot of the key in `nodes.key`, or a free one for it."""
    words = len(nodes.key)
    mask = len(nodes.table) - 1
    # The masks keep products below 2**63, so that compiled code does not overflow and agrees with
    # plain Python, whose integers are unlimited.
    slot = 0
    for i in range(words):
        slot = (slot ^ nodes.key[i]) & 0xFFFFFFFFFFF
        slot = (slot * 0x9E3B1) & 0xFFFFFFFFFFFFFFF
        slot ^= slot >> 23
    slot &= mask
    while True:
        node = nodes.table[slot] - 1
        if node < 0:
            return slot
        same = True
        for i in range(words):
            if nodes.keys[node * words + i] != nodes.key[i]:
                same = False
                break
        if same:
            return slot
        # Linear probing: the table has at least two slots for each node.
        slot = (slot + 1) & mask


@kernel
def insert(
    kitchen: Kitchen,
    goals: Sequence[GoalSpec],
    nodes: Nodes,
    state: CompactState,
    parent: int,
    action: int,
    g: int,
) -> None:
    """Add a state if it is new or reached sooner, and may lead to a better plan."""
    pack_state(kitchen, state, nodes.key)
    slot = find_slot(nodes)
    known = nodes.table[slot] - 1
    if known >= 0:
        if nodes.g[known] <= g:
            return
        # The bound holds however the state is reached, so it need not be computed again.
        h = nodes.h[known]
    else:
        h = heuristic(kitchen, goals[state.assignment], state, nodes.scratch, 0)
        if parent >= 0:
            # Pathmax (Mérő 1984): f never falls along a path, although the heuristic is
            # inconsistent. This stays a lower bound, because the parent's bound holds for plans
            # through this state.
            h = max(h, nodes.h[parent] - (g - nodes.g[parent]))
    if h >= DEAD_END or g + h >= nodes.status[BEST]:
        return
    f = weighted_f(nodes, g, h)
    if f > nodes.status[LIMIT]:
        nodes.status[PUT_OFF] = min(nodes.status[PUT_OFF], f)
        return
    node = nodes.status[COUNT]
    # A plan may lead through a state without room. The bound of the search must not exceed its f.
    if node >= len(nodes.g) or h >= MAX_H or g + h >= MAX_F:
        nodes.status[CUT] = min(nodes.status[CUT], g + h, MAX_F - 1)
        return
    if known >= 0:
        nodes.h[known] = DEAD_END
    words = len(nodes.key)
    for i in range(words):
        nodes.keys[node * words + i] = nodes.key[i]
    nodes.g[node] = g
    nodes.h[node] = h
    nodes.parent[node] = parent
    nodes.action[node] = action
    nodes.table[slot] = node + 1
    nodes.status[COUNT] = node + 1
    if h == 0:
        # The heuristic is 0 only in states that meet the goal.
        nodes.status[BEST] = g
        nodes.status[GOAL] = node
    else:
        open_node(nodes, node, f)


@kernel
def weighted_f(nodes: Nodes, g: int, h: int) -> int:
    """Return the f under which a node with `g` and `h` is open."""
    return min(MAX_F - 1, g + h * nodes.status[WEIGHT] // UNIT)


@kernel
def open_node(nodes: Nodes, node: int, f: int) -> None:
    """Push a node on its stack."""
    h = nodes.h[node]
    stack = stack_of(f, h)
    nodes.next[node] = nodes.newest[stack]
    nodes.newest[stack] = node + 1
    nodes.lowest_h[f] = min(nodes.lowest_h[f], h)
    nodes.status[LOWEST_F] = min(nodes.status[LOWEST_F], f)


@kernel
def pop(nodes: Nodes) -> int:
    """Remove and return the open node with the lowest f, then the lowest h; -1 if none is left.

    Nodes that cannot lead to a better plan are dropped.
    """
    while nodes.status[LOWEST_F] < MAX_F:
        f = nodes.status[LOWEST_F]
        # The lowest h first: it is nearest to the goal, so that ties in f cost little. The newest
        # first: depth-first search within a plateau reaches the goal sooner.
        h = nodes.lowest_h[f]
        while h < MAX_H:
            stack = stack_of(f, h)
            node = nodes.newest[stack] - 1
            if node >= 0:
                nodes.newest[stack] = nodes.next[node]
                if nodes.h[node] < DEAD_END and nodes.g[node] + h < nodes.status[BEST]:
                    nodes.lowest_h[f] = h
                    return node
            else:
                h += 1
        nodes.lowest_h[f] = MAX_H
        nodes.status[LOWEST_F] += 1
    return -1


@kernel
def insert_starts(
    kitchen: Kitchen, goals: Sequence[GoalSpec], nodes: Nodes, start: CompactState
) -> None:
    """Add the start once for each goal assignment."""
    state = nodes.states[0]
    copy_state(kitchen, start, state)
    for assignment in range(len(goals)):
        state.assignment = assignment
        insert(kitchen, goals, nodes, state, -1, 0, 0)


@kernel
def max_successors(players: int) -> int:
    """Return the room that the successors of one state need.

    Successors beyond it are counted in `status[CUT]`.
    """
    if players == 1:
        return 2 * MAX_ACTIONS
    return 1 << 3 + 4 * min(players, 4)


@kernel
def encode_turn(number: int, p: int, action: int) -> int:
    """Return one player's turn as a part of a joint action."""
    return action << ACTION_BITS * p | p << ORDER_SHIFT + 2 * number


def path_to_goal(nodes: Nodes, players: int) -> list[list[tuple[int, int]]]:
    """Return the joint actions to the best goal found: players and their actions, in order."""
    node = int(nodes.status[GOAL])
    joints = []
    while nodes.parent[node] >= 0:
        joints.append(_decode_joint(int(nodes.action[node]), players))
        node = int(nodes.parent[node])
    return joints[::-1]


def _decode_joint(joint: int, players: int) -> list[tuple[int, int]]:
    if players == 1:
        return [(0, joint)]
    turns = []
    for number in range(players):
        p = joint >> ORDER_SHIFT + 2 * number & 3
        action = joint >> ACTION_BITS * p & (1 << ACTION_BITS) - 1
        if action != WAIT:
            turns.append((p, action))
    return turns
