"""One function for all searches: optimal, anytime and beam search."""

from __future__ import annotations

from enum import StrEnum

from robotouille.errors import WrongArgumentError
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.beam.planner import EXPANSIONS, PLANNER, BeamPlanner
from robotouille.planning.plan import UNLIMITED, Limits, Proof, SearchResult, Watch
from robotouille.planning.plugins import domain_planner
from robotouille.planning.search.best_first import astar_search
from robotouille.world.world import State, World


class Search(StrEnum):
    """Kind of search.

    `OPTIMAL`: the shortest plan with proof, by the domain's plug-in or by A*. `ANYTIME`: a good
    plan quickly, the last one of `AnytimePlanner.search`. `BEAM`: a plan by beam search, without
    proof.
    """

    OPTIMAL = "optimal"
    ANYTIME = "anytime"
    BEAM = "beam"


def solve(
    world: World,
    start: State | None = None,
    *,
    search: Search | str = Search.OPTIMAL,
    limits: Limits = UNLIMITED,
    watch: Watch | None = None,
) -> SearchResult:
    """Return a plan from a state, by default the initial one, in which all players act together.

    Equal arguments give equal results, unless `limits.stop` ends the search.

    Args:
        start: A state of this world.
        search: `optimal`, `anytime` or `beam`. An anytime plan ignores the timing profile: see
            `AnytimePlanner`.
        limits: Limits of the search. A beam search only uses `expansions`; its default takes about
            half a second.
        watch: Callback of an optimal search.

    Returns:
        The best plan found, or None, and a proven lower bound on the length of every plan.

    Raises:
        PluginError: An installed plug-in cannot be loaded.
        WrongArgumentError: The search is unknown.
    """
    state = world.initial if start is None else start
    if search == Search.ANYTIME:
        *_, result = AnytimePlanner(world).search(state, limits)
        return result
    if search == Search.BEAM:
        return _beam(world, state, limits)
    if search != Search.OPTIMAL:
        names = ", ".join(map(repr, map(str, Search)))
        raise WrongArgumentError(f"expected one of {names}, found {search!r}")
    planner = domain_planner(world)
    found = planner.solve(world, state, limits, watch) if planner is not None else None
    return found or astar_search(world, state, limits=limits, watch=watch)


def _beam(world: World, start: State, limits: Limits) -> SearchResult:
    expansions = EXPANSIONS if limits.expansions is None else limits.expansions
    found = BeamPlanner(world).solve(start, expansions=expansions)
    plan = found.plan if found.reached else None
    return SearchResult(plan, 0, Proof.NONE, PLANNER, found.expansions)
