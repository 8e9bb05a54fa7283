"""Language model in a seat on a server whose world does not wait.

The model thinks in one asyncio task. Meanwhile steps pass, and a helper in another task may act.
The game is joined with both views: the model reads the text, and the helper plans on the state.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from robotouille.protocol.error_codes import ErrorCode
from robotouille.replay.model_calls import TOPIC as CALLS
from robotouille.replay.model_calls import CallNotes
from robotouille.world.grounding.actions import GroundAction
from robotouille_client import Game
from robotouille_client.bots.seat_policy import MakePolicy, SeatPolicy
from robotouille_client.game import ActDetails, RequestedAction
from robotouille_client.sansio.game_events import ActResult, GameEvent, StateChanged
from robotouille_evaluation.agents.network import GameChat, give_up, rejected_text
from robotouille_evaluation.agents.proposal import (
    MAX_REASONING,
    Complete,
    Exchange,
    Proposal,
    Strategy,
    answer_all,
    exchange_note,
)
from robotouille_evaluation.realtime.observation import Charge, ChargeKind, LatePolicy, ObservedStep
from robotouille_evaluation.realtime.seat import RealTimeSeat, SeatDecision
from robotouille_evaluation.realtime.thoughts import TOPIC as THINKING

WALL = Charge(ChargeKind.WALL)


@dataclass(frozen=True, slots=True)
class RealTimeOptions:
    """Options of a model in real time.

    Args:
        late: Rule for late answers.
        digest_tokens: Longest digest of changes; no digest if 0.
        max_age: Most steps between an observation and the answer to it; unlimited if None.
        helper: Returns the policy that acts while the model thinks; None for no helper.
        charge: Cost of thinking if the episode's rules let players declare it. With the wall
            clock, time passes by itself and nothing is charged.
    """

    late: LatePolicy = LatePolicy.APPLY
    digest_tokens: int = 0
    helper: MakePolicy | None = None
    charge: Charge = WALL
    max_age: int | None = None


class RealTimeAgent:
    """Plays a seat with a strategy.

    If thinking is declared, and there is no helper and no rule for late answers, an action is sent
    with its `think_ms`. Otherwise the seat passes, or its helper acts, during the steps that the
    thought costs. The answer takes effect after them.

    Args:
        exchanged: Observer of each exchange with the model.
    """

    def __init__(
        self,
        game: Game,
        strategy: Strategy,
        complete: Complete,
        options: RealTimeOptions | None = None,
        exchanged: Callable[[Exchange], None] = lambda _: None,
    ) -> None:
        self._game = game
        self._complete = complete
        self._options = options or RealTimeOptions()
        self._exchanged = exchanged
        self._declared = game.clock.get("thinking") == "declared"
        options = self._options
        self._seat = RealTimeSeat(
            game.seat or "", strategy, options.late, options.digest_tokens, options.max_age
        )
        self._calls = CallNotes()
        self._chat = GameChat(game)
        self._thought: asyncio.Task[Proposal] | None = None
        self._event: asyncio.Task[GameEvent] | None = None
        self._basis = 0
        self._due = 0
        self._think_ms = 0
        self._charged = False
        self._acted = self._helped = -1
        helper = self._options.helper
        self._helper = SeatPolicy(game, helper) if helper is not None else None
        self._help: asyncio.Task[GroundAction | None] | None = None

    async def play(self) -> Mapping[str, Any]:
        """Play to the end and return the outcome, or {} if the connection was lost for good.

        A thought that is not finished then is cancelled.
        """
        game = self._game
        try:
            if self._helper is not None:
                self._helper.begin()  # Starting takes a moment that no answer should wait for.
            while not game.ended:
                self._catch_up()
                if not await self._act() and not game.ended:
                    await self._wait()
        finally:
            for task in (self._thought, self._help, self._event):
                await give_up(task)
        return game.outcome or {}

    def _catch_up(self) -> None:
        # The oldest event may have gone to the task that waits for events.
        if self._event is not None and self._event.done():
            self._heed(self._event.result())
            self._event = None
        for event in self._game.poll():
            self._heed(event)

    def _heed(self, event: GameEvent) -> None:
        if isinstance(event, StateChanged) and event.did:
            self._seat.observe(event.did)
        self._chat.heed(event)
        if self._helper is not None:
            self._helper.heed(event)

    async def _wait(self) -> None:
        """Wait for an event of the game, the model's answer, or the helper's decision."""
        if self._event is None:
            self._event = asyncio.ensure_future(self._game.next_event())
        awaited: list[asyncio.Future[Any]] = [self._event]
        for task in (self._thought, self._help):
            if task is not None and not task.done():
                awaited.append(task)
        await asyncio.wait(awaited, return_when=asyncio.FIRST_COMPLETED)

    async def _act(self) -> bool:
        """Do the next thing, if any, and return whether there was one."""
        now = self._observed()
        if now is None or not self._game.my_move or now.step <= self._acted:
            return False
        if self._declared and self._thought is not None and not self._thought.done():
            return False  # The world waits for all players; the thought is charged afterwards.
        if await self._arrive(now):
            return True
        choice = self._seat.choose(now)
        if choice is not None:
            await self._carry_out(choice)
        self._note()
        if choice is not None:
            return True
        if self._seat.wants_to_look(now.step):
            self._ask(now)
            return True
        return await self._pass_time(now)

    def _observed(self) -> ObservedStep | None:
        """Return the current observation, or None if its text has not arrived."""
        seen = self._game.observation
        if seen is None or not self._game.has_state or seen.step != self._game.step:
            return None
        return ObservedStep(seen.step, seen.text, seen.actions)

    def _ask(self, now: ObservedStep) -> None:
        shown = replace(self._seat.look(now), heard=self._chat.read())
        self._note()
        self._basis = self._due = now.step
        # The wall clock needs no charge: its time has passed when the answer comes.
        self._think_ms, self._charged = 0, not self._declared
        proposing = answer_all(self._seat.strategy.propose(shown), self._complete)
        self._thought = asyncio.ensure_future(proposing)

    def _charge(self, proposal: Proposal) -> None:
        """Charge a thought, with its action or in steps that pass."""
        self._charged = True
        ms = self._options.charge.milliseconds(proposal.exchanges)
        simple = self._options.helper is None and self._options.late is LatePolicy.APPLY
        if simple and proposal.actions:
            self._think_ms = ms
            return
        # Rounding removes floating-point noise, which could cost an extra step.
        steps = ms / 1000 * float(self._game.clock["step_rate"])
        self._due = self._basis + math.ceil(round(steps, 9))

    async def _arrive(self, now: ObservedStep) -> bool:
        """Let the model's answer take effect if it is due, and return whether it did."""
        if self._thought is None or not self._thought.done():
            return False
        proposal = self._thought.result()
        if not self._charged:
            self._charge(proposal)
        if now.step < self._due:
            return False
        self._thought = None
        # The model's answer takes precedence over the helper's decision.
        await give_up(self._help)
        self._help = None
        for exchange in proposal.exchanges:
            self._exchanged(exchange)
            self._game.note(CALLS, exchange_note(self._calls, exchange))
        self._chat.say(proposal.say)
        # Last, because the server may accept a rejected answer, and the game may end with it.
        for exchange in proposal.exchanges:
            if await self._record(exchange):
                proposal = replace(proposal, actions=())
        self._seat.answer(proposal)
        self._note()
        return True

    async def _record(self, exchange: Exchange) -> bool:
        """Send a rejected answer, so that it is recorded, and return whether it was applied."""
        said = rejected_text(exchange)
        if said is None or not self._game.my_move:
            return False
        reasoning = exchange.reasoning[:MAX_REASONING]
        result = await self._send(said, self._basis, reasoning)
        if result.applied:
            self._acted = result.step - 1
        return result.applied

    async def _carry_out(self, choice: SeatDecision) -> None:
        step, think_ms = self._game.step, self._think_ms
        self._think_ms = 0
        action = choice.action or None
        limit: ActDetails = {} if choice.max_age is None else {"max_age": choice.max_age}
        result = await self._send(action, choice.basis, choice.reasoning, think_ms, limit)
        if result.applied:
            self._acted = max(step, result.step - 1)
        else:
            reasons = [unmet.words for unmet in result.unmet]
            self._seat.rejected(choice.action, reasons)

    async def _pass_time(self, now: ObservedStep) -> bool:
        """Let the helper act while the model thinks, and return whether anything was done.

        A world that waits for all players needs a message even if the seat does nothing.
        """
        action = None
        if self._helper is not None and self._seat.thinking:
            if self._help is None and self._helped < now.step:
                self._helped = now.step
                self._help = asyncio.create_task(self._helper.decide())
            if self._help is not None:
                if not self._help.done():
                    return False
                action, self._help = self._still_valid(self._help.result()), None
                if action is None and self._helped < now.step:
                    return True  # The decision was about an earlier step, so ask again.
        if action is None and not self._declared:
            return False
        result = await self._send(action, None)
        if result.applied:
            self._acted = result.step - 1
        return True

    def _still_valid(self, action: GroundAction | None) -> GroundAction | None:
        valid = action is not None and self._game.world.applicable(self._game.state, action)
        return action if valid else None

    async def _send(
        self,
        action: RequestedAction,
        basis: int | None,
        reasoning: str = "",
        think_ms: int = 0,
        limit: ActDetails | None = None,
    ) -> ActResult:
        """Send an action, without the reasoning if the server's quota for it is used up."""
        details: ActDetails = {"think_ms": think_ms, "basis": basis, **(limit or {})}
        said: ActDetails = {**details, "reasoning": reasoning or None}
        result = await self._game.act(action, **said)
        if reasoning and result.code == ErrorCode.RATE_WORDS:
            result = await self._game.act(action, **details)
        return result

    def _note(self) -> None:
        for text in self._seat.notes:
            self._game.note(THINKING, text)
        self._seat.notes.clear()
