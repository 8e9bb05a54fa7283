"""An episode in simulated real time: steps go by while models think, and a run repeats exactly.

What a thought costs is worked out from its answers (`Charge`); the answer is held back until that
time has passed in the game. Nothing waits, and nothing is measured.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from robotouille import State, World
from robotouille.planning.policies import Policy
from robotouille_evaluation.agents.asking import Complete, all_of, answer_all
from robotouille_evaluation.agents.proposal import Exchange, Proposal
from robotouille_evaluation.agents.teams.chat import TeamChat
from robotouille_evaluation.realtime import Charge, Look, RealTimeSeat
from robotouille_evaluation.realtime.thoughts import TOPIC
from robotouille_evaluation.runs.stage import Decision, RecordedStage
from robotouille_evaluation.runs.team_episode import TeamResult
from robotouille_evaluation.runs.text_episode import Ended, View, observe

__all__ = ["play_real_time"]


@dataclass(slots=True)
class _Awaited:
    """An answer on its way: it counts from the step `due` on."""

    proposal: Proposal
    basis: int
    due: int


async def play_real_time(
    world: World,
    seats: Mapping[str, RealTimeSeat],
    budget: float,
    stage: RecordedStage,
    complete: Mapping[str, Complete],
    charge: Charge,
    step_rate: float,
    helpers: Mapping[str, Policy] | None = None,
    view: View | None = State.text_view,
) -> TeamResult:
    """Play until the goal, until the steps are used up, or until nobody wants to go on.

    A model that looks at step `s` and thinks for `ms` milliseconds acts at step
    `s + ceil(ms / 1000 * step_rate)` at the earliest; a busy player later. What is refused costs no
    step. A seat that wants no further turn does nothing any more, and neither does its helper.

    Args:
        helpers: Who acts in a seat while its model thinks; nobody in a seat without one.
    """
    playing = _RealTimePlay(world, seats, stage, complete, charge, step_rate, helpers or {}, view)
    return await playing.play(math.ceil(budget))


class _RealTimePlay:
    """The seats of one episode, step by step."""

    def __init__(
        self,
        world: World,
        seats: Mapping[str, RealTimeSeat],
        stage: RecordedStage,
        complete: Mapping[str, Complete],
        charge: Charge,
        step_rate: float,
        helpers: Mapping[str, Policy],
        view: View | None,
    ) -> None:
        self._world = world
        self._seats = seats
        self._stage = stage
        self._complete = complete
        self._charge = charge
        self._step_rate = step_rate
        self._helpers = helpers
        self._view = view
        self._chat = TeamChat(seats)
        self._awaited: dict[str, _Awaited] = {}
        self._exchanges: dict[str, list[Exchange]] = {player: [] for player in world.players}

    async def play(self, limit: int) -> TeamResult:
        try:
            ended = await self._play(limit)
        finally:
            self._count_awaited()
        said = {player: tuple(all_of) for player, all_of in self._exchanges.items()}
        return TeamResult(ended, ended is Ended.GOAL, self._stage.steps, said)

    async def _play(self, limit: int) -> Ended:
        stage = self._stage
        while not stage.state.goal_reached and stage.steps < limit:
            decisions = await self._decide(self._free())
            if all(seat.over for seat in self._seats.values()) and not decisions:
                return Ended.FINISH
            moved = stage.step(decisions)
            for player, seat in self._seats.items():
                seat.observe(moved.did)
                if player in self._helpers:
                    self._helpers[player].observe(moved.did)
        return Ended.GOAL if stage.state.goal_reached else Ended.STEP_LIMIT

    def _free(self) -> list[str]:
        state = self._stage.state
        return [player for player in self._world.players if not state.busy_steps(player)]

    async def _decide(self, free: list[str]) -> dict[str, Decision]:
        """What is done in the next step; nothing is said of who does nothing."""
        looks = {player: self._look(player) for player in free}
        decisions = {player: self._choose(player, looks[player]) for player in free}
        step = self._stage.steps
        asked = [
            player
            for player in free
            if decisions[player] is None and self._seats[player].wants_to_look(step)
        ]
        await all_of(self._ask(player, looks[player]) for player in asked)
        for player in asked:  # Whoever has thought in no time acts now.
            decisions[player] = self._choose(player, looks[player])
        for player in free:
            if decisions[player] is None and self._seats[player].thinking:
                decisions[player] = self._help(player)
        return {player: made for player, made in decisions.items() if made is not None}

    def _look(self, player: str) -> Look:
        seen = observe(self._stage.state, player, self._view)
        return Look(self._stage.steps, seen.text, seen.valid)

    def _choose(self, player: str, now: Look) -> Decision | None:
        """What the model's answers say, if one counts now; what is not valid is refused."""
        seat = self._seats[player]
        awaited = self._awaited.get(player)
        if awaited is not None and awaited.due <= now.step:
            del self._awaited[player]
            self._arrive(player, awaited)
        choice = seat.choose(now)
        self._note(player)
        if choice is None:
            return None
        decision = Decision(choice.action, choice.reasoning, choice.basis)
        if choice.valid or self._view is None:
            return decision
        seat.refused(choice.action, self._stage.refuse(player, decision))
        return None

    async def _ask(self, player: str, now: Look) -> None:
        seat = self._seats[player]
        shown = replace(seat.look(now, self._stage.state), heard=self._chat.read(player))
        self._note(player)
        proposal = await answer_all(seat.strategy.propose(shown), self._complete[player])
        thought = self._charge.milliseconds(proposal.exchanges) / 1000
        due = now.step + math.ceil(round(thought * self._step_rate, 9))
        self._awaited[player] = _Awaited(proposal, now.step, due)

    def _arrive(self, player: str, awaited: _Awaited) -> None:
        for exchange in awaited.proposal.exchanges:
            self._exchanges[player].append(exchange)
            self._stage.answered(player, exchange, awaited.basis)
        if awaited.proposal.say:
            self._chat.say(player, awaited.proposal.say)
            self._stage.say(player, awaited.proposal.say)
        self._seats[player].answer(awaited.proposal)
        self._note(player)

    def _note(self, player: str) -> None:
        """Record when a model thinks; one that only plans takes no time."""
        notes = self._seats[player].notes
        for text in notes if self._view is not None else ():
            self._stage.note(player, TOPIC, text)
        notes.clear()

    def _help(self, player: str) -> Decision | None:
        """What the helper does meanwhile: nobody's answer, so it is based on nothing."""
        helper = self._helpers.get(player)
        action = helper.act(self._stage.state) if helper is not None else None
        return Decision(action.sentence) if action is not None else None

    def _count_awaited(self) -> None:
        """What was still being thought of was paid for, and is counted, also where a model has
        failed."""
        for player, awaited in self._awaited.items():
            for exchange in awaited.proposal.exchanges:
                self._exchanges[player].append(exchange)
                self._stage.answered(player, exchange, awaited.basis)
