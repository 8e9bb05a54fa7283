"""Shorter ends of a team's plan: from late states on, the shortest way to the goal is soon found.

Ends are looked at from the last steps forward. Where one gets shorter, the search goes back a few
steps: what is behind has changed.
"""

from __future__ import annotations

from robotouille.planners.kitchen.goal_assignments import TooManyChoicesError
from robotouille.planners.kitchen.search.nodes import UNIT
from robotouille.planners.kitchen.solver import SolverRun, kitchen_search
from robotouille.planning.plan import Joint, Plan
from robotouille.planning.search_result import Limits
from robotouille.world.world import State

__all__ = ["shorten_ends"]

LAST_STEPS = 6
"""An end of fewer steps is not looked at: it is hardly ever too long."""

STRIDE = 2
"""Steps between two states from which an end is sought."""

SHARE = 8
"""The part of all expansions that may be spent on one end."""

EXPANSIONS = 64
"""For one end, where there is no limit."""


def shorten_ends(plan: Plan, start: State, limits: Limits) -> tuple[Plan, int]:
    """The plan or a shorter one, and the expansions it took."""
    steps, spent = list(plan), 0
    states = _states(steps, start)
    at = len(steps) - LAST_STEPS
    while at >= 0 and not (limits.stop is not None and limits.stop()):
        found, expansions = _end(states[at], len(steps) - at, limits)
        spent += expansions
        if found is not None:
            steps[at:] = found
            states[at:] = _states(found, states[at])
            at = min(len(steps) - LAST_STEPS, at + 2 * STRIDE)
        at -= STRIDE
    return Plan(tuple(steps)), spent


def _states(steps: list[Joint], start: State) -> list[State]:
    states = [start]
    for joint in steps:
        states.append(states[-1].step(joint).state)
    return states


def _end(start: State, length: int, limits: Limits) -> tuple[list[Joint] | None, int]:
    """The steps from a state to the goal, if fewer than some length are found."""
    try:
        search = kitchen_search(start.world, start)
    except TooManyChoicesError:
        return None, 0
    if search is None:
        return None, 0
    most = EXPANSIONS if limits.expansions is None else limits.expansions // SHARE
    run = SolverRun(search, UNIT, Limits(most, limits.states, limits.stop), None)
    run.improve_on(length)
    run.go(None)
    found = None if run.goal_node is None else list(search.plan(run.path()))
    return found, run.expansions
