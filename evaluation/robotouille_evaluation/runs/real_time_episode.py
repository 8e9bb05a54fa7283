"""Episodes in simulated real time: steps pass while models think, and runs are reproducible.

The cost of a thought is computed from its answers (`Charge`). An answer takes effect when the
simulated time has advanced by this cost. Nothing waits, and no clock is read.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from robotouille import State
from robotouille.planning.policies import Policy
from robotouille_evaluation.agents.proposal import Complete, Exchange, Proposal, all_of, answer_all
from robotouille_evaluation.agents.team import TeamChat
from robotouille_evaluation.realtime import Charge, ObservedStep, RealTimeSeat
from robotouille_evaluation.realtime.thoughts import TOPIC
from robotouille_evaluation.runs.episode_runner import ChosenAction, RecordedRunner
from robotouille_evaluation.runs.text_episode import EndReason, TeamResult, TextView, observe


@dataclass(slots=True)
class _PendingAnswer:
    """Answer that takes effect at the step `due`."""

    proposal: Proposal
    basis: int
    due: int


class RealTimeEpisode:
    """Episode of several seats in simulated real time.

    A model that sees step `s` and thinks for `ms` milliseconds acts at step
    `s + ceil(ms / 1000 * step_rate)` at the earliest, or later if its player is busy. A rejected
    action costs no step. When a seat has finished, its helper stops as well.

    Args:
        complete: Functions that ask each player's model.
        charge: Cost of thinking.
        step_rate: Steps per second.
        helpers: Policies that act while a player's model thinks.
        view: Description that models read.
    """

    def __init__(
        self,
        seats: Mapping[str, RealTimeSeat],
        runner: RecordedRunner,
        complete: Mapping[str, Complete],
        charge: Charge,
        step_rate: float,
        helpers: Mapping[str, Policy] | None = None,
        view: TextView | None = State.text_view,
    ) -> None:
        self._players = runner.state.world.players
        self._seats = seats
        self._runner = runner
        self._complete = complete
        self._charge = charge
        self._step_rate = step_rate
        self._helpers = helpers or {}
        self._view = view
        self._chat = TeamChat(seats)
        self._pending: dict[str, _PendingAnswer] = {}
        self._exchanges: dict[str, list[Exchange]] = {player: [] for player in self._players}

    async def play(self, budget: float) -> TeamResult:
        """Play until the goal or the end of a shift or the budget, or until all have finished."""
        try:
            ended = await self._play(math.ceil(budget))
        finally:
            # Pending answers have been paid for, even if a model has failed.
            for player, pending in self._pending.items():
                self._count(player, pending)
        return TeamResult.of(ended, self._runner.steps, self._exchanges)

    async def _play(self, limit: int) -> EndReason:
        runner = self._runner
        while not _is_over(runner.state) and runner.steps < limit:
            choices = await self._choices()
            if all(seat.over for seat in self._seats.values()) and not choices:
                return EndReason.FINISH
            step = runner.step(choices)
            for player, seat in self._seats.items():
                seat.observe(step.did)
                if player in self._helpers:
                    self._helpers[player].observe(step.did)
        if runner.state.goal_reached:
            return EndReason.GOAL
        return EndReason.SHIFT_OVER if runner.state.shift_over else EndReason.STEP_LIMIT

    async def _choices(self) -> dict[str, ChosenAction]:
        """Return the choices for the next step, without players that do nothing."""
        state, step = self._runner.state, self._runner.steps
        free = [player for player in self._players if not state.busy_steps(player)]
        observed = {player: self._observe(player) for player in free}
        choices = {player: self._choose(player, observed[player]) for player in free}
        asked = [
            player
            for player in free
            if choices[player] is None and self._seats[player].wants_to_look(step)
        ]
        # All at the same time: calls take seconds, and no step passes in between.
        await all_of(self._ask(player, observed[player]) for player in asked)
        for player in asked:  # A thought that costs nothing takes effect in the same step.
            choices[player] = self._choose(player, observed[player])
        for player in free:
            if choices[player] is None and self._seats[player].thinking:
                choices[player] = self._help(player)
        return {player: choice for player, choice in choices.items() if choice is not None}

    def _observe(self, player: str) -> ObservedStep:
        seen = observe(self._runner.state, player, self._view)
        return ObservedStep(self._runner.steps, seen.text, seen.valid)

    def _choose(self, player: str, now: ObservedStep) -> ChosenAction | None:
        """Return the choice of the model's last answer. An invalid one is rejected."""
        seat = self._seats[player]
        pending = self._pending.get(player)
        if pending is not None and pending.due <= now.step:
            del self._pending[player]
            self._deliver(player, pending)
        decision = seat.choose(now)
        self._note(player)
        if decision is None:
            return None
        choice = ChosenAction(decision.action, decision.reasoning, decision.basis)
        if decision.valid or self._view is None:
            return choice
        seat.rejected(decision.action, self._runner.reject(player, choice))
        return None

    async def _ask(self, player: str, now: ObservedStep) -> None:
        seat = self._seats[player]
        shown = replace(seat.look(now, self._runner.state), heard=self._chat.read(player))
        self._note(player)
        proposal = await answer_all(seat.strategy.propose(shown), self._complete[player])
        thought = self._charge.milliseconds(proposal.exchanges) / 1000
        # 0.14 * 50 is a bit more than 7 in floating point. Without rounding, it would cost 8 steps.
        due = now.step + math.ceil(round(thought * self._step_rate, 9))
        self._pending[player] = _PendingAnswer(proposal, now.step, due)

    def _deliver(self, player: str, pending: _PendingAnswer) -> None:
        self._count(player, pending)
        if pending.proposal.say:
            self._chat.say(player, pending.proposal.say)
            self._runner.say(player, pending.proposal.say)
        self._seats[player].answer(pending.proposal)
        self._note(player)

    def _count(self, player: str, pending: _PendingAnswer) -> None:
        for exchange in pending.proposal.exchanges:
            self._exchanges[player].append(exchange)
            self._runner.answered(player, exchange, pending.basis)

    def _note(self, player: str) -> None:
        """Record when a model thinks. Planners, which have no view, take no time."""
        notes = self._seats[player].notes
        for text in notes if self._view is not None else ():
            self._runner.note(player, TOPIC, text)
        notes.clear()

    def _help(self, player: str) -> ChosenAction | None:
        """Return the helper's choice, which is not based on an answer."""
        helper = self._helpers.get(player)
        action = helper.act(self._runner.state) if helper is not None else None
        return ChosenAction(action.sentence) if action is not None else None


def _is_over(state: State) -> bool:
    return state.goal_reached or state.shift_over
