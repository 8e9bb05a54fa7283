"""The successors of a state of one player."""

from __future__ import annotations

from collections.abc import Sequence

from robotouille.planners.kitchen.applicable import applicable_actions
from robotouille.planners.kitchen.compact_state import (
    WAIT,
    CompactState,
    Goal,
    Kitchen,
    copy_state,
    unpack_state,
)
from robotouille.planners.kitchen.kernels import kernel
from robotouille.planners.kitchen.search.nodes import COUNT, GOAL, UNIT, Nodes, insert
from robotouille.planners.kitchen.transitions import (
    advance_timers,
    apply_action,
    is_any_timer_running,
    pass_time,
    place_of_action,
)

__all__ = ["best_successor", "expand_alone"]


@kernel
def expand_alone(
    kitchen: Kitchen, goals: Sequence[Goal], nodes: Nodes, node: int, weight: int
) -> None:
    """The successors of one player's state: what can be done here, elsewhere, or by waiting.

    Walks are not states of their own: who walks somewhere does something there. Walking takes a
    step, in which time passes.
    """
    now, later, after = nodes.states[0], nodes.states[1], nodes.states[2]
    goal, actions, g = goals[now.assignment], nodes.turns[0].actions, nodes.g[node]
    for i in range(applicable_actions(kitchen, goal, now, 0, True, actions, 0)):
        do_here(kitchen, now, actions[i], after)
        insert(kitchen, goals, nodes, after, node, actions[i], g + 1, weight)
    pass_time(kitchen, now, later)
    if is_any_timer_running(kitchen, now):
        insert(kitchen, goals, nodes, later, node, WAIT, g + 1, weight)
    for i in range(applicable_actions(kitchen, goal, later, 0, False, actions, 0)):
        do_elsewhere(kitchen, later, actions[i], after)
        insert(kitchen, goals, nodes, after, node, actions[i], g + 2, weight)


@kernel
def do_here(kitchen: Kitchen, state: CompactState, action: int, after: CompactState) -> None:
    """The state after an action of the only player at its place."""
    copy_state(kitchen, state, after)
    apply_action(kitchen, after, 0, action)
    advance_timers(kitchen, after)


@kernel
def do_elsewhere(kitchen: Kitchen, state: CompactState, action: int, after: CompactState) -> None:
    """The state after an action to which the only player has walked for a step."""
    copy_state(kitchen, state, after)
    after.place[0] = place_of_action(kitchen, after, action)
    apply_action(kitchen, after, 0, action)
    advance_timers(kitchen, after)


@kernel
def best_successor(kitchen: Kitchen, goals: Sequence[Goal], nodes: Nodes, node: int) -> int:
    """Of the new successors of one player's state that with the lowest f, then the lowest h, for
    greedy search; -1 if none is new.

    No others are made once one has the f of the state itself. Waiting comes last.
    """
    now, later, after = nodes.states[0], nodes.states[1], nodes.states[2]
    unpack_state(kitchen, nodes.keys, node * kitchen.words, now)
    goal, actions, g = goals[now.assignment], nodes.turns[0].actions, nodes.g[node]
    first = nodes.status[COUNT]
    for i in range(applicable_actions(kitchen, goal, now, 0, True, actions, 0)):
        do_here(kitchen, now, actions[i], after)
        insert(kitchen, goals, nodes, after, node, actions[i], g + 1, UNIT)
        if is_good_enough(nodes, node, first):
            return lowest_f(nodes, first)
    pass_time(kitchen, now, later)
    for i in range(applicable_actions(kitchen, goal, later, 0, False, actions, 0)):
        do_elsewhere(kitchen, later, actions[i], after)
        insert(kitchen, goals, nodes, after, node, actions[i], g + 2, UNIT)
        if is_good_enough(nodes, node, first):
            return lowest_f(nodes, first)
    if is_any_timer_running(kitchen, now):
        insert(kitchen, goals, nodes, later, node, WAIT, g + 1, UNIT)
    return lowest_f(nodes, first)


@kernel
def is_good_enough(nodes: Nodes, node: int, first: int) -> bool:
    """Whether the goal is reached, or the newest of a node's successors has the f of the node."""
    if nodes.status[GOAL] >= 0:
        return True
    newest = nodes.status[COUNT] - 1
    return newest >= first and nodes.g[newest] + nodes.h[newest] <= nodes.g[node] + nodes.h[node]


@kernel
def lowest_f(nodes: Nodes, first: int) -> int:
    """Of the nodes from `first` on the one with the lowest f, then the lowest h; -1 for none."""
    best = -1
    for node in range(first, nodes.status[COUNT]):
        f, h = nodes.g[node] + nodes.h[node], nodes.h[node]
        if (
            best < 0
            or f < nodes.g[best] + nodes.h[best]
            or (f == nodes.g[best] + nodes.h[best] and h < nodes.h[best])
        ):
            best = node
    return best
