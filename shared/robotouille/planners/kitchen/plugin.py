"""What the kitchen planner offers to `robotouille.planning.plugins`."""

from __future__ import annotations

from robotouille.planners.kitchen.anytime_search import KitchenAnytimeSearch
from robotouille.planners.kitchen.goal_assignments import TooManyChoicesError
from robotouille.planners.kitchen.model import rules_of
from robotouille.planners.kitchen.solver import KitchenSearch, kitchen_search
from robotouille.planning.beam.planner import BeamPlanner
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import Limits, SearchResult, Watch
from robotouille.world.world import State, World

__all__ = ["KITCHEN", "KitchenPlanner"]

MAX_ANYTIME_PLAYERS = 2
"""Larger teams have too many joint actions for a search that tries all of them during play."""

BEAM = 4_000
"""Expansions of the beam search for a team."""


class KitchenPlanner:
    """Plans for worlds that are kitchens, with goals that are a kitchen's."""

    def recognises(self, world: World) -> bool:
        return rules_of(world) is not None

    def solve(
        self, world: World, start: State, limits: Limits, watch: Watch | None
    ) -> SearchResult | None:
        search = _search(world, start)
        if search is None:
            return None
        if len(world.players) == 1:
            return search.solve(limits, watch)
        return search.solve(limits, watch, lambda: _team_plan(world, start, limits))

    def anytime(self, world: World, start: State) -> KitchenAnytimeSearch | None:
        search = _search(world, start) if len(world.players) <= MAX_ANYTIME_PLAYERS else None
        return None if search is None else KitchenAnytimeSearch(search)


KITCHEN = KitchenPlanner()


def _search(world: World, start: State) -> KitchenSearch | None:
    try:
        return kitchen_search(world, start)
    except TooManyChoicesError:
        return None


def _team_plan(world: World, start: State, limits: Limits) -> Plan | None:
    """A plan of a beam search for several players, whose shortest plans are hard to find.

    More than two get in one another's way: some pairs, the others standing still, are tried too.
    """
    planner, players = BeamPlanner(world), tuple(world.players)
    pairs = [players[:2], players[1:3]] if len(players) > 2 else []
    plans = []
    for team in (players, *pairs):
        if limits.stop is not None and limits.stop():
            break
        solution = planner.solve(start, team, expansions=BEAM)
        if solution.reached:
            plans.append(solution.plan)
    return min(plans, key=len, default=None)
