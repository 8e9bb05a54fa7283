"""A language model in a seat of a game on a server, by the text view: as anybody's bot would.

The world waits for it; where it does not, see `realtime.network`. Should steps go by all the same,
an answer may come late, and is then an action that is not valid any more, which the server says and
records.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from robotouille.protocol.error_codes import ErrorCode
from robotouille.replay.model_calls import TOPIC, CallNotes
from robotouille.world.sentences import MAX_SENTENCE
from robotouille_client import Game
from robotouille_client.sansio.game_events import ActResult, Observed
from robotouille_evaluation.agents.asking import Complete, answer_all
from robotouille_evaluation.agents.exchange_rows import exchange_note
from robotouille_evaluation.agents.proposal import (
    MAX_REASONING,
    Exchange,
    Observation,
    Strategy,
)
from robotouille_evaluation.models import ModelErrorKind

__all__ = ["NetworkAgent", "refused_words"]


UNANSWERED = frozenset(ModelErrorKind) - {ModelErrorKind.EMPTY, ModelErrorKind.TOO_LONG}
"""Why there is no answer of the model at all: faults of what lies between, which nobody counts as
an answer that was wrong."""


def refused_words(exchange: Exchange) -> str | None:
    """What an answer asked for that was refused, for the server to refuse it, too; None where
    nothing was, or nobody has answered."""
    if not exchange.verdict.rejected:
        return None
    said = exchange.action or (exchange.completion.text if exchange.completion else "")
    unanswered = exchange.completion and exchange.completion.finish_reason in UNANSWERED
    return None if unanswered and not said.strip() else said.strip()[:MAX_SENTENCE]


class NetworkAgent:
    """Plays a seat with a strategy; `told` hears of each exchange with the model.

    What the model was sent and has said goes into the recording as notes. Answers that are no
    action are sent as actions, too: the server refuses them, and they are recorded with their
    reasons.
    """

    def __init__(
        self,
        game: Game,
        strategy: Strategy,
        complete: Complete,
        told: Callable[[Exchange], None] = lambda _: None,
    ) -> None:
        self._game = game
        self._strategy = strategy
        self._complete = complete
        self._told = told
        self._notes = CallNotes()
        self._decided = -1
        self._basis = 0
        self._plan: list[str] = []
        self._reasoning = ""
        self._done = False

    async def play(self) -> Mapping[str, Any]:
        """Play to the end; the outcome, empty if the connection was lost for good."""
        game = self._game
        while not game.ended:
            game.poll()
            seen = game.observation
            fresh = seen is not None and seen.step == game.step
            if seen is not None and fresh and game.my_move and game.step > self._decided:
                await self._move(seen)
            elif not game.ended:
                await game.next_event()
        return game.outcome or {}

    async def _move(self, seen: Observed) -> None:
        step = self._game.step
        if not seen.actions:  # It is still walking or working.
            self._decided = step
            return
        if not self._plan and not self._done:
            await self._decide(seen)
            if self._game.ended or not self._game.my_move:
                return
        action = self._plan.pop(0) if self._plan else None
        result = await self._act(action or None, self._reasoning)
        self._reasoning = ""
        if result.applied:
            self._decided = step
        else:
            self._plan.clear()

    async def _decide(self, seen: Observed) -> None:
        self._basis = seen.step
        observation = Observation(seen.text, seen.actions, self._game.seat or "")
        proposal = await answer_all(self._strategy.propose(observation), self._complete)
        self._plan = list(proposal.actions)
        for exchange in proposal.exchanges:
            self._told(exchange)
            self._game.note(TOPIC, exchange_note(self._notes, exchange))
        # Only now: the server may take for an action what was refused here, and the game may end.
        for exchange in proposal.exchanges:
            await self._record(exchange)
        self._reasoning = proposal.reasoning[:MAX_REASONING]
        self._done = proposal.done

    async def _record(self, exchange: Exchange) -> None:
        """Let the server refuse what was no action, so that it is in the recording."""
        said = refused_words(exchange)
        if said is not None and self._game.my_move:
            result = await self._act(said, exchange.reasoning[:MAX_REASONING])
            if result.applied:  # The server has read it better; what was thought of next is stale.
                self._plan.clear()

    async def _act(self, action: str | None, reasoning: str) -> ActResult:
        """Without the reasoning where no more of it is recorded."""
        basis = self._basis
        result = await self._game.act(action, basis=basis, reasoning=reasoning or None)
        if reasoning and result.code == ErrorCode.RATE_WORDS:
            result = await self._game.act(action, basis=basis)
        return result
