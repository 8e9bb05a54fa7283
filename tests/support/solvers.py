"""Solvers that claim what a test wants them to."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from robotouille import State, World
from robotouille.certification.certificate import Solver
from robotouille.planning.beam.planner import BeamPlanner
from robotouille.planning.plan import Plan, read_plan, write_plan
from robotouille.planning.search_result import UNLIMITED, Limits, Proof, SearchResult, Watch

__all__ = ["answering", "planned", "proving"]

TEXTS: dict[tuple[str, str], str] = {}


def planned(state: State) -> Plan:
    """A plan from a state, searched for once."""
    world, key = state.world, (state.world.task.digest, state.digest)
    if key not in TEXTS:
        TEXTS[key] = write_plan(BeamPlanner(world).solve(state, world.players).plan, world)
    return read_plan(TEXTS[key], world)


def proving(
    world: World,
    start: State | None = None,
    *,
    limits: Limits = UNLIMITED,
    watch: Watch | None = None,
) -> SearchResult:
    """A planner that claims that its first plan is a shortest one."""
    state = start or world.initial
    if limits.expansions == 0:
        return SearchResult(None, 0, Proof.NONE, "proving 1.0", 0)
    plan = planned(state)
    if watch is not None:
        watch(7, len(plan) - 1, len(plan))
    return SearchResult(plan, len(plan), Proof.EXHAUSTED, "proving 1.0", 7)


def answering(**changes: Any) -> Solver:
    """A planner whose answer is that of `proving` with changes."""

    def solver(world: World, start: State | None = None, **options: Any) -> SearchResult:
        return replace(proving(world, start), **changes)

    return solver
