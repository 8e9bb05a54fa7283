"""A language model in a seat on a server whose world does not wait: it thinks in a task of its own,
steps go by, and a helper may act meanwhile, which thinks in another task.

The game is joined with both views: the model reads the text, the helper plans on the state.
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
from robotouille_client.game import ActionRequest
from robotouille_client.sansio.game_events import ActResult, Changed, GameEvent
from robotouille_evaluation.agents.asking import Complete, answer_all
from robotouille_evaluation.agents.exchange_rows import exchange_note
from robotouille_evaluation.agents.network import GameChat, give_up, refused_words
from robotouille_evaluation.agents.proposal import (
    MAX_REASONING,
    Exchange,
    Proposal,
    Strategy,
)
from robotouille_evaluation.realtime.charge import Charge, ChargeKind
from robotouille_evaluation.realtime.late import Late, Look
from robotouille_evaluation.realtime.seat import Choice, RealTimeSeat
from robotouille_evaluation.realtime.thoughts import TOPIC as THINKING

__all__ = ["RealTimeAgent", "RealTimeOptions"]


WALL = Charge(ChargeKind.WALL)


@dataclass(frozen=True, slots=True)
class RealTimeOptions:
    """How a model plays in real time.

    Args:
        late: What becomes of late answers.
        digest_tokens: How long the digest may be of what has changed; none if 0.
        helper: Makes who acts while the model thinks; nobody if None.
        charge: What thinking costs where it is declared. By the wall clock the world goes on by
            itself, and nothing is charged.
    """

    late: Late = Late.APPLY
    digest_tokens: int = 0
    helper: MakePolicy | None = None
    charge: Charge = WALL


class RealTimeAgent:
    """Plays a seat with a strategy; `told` hears of each exchange with the model.

    Where thinking is declared and nothing happens meanwhile (no helper, late answers are applied),
    an action is sent with its `think_ms`. Otherwise the seat passes, or its helper acts, in the
    steps that the thought has cost, and the answer counts after them.
    """

    def __init__(
        self,
        game: Game,
        strategy: Strategy,
        complete: Complete,
        options: RealTimeOptions | None = None,
        told: Callable[[Exchange], None] = lambda _: None,
    ) -> None:
        self._game = game
        self._complete = complete
        self._options = options or RealTimeOptions()
        self._told = told
        self._declared = game.clock.get("thinking") == "declared"
        late, tokens = self._options.late, self._options.digest_tokens
        self._seat = RealTimeSeat(game.seat or "", strategy, late, tokens)
        self._calls = CallNotes()
        self._chat = GameChat(game)
        self._thought: asyncio.Task[Proposal] | None = None
        self._news: asyncio.Task[GameEvent] | None = None
        self._basis = 0
        self._due = 0
        self._think_ms = 0
        self._charged = False
        self._acted = self._helped = -1
        helper = self._options.helper
        self._helper = SeatPolicy(game, helper) if helper is not None else None
        self._help: asyncio.Task[GroundAction | None] | None = None

    async def play(self) -> Mapping[str, Any]:
        """Play to the end; the outcome, empty if the connection was lost for good. A thought that
        is not finished then is given up."""
        game = self._game
        try:
            if self._helper is not None:
                self._helper.begin()  # Now: it takes a moment, for which no answer is to wait.
            while not game.ended:
                self._catch_up()
                if not await self._act() and not game.ended:
                    await self._wait()
        finally:
            for task in (self._thought, self._help, self._news):
                await give_up(task)
        return game.outcome or {}

    def _catch_up(self) -> None:
        """Heed what has happened, in its order: the oldest may have been taken by the one that
        waits for it."""
        if self._news is not None and self._news.done():
            self._heed(self._news.result())
            self._news = None
        for event in self._game.poll():
            self._heed(event)

    def _heed(self, event: GameEvent) -> None:
        if isinstance(event, Changed) and event.did:
            self._seat.observe(event.did)
        self._chat.heed(event)
        if self._helper is not None:
            self._helper.heed(event)

    async def _wait(self) -> None:
        """Until something happens in the game, the model has answered, or its helper decided."""
        if self._news is None:
            self._news = asyncio.ensure_future(self._game.next_event())
        awaited: list[asyncio.Future[Any]] = [self._news]
        for task in (self._thought, self._help):
            if task is not None and not task.done():
                awaited.append(task)
        await asyncio.wait(awaited, return_when=asyncio.FIRST_COMPLETED)

    # One step

    async def _act(self) -> bool:
        """Do what there is to do now; whether anything was."""
        now = self._look()
        if now is None or not self._game.my_move or now.step <= self._acted:
            return False
        if self._declared and self._thought is not None and not self._thought.done():
            return False  # The world waits for everybody: what it costs comes afterwards.
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

    def _look(self) -> Look | None:
        """What the model would be shown; None while the text of this step is on its way."""
        seen = self._game.observation
        if seen is None or not self._game.has_state or seen.step != self._game.step:
            return None
        return Look(seen.step, seen.text, seen.actions)

    def _ask(self, now: Look) -> None:
        shown = replace(self._seat.look(now), heard=self._chat.read())
        self._note()
        self._basis = self._due = now.step
        self._think_ms, self._charged = 0, not self._declared
        proposing = answer_all(self._seat.strategy.propose(shown), self._complete)
        self._thought = asyncio.ensure_future(proposing)

    def _charge(self, proposal: Proposal) -> None:
        """What a thought has cost: with the action that it led to, or else in steps that pass."""
        self._charged = True
        ms = self._options.charge.milliseconds(proposal.exchanges)
        simple = self._options.helper is None and self._options.late is Late.APPLY
        if simple and proposal.actions:
            self._think_ms = ms
            return
        steps = ms / 1000 * float(self._game.clock["step_rate"])
        self._due = self._basis + math.ceil(round(steps, 9))

    async def _arrive(self, now: Look) -> bool:
        """Whether the model's answer counts from now on. What its helper has not decided by then
        is given up."""
        if self._thought is None or not self._thought.done():
            return False
        proposal = self._thought.result()
        if not self._charged:
            self._charge(proposal)
        if now.step < self._due:
            return False
        self._thought = None
        await give_up(self._help)
        self._help = None
        for exchange in proposal.exchanges:
            self._told(exchange)
            self._game.note(CALLS, exchange_note(self._calls, exchange))
        self._chat.say(proposal.say)
        # Only now: the server may take for an action what was refused here, and the game may end.
        for exchange in proposal.exchanges:
            if await self._record(exchange):
                proposal = replace(proposal, actions=())
        self._seat.answer(proposal)
        self._note()
        return True

    async def _record(self, exchange: Exchange) -> bool:
        """Let the server refuse what was no action, so that it is in the recording. Whether the
        server has read it better, and it was done."""
        said = refused_words(exchange)
        if said is None or not self._game.my_move:
            return False
        reasoning = exchange.reasoning[:MAX_REASONING]
        result = await self._send(said, self._basis, reasoning)
        if result.applied:
            self._acted = result.step - 1
        return result.applied

    async def _carry_out(self, choice: Choice) -> None:
        step, think_ms = self._game.step, self._think_ms
        self._think_ms = 0
        action = choice.action or None
        result = await self._send(action, choice.basis, choice.reasoning, think_ms)
        if result.applied:
            self._acted = max(step, result.step - 1)
        else:
            reasons = [unmet.words for unmet in result.unmet]
            self._seat.refused(choice.action, reasons)

    async def _pass_time(self, now: Look) -> bool:
        """What the helper does while the model thinks. Where the world waits for everybody, and
        nothing is to be done, that is said."""
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
                    return True  # That was about a step that is over: it decides anew.
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
        self, action: ActionRequest, basis: int | None, reasoning: str = "", think_ms: int = 0
    ) -> ActResult:
        """Without the reasoning where no more of it is recorded."""
        game = self._game
        result = await game.act(action, think_ms=think_ms, basis=basis, reasoning=reasoning or None)
        if reasoning and result.code == ErrorCode.RATE_WORDS:
            result = await game.act(action, think_ms=think_ms, basis=basis)
        return result

    def _note(self) -> None:
        for text in self._seat.notes:
            self._game.note(THINKING, text)
        self._seat.notes.clear()
