"""Successors of a state, for one player and for several, and A*."""

from __future__ import annotations

from collections.abc import Sequence

from robotouille.planning.kitchen.applicable import applicable_actions, applicable_moves
from robotouille.planning.kitchen.bound.lower_bound import heuristic
from robotouille.planning.kitchen.bound.scratch import DEAD_END
from robotouille.planning.kitchen.compact_state import (
    WAIT,
    CompactState,
    GoalSpec,
    Kitchen,
    copy_state,
    unpack_state,
)
from robotouille.planning.kitchen.kernels import Ints, kernel
from robotouille.planning.kitchen.nodes import (
    BEST,
    COUNT,
    CUT,
    EXPANDED,
    GOAL,
    LIMIT,
    LOWEST_F,
    MAX_F,
    PUT_OFF,
    UNIT,
    UNKNOWN,
    WEIGHT,
    Nodes,
    Turn,
    encode_turn,
    insert,
    max_successors,
    open_node,
    pop,
    weighted_f,
)
from robotouille.planning.kitchen.transitions import (
    advance_timers,
    apply_action,
    is_any_timer_running,
    pass_time,
    place_of_action,
    sort_players,
)


@kernel
def expand_alone(
    kitchen: Kitchen, goals: Sequence[GoalSpec], nodes: Nodes, node: int, greedy: bool
) -> int:
    """Insert the successors of one player's state: actions here, actions elsewhere, and waiting.

    A greedy expansion stops at the first successor that is good enough. It returns the best new
    node, or -1 without any.
    """
    # Walks have no states of their own: a player walks only to act at the destination. Walking
    # takes a step in which time passes, so actions elsewhere apply to the `later` state.
    now, later, after = nodes.states[0], nodes.states[1], nodes.states[2]
    unpack_state(kitchen, nodes.keys, node * kitchen.words, now)
    pass_time(kitchen, now, later)
    goal, actions = goals[now.assignment], nodes.turns[0].actions
    # Waiting helps only while a timer runs. Greedy search tries it last, because any action is
    # better.
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
        insert(kitchen, goals, nodes, after, node, actions[i], nodes.g[node] + steps)
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
    """Set `after` to the state after an action and return the steps that it takes.

    `here` means that the player acts at its place. Otherwise the player waits, or walks to the
    action's place. `later` is the state one step after `now`.
    """
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
    """Return whether the goal is reached or the newest successor has the f of its parent."""
    if nodes.status[GOAL] >= 0:
        return True
    newest = nodes.status[COUNT] - 1
    # No successor has a lower f than its parent (pathmax).
    return newest >= first and nodes.g[newest] + nodes.h[newest] <= nodes.g[node] + nodes.h[node]


@kernel
def lowest_f(nodes: Nodes, first: int) -> int:
    """Return the node with the lowest f, then the lowest h, from `first` on, or -1."""
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


def best_successor(kitchen: Kitchen, goals: Sequence[GoalSpec], nodes: Nodes, node: int) -> int:
    """Return the best new successor of one player's state, for greedy search; -1 if none is new."""
    # A plain function, so that greedy search compiles no kernels of its own.
    return int(expand_alone(kitchen, goals, nodes, node, True))


@kernel
def expand_together(kitchen: Kitchen, goals: Sequence[GoalSpec], nodes: Nodes, node: int) -> None:
    """Insert the successors of several players' state: every joint action of one step.

    `nodes.states[i]` is the state after i turns.
    """
    # Players act one after another, in every order: an earlier action can enable a later one. An
    # explicit stack of turns replaces recursion, which numba supports only in part.
    unpack_state(kitchen, nodes.keys, node * kitchen.words, nodes.states[0])
    goal = goals[nodes.states[0].assignment]
    after = nodes.states[5]
    number = 0
    begin_turn(nodes.turns[0], 0)
    while number >= 0:
        if number == kitchen.players:
            pass_time(kitchen, nodes.states[number], after)
            # Players are interchangeable: sorting them merges up to n! equal states.
            sort_players(kitchen, after, nodes.order)
            joint = nodes.turns[number].joint
            insert(kitchen, goals, nodes, after, node, joint, nodes.g[node] + 1)
            number -= 1
        elif take_turn(kitchen, goal, nodes, node, number):
            number += 1
        else:
            number -= 1


@kernel
def expand_partly(kitchen: Kitchen, goals: Sequence[GoalSpec], nodes: Nodes, node: int) -> None:
    """Insert the successors with the f of their parent, and open it again for the others.

    Most joint actions waste steps (partial expansion A*, Yoshizumi, Miura and Ishida 2000).
    """
    status = nodes.status
    status[LIMIT] = status[LOWEST_F]
    status[PUT_OFF] = MAX_F
    expand_together(kitchen, goals, nodes, node)
    if status[PUT_OFF] < MAX_F:
        open_node(nodes, node, status[PUT_OFF])


@kernel
def begin_turn(turn: Turn, joint: int) -> None:
    """Start a turn after the joint action `joint`."""
    turn.actor = -1
    turn.next_choice = 0
    turn.choices = 0
    turn.joint = joint


@kernel
def take_turn(kitchen: Kitchen, goal: GoalSpec, nodes: Nodes, node: int, number: int) -> bool:
    """Apply the next action of a turn. Return False if no player has one left."""
    turn = nodes.turns[number]
    while True:
        while turn.next_choice == turn.choices:
            if not next_actor(kitchen, goal, nodes, number):
                return False
        action = turn.actions[turn.next_choice]
        turn.next_choice += 1
        # Actions that were possible before the previous player acted commute with that player's
        # action, so the order of player numbers has covered them. Only newly enabled actions are
        # tried.
        if contains(turn.known_actions, turn.known, action):
            continue
        after = nodes.states[number + 1]
        copy_state(kitchen, nodes.states[number], after)
        apply_action(kitchen, after, turn.actor, action)
        if number + 1 < kitchen.players and is_too_long(kitchen, goal, nodes, node, number + 1):
            continue
        joint = turn.joint | encode_turn(number, turn.actor, action)
        begin_turn(nodes.turns[number + 1], joint)
        return True


@kernel
def is_too_long(kitchen: Kitchen, goal: GoalSpec, nodes: Nodes, node: int, turns: int) -> bool:
    """Return whether all plans that begin with the turns so far are longer than the limit."""
    status = nodes.status
    h = heuristic(kitchen, goal, nodes.states[turns], nodes.scratch, turns)
    if h >= DEAD_END or nodes.g[node] + h >= status[BEST]:
        return True
    # This step counts with the full weight only when it is over.
    f = weighted_f(nodes, nodes.g[node] + 1, h - 1)
    if f <= status[LIMIT]:
        return False
    status[PUT_OFF] = min(status[PUT_OFF], f)
    return True


@kernel
def next_actor(kitchen: Kitchen, goal: GoalSpec, nodes: Nodes, number: int) -> bool:
    """Go on to the next player who has not acted. Return False after the last one."""
    turn = nodes.turns[number]
    p = turn.actor + 1
    while p < kitchen.players and has_acted(nodes, number, p):
        p += 1
    turn.actor = p
    if p == kitchen.players:
        return False
    turn.next_choice = 0
    turn.choices = choices(kitchen, goal, nodes.states[number], p, turn.actions)
    turn.known = 0
    if number > 0 and p < nodes.turns[number - 1].actor:
        turn.known = choices(kitchen, goal, nodes.states[number - 1], p, turn.known_actions)
    return True


@kernel
def has_acted(nodes: Nodes, number: int, p: int) -> bool:
    """Return whether a player had an earlier turn in this step."""
    for earlier in range(number):
        if nodes.turns[earlier].actor == p:
            return True
    return False


@kernel
def choices(kitchen: Kitchen, goal: GoalSpec, state: CompactState, p: int, found: Ints) -> int:
    """Write what one of several players can do in a step, and return the number of choices.

    A player acts at its place, walks, or waits.
    """
    count = applicable_actions(kitchen, goal, state, p, True, found, 0)
    count = applicable_moves(kitchen, state, p, found, count)
    found[count] = WAIT
    return count + 1


@kernel
def contains(actions: Ints, count: int, action: int) -> bool:
    """Return whether an action is among the first `count` actions."""
    for i in range(count):
        if actions[i] == action:
            return True
    return False


PAUSED, GROW, PROVEN, EMPTY, FULL = range(5)
"""Reasons for which `astar` returns.

The expansions are used up; there is no room for more nodes; no better plan exists; no open state is
left; or states without room prevent a better bound.
"""


@kernel
def astar(kitchen: Kitchen, goals: Sequence[GoalSpec], nodes: Nodes, expansions: int) -> int:
    """Continue a search for a number of expansions and return why it stopped."""
    status = nodes.status
    until = status[EXPANDED] + expansions
    while status[EXPANDED] < until:
        if status[COUNT] + max_successors(kitchen.players) > len(nodes.g):
            return GROW
        if status[CUT] < MAX_F and status[LOWEST_F] >= status[CUT]:
            return FULL
        # With an admissible heuristic the lowest open f bounds every remaining plan, so a plan of
        # that length is a shortest one (Hart, Nilsson and Raphael 1968). A weighted f proves
        # nothing.
        if status[WEIGHT] == UNIT and status[LOWEST_F] >= status[BEST]:
            return PROVEN
        node = pop(nodes)
        if node < 0:
            if status[CUT] < MAX_F:
                return FULL
            return PROVEN if status[BEST] < UNKNOWN else EMPTY
        status[EXPANDED] += 1
        if kitchen.players == 1:
            expand_alone(kitchen, goals, nodes, node, False)
        else:
            expand_partly(kitchen, goals, nodes, node)
    return PAUSED
