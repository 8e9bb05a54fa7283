"""Plans, by whichever search is wanted: one question, one kind of answer."""

from __future__ import annotations

from enum import StrEnum

from robotouille.errors import WrongArgumentError
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.beam.planner import EXPANSIONS, PLANNER, BeamPlanner
from robotouille.planning.plugins import domain_planner
from robotouille.planning.search.astar import astar_search
from robotouille.planning.search_result import UNLIMITED, Limits, Proof, SearchResult, Watch
from robotouille.world.world import State, World

__all__ = ["Search", "solve"]


class Search(StrEnum):
    """How `solve` looks for a plan.

    `OPTIMAL`: the shortest, with proof, by the plug-in that knows the domain, or by A* in any.
    `ANYTIME`: a good one soon, for play: what `AnytimePlanner.search` has at last. `BEAM`: one by
    beam search, in any domain, which proves nothing.
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
    """A plan from a state (the initial one if None): the shortest, as far as the limits allow, or
    one by another search.

    All players of the world act together. One input, one result, unless `limits.stop` intervenes.

    Args:
        start: A state of this world.
        search: `optimal`, `anytime` or `beam`. The plan of an anytime search is one without timing
            profile: see `AnytimePlanner`.
        limits: For a beam search only `expansions` matters; without them it takes about half a
            second.
        watch: Is called now and then with expansions, bound and the best plan's length so far, by
            an optimal search.

    Returns:
        The best plan found (None if none), and a proven bound on the length of every plan.

    Raises:
        PluginError: An installed plug-in cannot be loaded.
        WrongArgumentError: There is no such search.
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
