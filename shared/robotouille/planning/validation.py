"""Replay of plans by the world's own rules: slow, obvious, and independent of any search."""

from __future__ import annotations

from dataclasses import dataclass

from robotouille.planning.plan import Plan
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, World

__all__ = ["PlanReport", "Rejection", "replay"]


@dataclass(frozen=True, slots=True)
class Rejection:
    """An action of a plan that was rejected: in which step (from 1), and why."""

    step: int
    action: GroundAction
    reasons: tuple[str, ...]

    def __str__(self) -> str:
        return f"step {self.step}: {self.action}: {'; '.join(self.reasons)}"


@dataclass(frozen=True, slots=True)
class PlanReport:
    """What became of a plan.

    `reached_at` is the first step (from 1) after which the goal holds, 0 if it held at the start,
    None if it never did; `rejection` the first action that was rejected.
    """

    steps: int
    reached_at: int | None
    rejection: Rejection | None
    final: State

    @property
    def ok(self) -> bool:
        """Whether every action applied and the goal was reached by the last step, no earlier."""
        return self.rejection is None and self.reached_at == self.steps

    def __str__(self) -> str:
        if self.rejection is not None:
            return str(self.rejection)
        if self.reached_at is None:
            return f"the goal is not reached in {self.steps} steps"
        return f"the goal is reached in step {self.reached_at} of {self.steps}"


def replay(plan: Plan, world: World, start: State | None = None) -> PlanReport:
    """Take every step of a plan, from the initial state or from `start`.

    Rejected actions are in the report, and the replay goes on behind them.

    Raises:
        WrongWorldError: The plan or the start is of another task.
    """
    state = world.initial if start is None else start
    reached_at = 0 if state.goal_reached else None
    rejection = None
    for number, joint in enumerate(plan, start=1):
        step = world.step(state, joint)
        state = step.state
        if step.goal_reached and reached_at is None:
            reached_at = number
        for attempt in step.attempts:
            if not attempt.applied and rejection is None:
                rejection = Rejection(number, attempt.action, attempt.reasons)
    return PlanReport(len(plan), reached_at, rejection, state)
