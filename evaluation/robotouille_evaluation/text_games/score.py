"""Numbers that rate a text game, for rewards and rubrics: each is from 0 to 1 and 1 is best."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from robotouille import State, World
from robotouille.planning import Limits, Plan, StepsToGo
from robotouille_evaluation.metrics.measuring import default_limits
from robotouille_evaluation.runs.text_episode import EndReason


@dataclass(frozen=True, slots=True)
class GameScore:
    """Score of a game, also of one that is not over.

    Attributes:
        ended: Reason of the end; None while the game goes on.
        success: True if the goal was reached within the step budget; false for a shift.
        optimum: Proven fewest steps to the goal, if known.
        progress: 1 - steps to go / steps to go at first. Negative if the goal is farther away than
            at first, but at least -1. None for a shift.
        share: Points of a shift / points of planner bots in the same seats; None for other tasks,
            and if the planner's points are unknown.
        answers: Number of answers.
        invalid: Answers with an action that was not possible.
        malformed: Answers without an action of the task.
    """

    ended: EndReason | None
    success: bool
    steps: int
    budget: int
    optimum: int | None
    progress: float | None
    points: int | None
    share: float | None
    answers: int
    invalid: int
    malformed: int

    @property
    def optimality(self) -> float | None:
        """Fewest steps / steps of a success, and 0 for a failure; None without a proven optimum.

        The benchmark's metric `optimality_rate` is the inverse, and leaves failures out.
        """
        if self.optimum is None:
            return None
        return self.optimum / self.steps if self.success and self.steps else 0.0

    @property
    def format(self) -> float:
        """Share of the answers that name an action of the task; 1 without answers."""
        return 1 - self.malformed / self.answers if self.answers else 1.0

    @property
    def legal(self) -> float:
        """Share of the answers that name a possible action; 1 without answers."""
        return 1 - (self.malformed + self.invalid) / self.answers if self.answers else 1.0

    @property
    def reward(self) -> float:
        """Sum of the rewards: the progress, which is 1 at the goal, or the share of a shift."""
        if self.success:
            return 1.0
        return (self.share if self.progress is None else self.progress) or 0.0

    def as_json(self) -> dict[str, Any]:
        """Return fields and properties as JSON values."""
        more = ("optimality", "format", "legal", "reward")
        return asdict(self) | {name: getattr(self, name) for name in more}


FARTHEST = -1.0
"""Least progress, so that no single action costs more than the goal is worth."""


class Progress:
    """Progress of an episode towards its goal.

    Each new state needs a search, which takes some milliseconds. For teams no search is made: the
    known plan is repaired, which gives at least as many steps as needed.

    Args:
        plan: Known plan from the first state.
        bound: Proven lower bound of its length.

    Attributes:
        value: Progress from -1 to 1; see `GameScore.progress`.
    """

    def __init__(self, world: World, plan: Plan, bound: int) -> None:
        self._distance = StepsToGo(world)
        self._limits: Limits = default_limits(world)
        self._first = len(plan)
        self._distance.learn(world.initial, plan, bound)
        self._before = world.initial
        self.value = 0.0

    def move(self, state: State) -> None:
        """Update the progress to that of the next state."""
        if state == self._before:
            return
        left = self._distance(state, self._limits, after=self._before)
        self._before = state
        if left.dead:
            self.value = FARTHEST
        elif left.steps is not None:  # Otherwise, nothing is known about this state.
            self.value = max(FARTHEST, 1 - left.steps / self._first)
