"""Shortest plans, with proof: by the plug-in that knows the domain, or by the general search."""

from __future__ import annotations

from robotouille.planning.plugins import domain_planner
from robotouille.planning.search.astar import astar_search
from robotouille.planning.search_result import UNLIMITED, Limits, SearchResult, Watch
from robotouille.world.world import State, World

__all__ = ["solve"]


def solve(
    world: World,
    start: State | None = None,
    *,
    limits: Limits = UNLIMITED,
    watch: Watch | None = None,
) -> SearchResult:
    """The shortest plan from a state (the initial one if None), as far as the limits allow.

    All players of the world act together. One input, one result, unless `limits.stop` intervenes.

    Args:
        start: A state of this world.
        watch: Is called now and then with expansions, bound and the best plan's length so far.

    Returns:
        The best plan found (None if none), and a proven bound on the length of every plan.

    Raises:
        PluginError: An installed plug-in cannot be loaded.
    """
    state = world.initial if start is None else start
    planner = domain_planner(world)
    found = planner.solve(world, state, limits, watch) if planner is not None else None
    return found or astar_search(world, state, limits=limits, watch=watch)
