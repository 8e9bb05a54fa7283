"""The nodes of a search: states that were reached, which of them are open, and how.

A node is a state with `g`, the steps it took to get there, and `h`, what the heuristic says is
left; f is their sum. Open nodes wait in stacks, one for each pair of f and h: the lowest f comes
first, and of those the lowest h, the last in first out. A state reached again in fewer steps gets a
new node; the old one is marked as a dead end, and skipped. A node's f is not less than its parent's
(pathmax, Mérő 1984), so f never falls along a path.

With a weight above 1 an open node's f is g + weight * h (weighted A*, Pohl 1970).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, NamedTuple

from robotouille.planners.kitchen.compact_state import (
    ACTION_BITS,
    WAIT,
    CompactState,
    Goal,
    Kitchen,
    copy_state,
    empty_state,
    pack_state,
)
from robotouille.planners.kitchen.heuristic.lower_bound import heuristic
from robotouille.planners.kitchen.heuristic.scratch import DEAD_END, Scratch, new_scratch
from robotouille.planners.kitchen.kernels import (
    SMALL,
    Ints,
    blank_records,
    grown,
    ints,
    kernel,
    zeros,
)

__all__ = [
    "BEST",
    "COUNT",
    "CUT",
    "EXPANDED",
    "GOAL",
    "LOWEST_F",
    "MAX_F",
    "UNIT",
    "UNKNOWN",
    "Nodes",
    "Turn",
    "encode_turn",
    "grown_nodes",
    "insert",
    "insert_starts",
    "max_successors",
    "new_nodes",
    "path_to_goal",
    "pop",
]

MAX_F, MAX_H = 512, 256
"""There are stacks for what is below; longer plans are out of reach."""

UNKNOWN = 1 << 30
"""The length of the best plan as long as there is none."""

UNIT = 4
"""Weights of the heuristic are in quarters: this is 1."""

COUNT, EXPANDED, LOWEST_F, BEST, GOAL, CUT = range(6)
"""Positions in `Nodes.status`: how many nodes there are, and how many were expanded; the lowest f
of an open node; the length of the best plan known (plans have to be shorter) and its last node, -1
if it was not found here; the lowest f of the states that had no room."""

MAX_ACTIONS = 256
"""Actions of one player in one state that there is room for."""

ORDER_SHIFT = 52
"""A joint action has ACTION_BITS for each player's and, from this bit on, two for who acts in turn.
An action of a player who is alone is itself."""


@dataclass(slots=True)
class Turn:
    """One player's turn in a step in which several act, one after the other."""

    actor: int
    next_choice: int
    choices: int  # how many actions the actor can choose from
    known: int  # how many of them were tried in another order
    joint: int  # what is done before, as a joint action
    actions: Annotated[Ints, SMALL, MAX_ACTIONS]  # [choice]
    known_actions: Annotated[Ints, SMALL, MAX_ACTIONS]  # [number below `known`]


def _new_turn() -> Turn:
    return Turn(0, 0, 0, 0, 0, [0] * MAX_ACTIONS, [0] * MAX_ACTIONS)


class Nodes(NamedTuple):
    """All nodes of a search, and its work space.

    `table` is a hash table of the nodes by key; `newest` has the top of each stack, `next` what is
    below; both hold a node plus 1, or 0.
    """

    keys: Ints  # kitchen.words for each node
    g: Ints  # [node]
    h: Ints  # [node] DEAD_END: a node that is skipped
    parent: Ints  # [node] -1 for a start
    action: Ints  # [node] the action or joint action that led here
    next: Ints  # [node]
    table: Ints
    newest: Ints  # [f * MAX_H + h]
    lowest_h: Ints  # [f] there is no open node with that f and a lower h
    status: Ints
    key: Ints  # of the state to be inserted
    states: Sequence[CompactState]  # that which is expanded, and those on the way from it
    turns: Sequence[Turn]
    order: Ints  # of players
    scratch: Scratch


def new_nodes(kitchen: Kitchen, room: int) -> Nodes:
    """Room for so many nodes, which is a power of 2."""
    status = zeros(8)
    status[BEST] = UNKNOWN
    status[GOAL] = -1
    status[LOWEST_F] = MAX_F
    status[CUT] = MAX_F
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
    """The same nodes with more room; those given must not be used any more."""
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
    """The stack of open nodes with the same f and h."""
    return f * MAX_H + h


@kernel
def rehash(nodes: Nodes) -> None:
    """Fill the hash table anew."""
    words = len(nodes.key)
    for node in range(nodes.status[COUNT]):
        if nodes.h[node] < DEAD_END:
            for i in range(words):
                nodes.key[i] = nodes.keys[node * words + i]
            nodes.table[find_slot(nodes)] = node + 1


@kernel
def find_slot(nodes: Nodes) -> int:
    """Where the key in `nodes.key` is in the hash table, or belongs."""
    words = len(nodes.key)
    mask = len(nodes.table) - 1
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
        slot = (slot + 1) & mask


@kernel
def insert(kitchen: Kitchen, goals: Sequence[Goal], nodes: Nodes, state: CompactState,
           parent: int, action: int, g: int, weight: int) -> None:  # fmt: skip
    """Add a state, if it is new or reached sooner, and may be on the way to a better plan."""
    pack_state(kitchen, state, nodes.key)
    slot = find_slot(nodes)
    known = nodes.table[slot] - 1
    if known >= 0:
        if nodes.g[known] <= g:
            return
        h = nodes.h[known]
    else:
        h = heuristic(kitchen, goals[state.assignment], state, nodes.scratch)
        if parent >= 0:
            h = max(h, nodes.h[parent] - (g - nodes.g[parent]))
    if h >= DEAD_END or g + h >= nodes.status[BEST]:
        return
    node = nodes.status[COUNT]
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
        nodes.status[BEST] = g
        nodes.status[GOAL] = node
    else:
        open_node(nodes, node, min(MAX_F - 1, g + h * weight // UNIT))


@kernel
def open_node(nodes: Nodes, node: int, f: int) -> None:
    """Put a node on its stack."""
    h = nodes.h[node]
    stack = stack_of(f, h)
    nodes.next[node] = nodes.newest[stack]
    nodes.newest[stack] = node + 1
    nodes.lowest_h[f] = min(nodes.lowest_h[f], h)
    nodes.status[LOWEST_F] = min(nodes.status[LOWEST_F], f)


@kernel
def pop(nodes: Nodes) -> int:
    """The open node with the lowest f, then the lowest h; -1 if none may lead to a better plan."""
    while nodes.status[LOWEST_F] < MAX_F:
        f = nodes.status[LOWEST_F]
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
    kitchen: Kitchen, goals: Sequence[Goal], nodes: Nodes, start: CompactState, weight: int
) -> None:
    """Add the start, once for each goal assignment."""
    state = nodes.states[0]
    copy_state(kitchen, start, state)
    for assignment in range(len(goals)):
        state.assignment = assignment
        insert(kitchen, goals, nodes, state, -1, 0, 0, weight)


@kernel
def max_successors(players: int) -> int:
    """Room for the successors of one state; those beyond it are counted in `status[CUT]`."""
    if players == 1:
        return 2 * MAX_ACTIONS
    return 1 << 3 + 4 * min(players, 4)


@kernel
def encode_turn(number: int, p: int, action: int) -> int:
    """What a joint action has of one player's turn."""
    return action << ACTION_BITS * p | p << ORDER_SHIFT + 2 * number


def path_to_goal(nodes: Nodes, players: int) -> list[list[tuple[int, int]]]:
    """The joint actions that lead to the best goal found: players and what they do, in order."""
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
