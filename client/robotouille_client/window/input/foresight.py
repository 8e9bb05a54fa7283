"""Meaning of inputs that wait: their actions if nobody else acts until their turn."""

from __future__ import annotations

from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State
from robotouille_client.window.input.controls import facts_after, handled, takes

MAX_STEPS = 200
"""Largest number of steps to look ahead. Walks and work end sooner."""

Meaning = tuple[str, tuple[str, ...]]
"""Kind of an action, and the kinds of things that it is about."""


def meaning(state: State, me: str, action: GroundAction) -> Meaning:
    """Return what an action means to its player.

    Taking a bread is the same from each place. Other actions are the same if the kinds of their
    things are: a patty that is put on a bun is not meant for a cheese.
    """
    things, word = action.arguments, action.name
    if takes(state, me, action):
        things, word = tuple(sorted(handled(state, me, action))), "take"
    return word, tuple(state.world.thing(name).kind for name in things)


def foreseen(state: State, me: str, action: GroundAction | None = None) -> State:
    """Return the state after a player's action, or after the current one, if nobody else acts."""
    if action is not None and action in state.actions(me):
        state = state.step([action]).state
    elif action is not None and action.destination is not None:
        # A walk to an occupied station is not valid yet. Other invalid actions do nothing.
        state = State(state.world, facts_after(state, action), state.timers, state.orders)
    for _ in range(MAX_STEPS):
        if not state.busy_steps(me):
            break
        state = state.step([]).state
    return state
