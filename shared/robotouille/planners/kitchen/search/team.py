"""The successors of a state of several players: everything all can do in one step."""

from __future__ import annotations

from collections.abc import Sequence

from robotouille.planners.kitchen.applicable import applicable_actions, applicable_moves
from robotouille.planners.kitchen.compact_state import (
    WAIT,
    CompactState,
    Goal,
    Kitchen,
    copy_state,
    unpack_state,
)
from robotouille.planners.kitchen.kernels import Ints, kernel
from robotouille.planners.kitchen.search.nodes import Nodes, Turn, encode_turn, insert
from robotouille.planners.kitchen.transitions import (
    apply_action,
    pass_time,
    sort_players,
)

__all__ = ["expand_together"]


@kernel
def expand_together(
    kitchen: Kitchen, goals: Sequence[Goal], nodes: Nodes, node: int, weight: int
) -> None:
    """The successors of several players' state: everything all can do in one step.

    One acts after the other, in every order. Where two act against the order of their numbers,
    only what the first makes possible is new. `nodes.states[i]` is the state after i turns.
    """
    unpack_state(kitchen, nodes.keys, node * kitchen.words, nodes.states[0])
    goal = goals[nodes.states[0].assignment]
    after = nodes.states[5]
    number = 0
    begin_turn(nodes.turns[0], 0)
    while number >= 0:
        if number == kitchen.players:
            pass_time(kitchen, nodes.states[number], after)
            sort_players(kitchen, after, nodes.order)
            joint = nodes.turns[number].joint
            insert(kitchen, goals, nodes, after, node, joint, nodes.g[node] + 1, weight)
            number -= 1
        elif take_turn(kitchen, goal, nodes, number):
            number += 1
        else:
            number -= 1


@kernel
def begin_turn(turn: Turn, joint: int) -> None:
    """Let the next player choose; `joint` is what those before it do."""
    turn.actor = -1
    turn.next_choice = 0
    turn.choices = 0
    turn.joint = joint


@kernel
def take_turn(kitchen: Kitchen, goal: Goal, nodes: Nodes, number: int) -> bool:
    """Take the next action of this turn; False if no player has any left."""
    turn = nodes.turns[number]
    while True:
        while turn.next_choice == turn.choices:
            if not next_actor(kitchen, goal, nodes, number):
                return False
        action = turn.actions[turn.next_choice]
        turn.next_choice += 1
        if contains(turn.known_actions, turn.known, action):
            continue
        after = nodes.states[number + 1]
        copy_state(kitchen, nodes.states[number], after)
        apply_action(kitchen, after, turn.actor, action)
        joint = turn.joint | encode_turn(number, turn.actor, action)
        begin_turn(nodes.turns[number + 1], joint)
        return True


@kernel
def next_actor(kitchen: Kitchen, goal: Goal, nodes: Nodes, number: int) -> bool:
    """Go on to the next player who has not acted; False if there is none."""
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
    """Whether a player had an earlier turn in this step."""
    for earlier in range(number):
        if nodes.turns[earlier].actor == p:
            return True
    return False


@kernel
def choices(kitchen: Kitchen, goal: Goal, state: CompactState, p: int, found: Ints) -> int:
    """Write what one of several players can do in a step: act, walk, or nothing; returns how many
    choices there are."""
    count = applicable_actions(kitchen, goal, state, p, True, found, 0)
    count = applicable_moves(kitchen, state, p, found, count)
    found[count] = WAIT
    return count + 1


@kernel
def contains(actions: Ints, count: int, action: int) -> bool:
    """Whether an action is among the first of some others."""
    for i in range(count):
        if actions[i] == action:
            return True
    return False
