"""Shortest plans, with proof: the planner that suits a world."""

from __future__ import annotations

from robotouille.planners.kitchen.goal_assignments import TooManyChoicesError
from robotouille.planners.kitchen.solver import kitchen_search
from robotouille.planning.beam.planner import Planner
from robotouille.planning.optimal.astar import solve as solve_generally
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import UNLIMITED, Limits, SearchResult, Watch
from robotouille.world.state import State
from robotouille.world.world import World

__all__ = ["solve"]

BEAM = 4_000
"""Expansions of the beam search for a team."""


def solve(
    world: World,
    start: State | None = None,
    *,
    limits: Limits = UNLIMITED,
    watch: Watch | None = None,
) -> SearchResult:
    """The shortest plan from a state (the initial one if None), as far as the limits allow.

    All players of the world act together. One input, one answer, unless `limits.stop` intervenes.
    """
    state = world.initial if start is None else start
    try:
        search = kitchen_search(world, state)
    except TooManyChoicesError:
        search = None
    if search is None:
        return solve_generally(world, state, limits=limits, watch=watch)
    if len(world.players) == 1:
        return search.solve(limits, watch)
    return search.solve(limits, watch, lambda: _team_plan(world, state, limits))


def _team_plan(world: World, state: State, limits: Limits) -> Plan | None:
    """A plan of a beam search for several players, whose shortest plans are hard to find.

    More than two get in one another's way: some pairs, the others standing still, are tried too.
    """
    planner, players = Planner(world), tuple(world.players)
    pairs = [players[:2], players[1:3]] if len(players) > 2 else []
    plans = []
    for team in (players, *pairs):
        if limits.stop is not None and limits.stop():
            break
        solution = planner.solve(state, team, expansions=BEAM)
        if solution.reached:
            plans.append(solution.plan)
    return min(plans, key=len, default=None)
