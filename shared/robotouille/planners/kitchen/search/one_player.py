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
    kitchen: Kitchen, goals: Sequence[Goal], nodes: Nodes, node: int, weight: int, greedy: bool
) -> int:
    """The successors of one player's state: what can be done here, elsewhere, or by waiting.

    Walks are not states of their own: who walks somewhere does something there. Walking takes a
    step, in which time passes. Greedily, waiting comes last, and no other successors are made once
    one is good enough; then the best new one is returned, -1 if there is none.
    """
    now, later, after = nodes.states[0], nodes.states[1], nodes.states[2]
    unpack_state(kitchen, nodes.keys, node * kitchen.words, now)
    pass_time(kitchen, now, later)
    goal, actions = goals[now.assignment], nodes.turns[0].actions
    waits = is_any_timer_running(kitchen, now)
    here = applicable_actions(kitchen, goal, now, 0, True, actions, 0)
    count = here
    if waits and not greedy:
        actions[count] = WAIT
        count += 1
    count = applicable_actions(kitchen, goal, later, 0, False, actions, count)
    if waits and greedy:
        actions[count] = WAIT
        count += 1
    first = nodes.status[COUNT]
    for i in range(count):
        steps = follow(kitchen, now, later, actions[i], i < here, after)
        insert(kitchen, goals, nodes, after, node, actions[i], nodes.g[node] + steps, weight)
        if greedy and is_good_enough(nodes, node, first):
            break
    return lowest_f(nodes, first) if greedy else -1


@kernel
def follow(
    kitchen: Kitchen,
    now: CompactState,
    later: CompactState,
    action: int,
    here: bool,
    after: CompactState,
) -> int:
    """Make `after` the state after an action here, after waiting, or after an action elsewhere, to
    which the player has walked; returns the steps it takes. `later` is a step after `now`."""
    if here:
        copy_state(kitchen, now, after)
    else:
        copy_state(kitchen, later, after)
        if action == WAIT:
            return 1
        after.place[0] = place_of_action(kitchen, after, action)
    apply_action(kitchen, after, 0, action)
    advance_timers(kitchen, after)
    return 1 if here else 2


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


def best_successor(kitchen: Kitchen, goals: Sequence[Goal], nodes: Nodes, node: int) -> int:
    """Of the new successors of one player's state that with the lowest f, then the lowest h, for
    greedy search; -1 if none is new."""
    return int(expand_alone(kitchen, goals, nodes, node, UNIT, True))
