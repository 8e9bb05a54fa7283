"""Solvers whose results a test determines."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from robotouille import State, World, task_names
from robotouille.certification.certificate import Solver
from robotouille.planning.beam.planner import BeamPlanner
from robotouille.planning.plan import (
    UNLIMITED,
    Limits,
    Plan,
    Proof,
    SearchResult,
    Watch,
    read_plan,
    write_plan,
)

__all__ = ["answering", "planned", "proving"]

TEXTS: dict[tuple[str, str], str] = {}


def planned(state: State) -> Plan:
    """Return a plan from a state; each plan is searched for once."""
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
    """Solve like a planner that claims that its first plan is shortest."""
    state = start or world.initial
    if limits.expansions == 0:
        return SearchResult(None, 0, Proof.NONE, "proving 1.0", 0)
    plan = planned(state)
    if watch is not None:
        watch(7, len(plan) - 1, len(plan))
    return SearchResult(plan, len(plan), Proof.EXHAUSTED, "proving 1.0", 7)


def answering(**changes: Any) -> Solver:
    """Return a solver that replaces fields in the results of `proving`."""

    def solver(world: World, start: State | None = None, **options: Any) -> SearchResult:
        return replace(proving(world, start), **changes)

    return solver


_LENGTHS = {
    "synchronous": [8, 14, 24, 11, 15, 23, 36, 36, 60, 54],
    "asynchronous": [17, 23, 33, 42, 46, 19, 42, 40, 58, 72],
}
SHIPPED = {
    name: length
    for folder, lengths in _LENGTHS.items()
    for name, length in zip(
        [name for name in task_names() if name.startswith(f"{folder}/")], lengths, strict=True
    )
}
"""Length of the shortest plan of each shipped task for one player."""
