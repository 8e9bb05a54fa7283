"""What a team would do if others made way: who is in it, and the state in which nobody is.

A team that is in no position to reach the goal waits for others to walk. What it does meanwhile is
part of a plan for when they have: so it comes to good, whenever they do.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from robotouille.planning.plan import Plan
from robotouille.planning.policies.standing import standing_at, travel_ends, walks_aside
from robotouille.world.world import State

__all__ = ["station_in_the_way", "with_others_aside"]


def with_others_aside(state: State, others: Iterable[str]) -> State:
    """A state of the model as if some players had walked to where nobody wants to be."""
    for player in others:
        for walk in walks_aside(state, player)[:1]:
            facts = (state.facts | walk.touched) ^ walk.removed
            state = State(state.world, facts, state.timers)
    return state


def station_in_the_way(plan: Plan, state: State, others: Collection[str]) -> str | None:
    """The first station to which a plan walks where one of some other players stands."""
    taken = {standing_at(state, player) for player in others}
    for joint in plan:
        for action in joint:
            if action.schema.definition.travel and travel_ends(action)[1] in taken:
                return travel_ends(action)[1]
    return None
