"""What a team would do if others made way: who is in it, and the state in which nobody is.

A team that is in no position to reach the goal waits for others to walk. What it does meanwhile is
part of a plan for when they have: so it comes to good, whenever they do. What it asks of them is
found in the present state each time that it is asked.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from robotouille.planning.policies.script import Script
from robotouille.planning.policies.standing import leads_to, standing_at, walks_aside
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.people.occupancy import Occupancy
from robotouille.world.unmet import UnmetKind
from robotouille.world.world import State

__all__ = ["missing_deed", "station_in_the_way", "with_others_aside"]


def with_others_aside(state: State, others: Iterable[str]) -> State:
    """A state of the model as if some players had walked to where nobody wants to be."""
    for player in others:
        for walk in walks_aside(state, player)[:1]:
            facts = (state.facts | walk.touched) ^ walk.removed
            state = State(state.world, facts, state.timers)
    return state


def station_in_the_way(
    coming: Iterable[GroundAction], state: State, others: Collection[str]
) -> str | None:
    """The first station to which some actions walk where one of some other players stands."""
    taken = {standing_at(state, player) for player in others}
    return next((each.destination for each in coming if leads_to(each, taken)), None)


def missing_deed(
    script: Script, state: State, others: Iterable[str], rules: Occupancy
) -> GroundAction | None:
    """What a plan has somebody else do next, if that can be done now but for where they stand."""
    for player in others:
        planned = None if player in script.astray else script.deed(player)
        if planned is None or not state.world.thing_names.issuperset(planned.arguments):
            continue
        deed = state.world.action(planned.name, *planned.arguments)
        unmet = state.world.unmet(state, deed)
        if all(u.kind is UnmetKind.BUSY or rules.is_about_standing(u.predicate) for u in unmet):
            return deed
    return None
