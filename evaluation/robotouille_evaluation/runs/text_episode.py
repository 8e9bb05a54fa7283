"""One episode of an agent that is alone and has time: observe, ask, act, until the budget is spent.

Without input or output: a generator that yields what a model is to be asked and is sent the answer,
as a strategy is. The order of things is that of the published evaluation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from enum import StrEnum

from robotouille import State, World
from robotouille_evaluation.agents.proposal import Exchange, Observation, Proposal, Strategy
from robotouille_evaluation.models.model import Completion, ModelRequest
from robotouille_evaluation.runs.stage import Decision, PlainStage, Stage

__all__ = ["Ended", "Taken", "TextEpisode", "TextResult", "View", "observe"]

View = Callable[[State, str], str]
"""What a player that reads is sent of a state: `State.text`, as published, or `State.text_view`."""


def observe(state: State, player: str, view: View | None) -> Observation:
    """What a player sees; without a view the state alone, for agents that do not read."""
    if view is None:
        return Observation("", (), player, state)
    valid = tuple(action.sentence for action in state.actions(player))
    return Observation(view(state, player), valid, player, state)


class Ended(StrEnum):
    """Why an episode is over."""

    GOAL = "goal"
    STEP_LIMIT = "step-limit"
    FINISH = "finish"
    FEEDBACK_LIMIT = "feedback-limit"
    PLAN_REFUSED = "plan-refused"
    PLAN_EXHAUSTED = "plan-exhausted"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Taken:
    """A step: its trial and number, counted from one, and its action's sentence."""

    trial: int
    step: int
    action: str
    reasoning: str = ""


@dataclass(frozen=True, slots=True)
class TextResult:
    """How an episode went. `steps` are those of the last trial; the published evaluation logs none
    where the goal was reached in the last step of a trial after which there could be another."""

    ended: Ended
    success: bool
    steps: int
    trials: int
    exchanges: tuple[Exchange, ...]
    taken: tuple[Taken, ...]
    logged_steps: int


class TextEpisode:
    """An episode of one strategy, which plays alone.

    Args:
        budget: Steps of one trial. One that is no whole number is rounded up; in a trial after
            which there may be another, down, as the published evaluation does.
        begin: Makes the stage of a trial from its limit of steps.
        view: What the strategy reads.
        blind: What chance undoes is not seen in the next observation, as published.
    """

    def __init__(
        self,
        world: World,
        strategy: Strategy,
        budget: float,
        *,
        begin: Callable[[int], Stage] | None = None,
        view: View | None = State.text,
        blind: bool = False,
    ) -> None:
        self._world = world
        self._player = world.players[0]
        self._strategy = strategy
        self._budget = budget
        self._begin = begin or (lambda _: PlainStage(world))
        self._view = view
        self._blind = blind
        self._exchanges: list[Exchange] = []
        self._taken: list[Taken] = []
        self._trial = 1
        self._steps = 0

    def play(self) -> Generator[ModelRequest, Completion, TextResult]:
        """Yields requests to a model; ends with the result."""
        while True:
            ended = yield from self._play_trial()
            if ended is not Ended.STEP_LIMIT or not self._strategy.retry():
                break
            self._trial += 1
            self._steps = 0
        return TextResult(
            ended,
            ended is Ended.GOAL,
            self._steps,
            self._trial,
            tuple(self._exchanges),
            tuple(self._taken),
            self._logged(ended),
        )

    def _logged(self, ended: Ended) -> int:
        last = self._steps >= math.floor(self._budget) and self._strategy.retries_left > 0
        return 0 if ended is Ended.GOAL and last else self._steps

    def _play_trial(self) -> Generator[ModelRequest, Completion, Ended]:
        rounded = math.floor if self._strategy.retries_left else math.ceil
        limit = rounded(self._budget)
        stage = self._begin(limit)
        state = stage.state
        seen = self._observe(state)
        while self._steps < limit:
            if state.busy_steps(self._player):
                state, seen = self._step(stage, "", "")
                continue
            proposal = yield from self._strategy.propose(seen)
            for exchange in proposal.exchanges:
                self._exchanges.append(exchange)
                stage.answered(self._player, exchange)
            if proposal.whole and self._refused(stage, proposal, state):
                return Ended.PLAN_REFUSED
            for action in proposal.actions:
                state, seen = self._step(stage, action, proposal.reasoning)
                if state.goal_reached:
                    return Ended.GOAL
                if self._steps >= limit:
                    return Ended.STEP_LIMIT
            if proposal.done:
                return _why(proposal)
        return Ended.STEP_LIMIT

    def _observe(self, state: State) -> Observation:
        return observe(state, self._player, self._view)

    def _step(self, stage: Stage, action: str, reasoning: str) -> tuple[State, Observation]:
        self._steps += 1
        self._taken.append(Taken(self._trial, self._steps, action, reasoning))
        moved = stage.step({self._player: Decision(action, reasoning)})
        self._strategy.observe(moved.did)
        return moved.state, self._observe(moved.seen if self._blind else moved.state)

    def _refused(self, stage: Stage, proposal: Proposal, state: State) -> bool:
        """Whether some action of a plan is not valid when its turn comes, also behind the goal; the
        first that is not is recorded."""
        for action in proposal.actions:
            if action not in {valid.sentence for valid in state.actions(self._player)}:
                stage.refuse(self._player, Decision(action, proposal.reasoning), state)
                return True
            state = state.step(action).state
        return not proposal.actions


def _why(proposal: Proposal) -> Ended:
    if proposal.whole:
        return Ended.PLAN_EXHAUSTED
    finished = proposal.exchanges and not proposal.exchanges[-1].feedback
    return Ended.FINISH if finished else Ended.FEEDBACK_LIMIT
