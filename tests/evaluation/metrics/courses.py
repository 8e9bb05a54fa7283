"""Hand-made trajectories on small tasks, whose metrics can be computed by hand."""

from __future__ import annotations

from robotouille import World, load_task
from robotouille_evaluation.metrics import AnswerVerdict, StepAnswer, Trajectory
from robotouille_evaluation.metrics.trajectory import rejected_answer

__all__ = ["SANDWICH", "WANDERING", "refused", "solo", "wandering"]

SANDWICH = World(load_task("synchronous/01"))
"""A cheese sandwich: bread1 on table2, cheese1 on table1, bread2 on table5; the cook at table3.
Fewest steps: to the cheese, take it, to table2, stack; to bread2, take it, back, stack: 8."""

WANDERING = (
    "Move robot1 from table3 to table1",
    "Move robot1 from table1 to table3",
    "Move robot1 from table3 to table1",  # the first step again
    "Pick up cheese1 at table1 with robot1",
    "Move robot1 from table1 to table2",
    "Stack cheese1 onto bread1 at table2 with robot1",
)
"""The bread on top is missing: 4 steps to go."""


def solo(
    world: World, *sentences: str | None, answers: list[StepAnswer] | None = None
) -> Trajectory:
    """Return the trajectory of a single cook; None does nothing."""
    return Trajectory.played(world, [{"robot1": s} for s in sentences], answers)


def wandering() -> Trajectory:
    return solo(SANDWICH, *WANDERING)


def refused(
    trajectory: Trajectory, step: int, *texts: str, reasoning: str = ""
) -> list[StepAnswer]:
    """Return rejected answers of the single cook after some steps."""
    state = trajectory.states[step]
    found = [rejected_answer(step, "robot1", text, state) for text in texts]
    assert all(each.verdict is not AnswerVerdict.APPLIED for each in found)
    return [
        StepAnswer(a.step, a.seat, a.text, a.verdict, reasoning, a.reasons, a.unmet, a.action)
        for a in found
    ]
