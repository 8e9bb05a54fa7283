"""Episodes in a world that waits for its players: alone, or as a team.

`TextEpisode` does no input or output. It is a generator that yields requests to a model and is
sent the answers, as a strategy is. Its order of operations is that of the published evaluation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from enum import StrEnum

from robotouille import State, World
from robotouille_evaluation.agents.proposal import AgentObservation, Exchange, Proposal, Strategy
from robotouille_evaluation.agents.team import Team
from robotouille_evaluation.models.model import Completion, ModelRequest
from robotouille_evaluation.runs.episode_runner import ChosenAction, EpisodeRunner, PlainRunner

TextView = Callable[[State, str], str]
"""Description of a state for a player: `State.text` as published, or `State.text_view`."""


def observe(state: State, player: str, view: TextView | None) -> AgentObservation:
    """Return a player's observation. Without a view it has only the state, for planners."""
    if view is None:
        return AgentObservation("", (), player, state)
    valid = tuple(action.sentence for action in state.actions(player))
    return AgentObservation(view(state, player), valid, player, state)


class EndReason(StrEnum):
    """Reason why an episode ended."""

    GOAL = "goal"
    SHIFT_OVER = "shift-over"
    STEP_LIMIT = "step-limit"
    FINISH = "finish"
    FEEDBACK_LIMIT = "feedback-limit"
    PLAN_REFUSED = "plan-refused"
    PLAN_EXHAUSTED = "plan-exhausted"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class TrialStep:
    """Step of a trial: numbers of trial and step, counted from one, and the action's sentence."""

    trial: int
    step: int
    action: str
    reasoning: str = ""


@dataclass(frozen=True, slots=True)
class TextEpisodeResult:
    """Result of an episode.

    `steps` are the steps of the last trial. `logged_steps` is the number that the published
    evaluation logs: 0 if the goal was reached in the last step of a trial that is not the last.
    """

    ended: EndReason
    success: bool
    steps: int
    exchanges: tuple[Exchange, ...]
    taken: tuple[TrialStep, ...]
    logged_steps: int


class TextEpisode:
    """Episode of one strategy that plays alone.

    Args:
        budget: Steps of one trial. Fractions are rounded up. As in the published evaluation, they
            are rounded down in a trial that another one may follow.
        begin: Returns the runner of a trial with this step limit.
        view: Description that the strategy reads.
        blind: Hide a random reversal from the next observation, as published.
    """

    def __init__(
        self,
        world: World,
        strategy: Strategy,
        budget: float,
        *,
        begin: Callable[[int], EpisodeRunner] | None = None,
        view: TextView | None = State.text,
        blind: bool = False,
    ) -> None:
        self._player = world.players[0]
        self._strategy = strategy
        self._budget = budget
        self._begin = begin or (lambda _: PlainRunner(world))
        self._view = view
        self._blind = blind
        self._exchanges: list[Exchange] = []
        self._taken: list[TrialStep] = []
        self._trial = 1
        self._steps = 0

    def play(self) -> Generator[ModelRequest, Completion, TextEpisodeResult]:
        """Yield requests to a model and return the result."""
        while True:
            ended = yield from self._play_trial()
            if ended is not EndReason.STEP_LIMIT or not self._strategy.retry():
                break
            self._trial += 1
            self._steps = 0
        return TextEpisodeResult(
            ended,
            ended is EndReason.GOAL,
            self._steps,
            tuple(self._exchanges),
            tuple(self._taken),
            self._logged_steps(ended),
        )

    def _logged_steps(self, ended: EndReason) -> int:
        at_limit = self._steps >= math.floor(self._budget) and self._strategy.retries_left > 0
        return 0 if ended is EndReason.GOAL and at_limit else self._steps

    def _play_trial(self) -> Generator[ModelRequest, Completion, EndReason]:
        # As in the published code, 31.5 steps allow 32 steps, but 31 in a trial before a retry.
        rounded = math.floor if self._strategy.retries_left else math.ceil
        limit = rounded(self._budget)
        runner = self._begin(limit)
        state = runner.state
        seen = self._observe(state)
        while self._steps < limit and not state.shift_over:
            # With timing for people, actions take several steps in which nothing can be chosen.
            if state.busy_steps(self._player):
                state, seen = self._step(runner, "", "")
                continue
            proposal = yield from self._strategy.propose(seen)
            for exchange in proposal.exchanges:
                self._exchanges.append(exchange)
                runner.answered(self._player, exchange)
            if proposal.whole and not self._is_executable(runner, proposal, state):
                return EndReason.PLAN_REFUSED
            for action in proposal.actions:
                state, seen = self._step(runner, action, proposal.reasoning)
                if state.goal_reached:
                    return EndReason.GOAL
                if self._steps >= limit or state.shift_over:
                    return _reason_out_of_steps(state)
            if proposal.done:
                return _reason_when_done(proposal)
        return _reason_out_of_steps(state)

    def _observe(self, state: State) -> AgentObservation:
        return observe(state, self._player, self._view)

    def _step(
        self, runner: EpisodeRunner, action: str, reasoning: str
    ) -> tuple[State, AgentObservation]:
        self._steps += 1
        self._taken.append(TrialStep(self._trial, self._steps, action, reasoning))
        step = runner.step({self._player: ChosenAction(action, reasoning)})
        self._strategy.observe(step.did)
        return step.state, self._observe(step.undisturbed if self._blind else step.state)

    def _is_executable(self, runner: EpisodeRunner, proposal: Proposal, state: State) -> bool:
        """Return whether each action of a plan is valid in its turn; record the first that is not.

        As in the published benchmark, actions after the goal count too.
        """
        for action in proposal.actions:
            if action not in {valid.sentence for valid in state.actions(self._player)}:
                runner.reject(self._player, ChosenAction(action, proposal.reasoning), state)
                return False
            state = state.step(action).state
        return bool(proposal.actions)


def _reason_out_of_steps(state: State) -> EndReason:
    return EndReason.SHIFT_OVER if state.shift_over else EndReason.STEP_LIMIT


def _reason_when_done(proposal: Proposal) -> EndReason:
    if proposal.whole:
        return EndReason.PLAN_EXHAUSTED
    finished = proposal.exchanges and not proposal.exchanges[-1].feedback
    return EndReason.FINISH if finished else EndReason.FEEDBACK_LIMIT


@dataclass(frozen=True, slots=True)
class TeamResult:
    """Result of a team's episode, with the exchanges of each player's model."""

    ended: EndReason
    success: bool
    steps: int
    exchanges: Mapping[str, tuple[Exchange, ...]]

    @classmethod
    def of(
        cls, ended: EndReason, steps: int, exchanges: Mapping[str, list[Exchange]]
    ) -> TeamResult:
        """Return a result with these exchanges so far."""
        frozen = {player: tuple(each) for player, each in exchanges.items()}
        return cls(ended, ended is EndReason.GOAL, steps, frozen)


async def play_team(
    team: Team, runner: EpisodeRunner, budget: float, view: TextView | None = State.text_view
) -> TeamResult:
    """Play until the goal is reached, the shift is over, or the budget is used up.

    Play also ends when all agents have finished. A player whose answers have no valid action, or
    who has finished, does nothing. A proposed plan of several actions is carried out as long as
    each is valid.
    """
    state, steps = runner.state, 0
    players = state.world.players
    planned: dict[str, list[str]] = {player: [] for player in players}
    latest: dict[str, Proposal] = dict.fromkeys(players, Proposal())
    done: set[str] = set()
    exchanges: dict[str, list[Exchange]] = {player: [] for player in players}

    def take(player: str, proposal: Proposal) -> None:
        planned[player] = list(proposal.actions)
        latest[player] = proposal
        exchanges[player] += proposal.exchanges
        for exchange in proposal.exchanges:
            runner.answered(player, exchange)
        if proposal.say:
            runner.say(player, proposal.say)
        if proposal.done:
            done.add(player)

    while steps < math.ceil(budget) and not state.shift_over:
        free = [player for player in players if not state.busy_steps(player)]
        asked = [p for p in free if p not in done and not planned[p]]
        if asked:
            await team.propose({p: observe(state, p, view) for p in asked}, take)
        if len(done) == len(players) and not any(planned.values()):
            return TeamResult.of(EndReason.FINISH, steps, exchanges)
        choices = {p: _next_action(runner, state, p, planned[p], latest[p]) for p in free}
        step = runner.step(choices)
        state, steps = step.state, steps + 1
        team.observe(step.did)
        for player, reasons in step.rejected.items():
            team.rejected(player, choices[player].action, reasons)
        if state.goal_reached:
            return TeamResult.of(EndReason.GOAL, steps, exchanges)
    return TeamResult.of(_reason_out_of_steps(state), steps, exchanges)


def _next_action(
    runner: EpisodeRunner, state: State, player: str, planned: list[str], proposal: Proposal
) -> ChosenAction:
    if not planned:
        return ChosenAction()
    # Other players may have made a later action of the plan impossible.
    choice = ChosenAction(planned.pop(0), proposal.reasoning, anticipates=proposal.anticipates)
    valid = {action.sentence for action in state.actions(player)}
    if choice.anticipates or not choice.action or choice.action in valid:
        return choice
    runner.reject(player, choice, state)
    planned.clear()
    return ChosenAction()
