"""Proofs that an instance can be solved: plans, replayed by the world's own rules."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from robotouille.generation.instance import Instance
from robotouille.generation.parameters import AttemptError, Parameters
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import Limits, Proof, SearchResult
from robotouille.planning.solvers import solve
from robotouille.planning.validation import replay
from robotouille.world.world import World

__all__ = ["Solver", "carried", "check_band", "shortest", "solved", "working"]

Solver = Callable[[World], SearchResult]
"""Finds a plan for all players of a world from its initial state."""

EXPANSIONS = (20_000, 1_000, 50, 2)
"""How long the usual solver searches, by the number of players: the same on every machine."""


def shortest(world: World) -> SearchResult:
    """The usual solver: a shortest plan, or a good one and a bound.

    Raises:
        PluginError: An installed plug-in cannot be loaded.
    """
    players = min(len(world.players), len(EXPANSIONS))
    return solve(world, limits=Limits(expansions=EXPANSIONS[players - 1]))


def solved(world: World, solver: Solver) -> SearchResult:
    """A solver's result, its plan replayed; AttemptError if there is none or it does not work."""
    if world.initial.goal_reached:
        raise AttemptError("seed", "the goal holds at the start")
    result = solver(world)
    players = len(world.players)
    if result.plan is None:
        how = "there is no plan" if result.unsolvable else "no plan was found"
        raise AttemptError("solver", f"{how} for {players} players")
    return replace(result, plan=working(result.plan, world))


def carried(plan: Plan, instance: Instance, seats: int) -> SearchResult:
    """A plan for the original, carried over to an instance and replayed there."""
    world = instance.world(seats)
    there = working(instance.renaming(seats).carry(plan, world), world)
    return SearchResult(there, 0, Proof.NONE, "carried over", 0)


def working(plan: Plan, world: World) -> Plan:
    """A plan up to the step in which it reaches the goal; AttemptError if it does not work.

    A plan that is carried over may be cut short: irrelevant things can help it to the goal.
    """
    report = replay(plan, world)
    if report.rejection is not None or not report.reached_at:
        message = f"a plan for {len(world.players)} players does not work: {report}"
        raise AttemptError("solver", message)
    return Plan(plan.steps[: report.reached_at])


def check_band(result: SearchResult, parameters: Parameters) -> None:
    """Reject a result unless the optimal number of steps is surely as asked for."""
    low, high = result.bound, len(result.plan or ())
    found = str(high) if low >= high else f"between {low} and {high} (not proven)"
    if parameters.min_steps is not None and low < parameters.min_steps:
        message = (
            f"{parameters.min_steps} asked for; the shortest plan's number of steps is {found}"
        )
        raise AttemptError("min_steps", message)
    if parameters.max_steps is not None and high > parameters.max_steps:
        message = (
            f"{parameters.max_steps} asked for; the shortest plan's number of steps is {found}"
        )
        raise AttemptError("max_steps", message)
