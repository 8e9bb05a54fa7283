"""States in which players have put down what they hold and stepped aside.

Only facts change in these states: walks that take several steps would start timers.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from robotouille.planning.policies.standing import (
    is_out_of_the_way,
    walks_aside,
    walks_out_of_the_way,
)
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.scene import scene
from robotouille.world.world import State


def with_others_aside(state: State, others: Iterable[str]) -> State:
    """Return a state as if some players had put down what they hold and stepped aside."""
    for player in others:
        for action in put_down(state, player):
            state = after(state, action)
        for walk in walks_aside(state, player)[:1]:
            state = after(state, walk)
    return state


def put_down(state: State, player: str) -> Sequence[GroundAction]:
    """Return a walk and an action with which a player puts down everything on a near empty station.

    Return nothing if the player's hands are empty or there is no such station.
    """
    if not holds(state, player):
        return ()
    if is_out_of_the_way(state, player):
        for action in _frees_hands(state, player):
            return (action,)
    for walk in sorted(walks_out_of_the_way(state, player), key=lambda walk: walk.duration):
        for action in _frees_hands(after(state, walk), player):
            return walk, action
    return ()


def holds(state: State, player: str) -> bool:
    """Return whether a player has an object in hand."""
    return bool(held_by(state, player))


def held_by(state: State, player: str) -> list[str]:
    """Return the objects in a player's hand."""
    return [name for name, placed in scene(state).items() if placed.host == player]


def _frees_hands(state: State, player: str) -> list[GroundAction]:
    return [
        action
        for action in state.actions(player)
        if action.destination is None
        and not action.effects
        and not holds(after(state, action), player)
    ]


def after(state: State, action: GroundAction) -> State:
    """Return a state with the facts that an action leaves."""
    facts = (state.facts | action.touched) ^ action.removed
    return State(state.world, facts, state.timers)
