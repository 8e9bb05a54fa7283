"""Language models in one or several seats of a game on a server, through the text view.

The world waits for them; for one that does not, see `realtime.network`. If steps pass nevertheless,
a late answer may be invalid. The server then rejects and records it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from robotouille.protocol.error_codes import ErrorCode
from robotouille.replay.model_calls import TOPIC, CallNotes
from robotouille.world.text import MAX_SENTENCE
from robotouille_client import Game
from robotouille_client.sansio.game_events import (
    ActResult,
    ChatReceived,
    GameEvent,
    ObservationReceived,
)
from robotouille_evaluation.agents.proposal import (
    MAX_REASONING,
    AgentObservation,
    Exchange,
    Proposal,
    exchange_note,
)
from robotouille_evaluation.agents.team import Team, UnreadChat
from robotouille_evaluation.models import ModelErrorKind

UNANSWERED = frozenset(ModelErrorKind) - {ModelErrorKind.EMPTY}
"""Errors of the connection or endpoint, which are not wrong answers of the model."""
MAX_TRIES = 5
"""Number of rejected actions in one step after which the seat does nothing without its model.

Otherwise, a server that rejects every action could spend any amount on a model.
"""


def rejected_text(exchange: Exchange) -> str | None:
    """Return the text of a rejected answer, to send to the server so that it is recorded.

    Returns:
        None if the answer was not rejected, or there was no answer.
    """
    if not exchange.verdict.rejected:
        return None
    said = exchange.action or (exchange.completion.text if exchange.completion else "")
    unanswered = exchange.completion and exchange.completion.finish_reason in UNANSWERED
    return None if unanswered and not said.strip() else said.strip()[:MAX_SENTENCE]


async def give_up(task: asyncio.Task[Any] | None) -> None:
    """Cancel a task whose result is no longer needed, and ignore its errors."""
    if task is not None and not task.done():
        task.cancel()
        with suppress(asyncio.CancelledError, Exception):
            await task


class GameChat:
    """Chat of a game: others' messages since the model was asked, and the model's own."""

    def __init__(self, game: Game) -> None:
        self._game = game
        self._chat = UnreadChat()

    def heed(self, event: GameEvent) -> None:
        """Keep the chat message of an event, if it is one of another participant."""
        if isinstance(event, ChatReceived) and event.seat not in self._game.own_seats:
            kinds = {seat.player: seat.kind for seat in self._game.seats}
            self._chat.hear(event.seat, event.name, kinds.get(event.seat, ""), event.text)

    def read(self) -> tuple[str, ...]:
        """Return a line for each message and clear them."""
        return self._chat.read()

    def say(self, text: str) -> None:
        """Send a chat message, unless it is empty."""
        if text and not self._game.ended:
            self._game.say(text)


@dataclass(slots=True)
class _Seat:
    """Plan of a seat from its last answer."""

    notes: CallNotes = field(default_factory=CallNotes)
    plan: list[str] = field(default_factory=list)
    rejected: list[Exchange] = field(default_factory=list)
    reasoning: str = ""
    basis: int = 0
    done: bool = False
    decided: int = -1
    tried: int = -1
    tries: int = 0
    acting: asyncio.Task[None] | None = None

    def reject(self, step: int) -> None:
        """Count a rejected action, and drop the rest of the plan."""
        self.plan.clear()
        self.tries = self.tries + 1 if self.tried == step else 1
        self.tried = step

    def needs_model(self, step: int) -> bool:
        """Return whether to ask the model for the next action."""
        given_up = self.tried == step and self.tries >= MAX_TRIES
        return not (self.plan or self.done or given_up)


class NetworkAgent:
    """Plays the seats of a game as a team.

    Exchanges with models are recorded as notes. Rejected answers are also sent as actions, so that
    the server rejects them and records the reasons.

    Args:
        exchanged: Observer of each exchange with a model.
    """

    def __init__(
        self,
        game: Game,
        team: Team,
        exchanged: Callable[[Exchange], None] = lambda _: None,
    ) -> None:
        self._game = game
        self._team = team
        self._exchanged = exchanged
        self._chat = GameChat(game)
        self._seats = {seat: _Seat() for seat in game.own_seats}
        self._event: asyncio.Task[GameEvent] | None = None

    async def play(self) -> Mapping[str, Any]:
        """Play to the end and return the outcome, or {} if the connection was lost for good.

        Pending requests to models are cancelled then.
        """
        game = self._game
        try:
            while not game.ended:
                for event in game.poll():
                    self._chat.heed(event)
                free = self._free()
                if free:
                    await self._move(free)
                elif not game.ended:
                    await self._wait()
        finally:
            # A pending model call can take minutes, and its answer has no use.
            for task in (self._event, *(seat.acting for seat in self._seats.values())):
                await give_up(task)
        return game.outcome or {}

    def _free(self) -> dict[str, ObservationReceived]:
        """Return the observations of the seats that must decide now.

        It is empty until the observations of all seats have arrived.
        """
        game, free = self._game, {}
        if game.has_state and (game.goal_reached or game.step >= game.clock["max_steps"]):
            return {}  # The episode is over, and the message that says so is on its way.
        for player, seat in self._seats.items():
            seen = game.observations.get(player)
            if seen is None or seen.step != game.step:
                return {}
            waits = seat.acting is None and game.step > seat.decided and game.may_act(player)
            if waits and not seen.actions:  # The player is still walking or working.
                seat.decided = game.step
            elif waits:
                free[player] = seen
        return free

    async def _move(self, free: Mapping[str, ObservationReceived]) -> None:
        asked = {
            player: seen
            for player, seen in free.items()
            if self._seats[player].needs_model(self._game.step)
        }
        if asked:
            await self._ask(asked)
        if self._game.ended:
            return
        for player in free:
            seat = self._seats[player]
            seat.acting = asyncio.ensure_future(self._act(player, seat))
        await self._wait()

    async def _ask(self, asked: Mapping[str, ObservationReceived]) -> None:
        heard = self._chat.read()
        shown = {}
        for player, seen in asked.items():
            self._seats[player].basis = seen.step
            shown[player] = AgentObservation(seen.text, seen.actions, player, heard=heard)
            # One model plays all seats, so it reads each chat message once.
            heard = ()
        asking = asyncio.ensure_future(self._team.propose(shown, self._take))
        try:
            while not (asking.done() or self._game.ended):
                await self._wait(asking)
            if asking.done():
                asking.result()
        finally:
            await give_up(asking)

    def _take(self, player: str, proposal: Proposal) -> None:
        seat = self._seats[player]
        for exchange in proposal.exchanges:
            self._exchanged(exchange)
            self._game.note(TOPIC, exchange_note(seat.notes, exchange), seat=player)
            self._seats.get(exchange.player, seat).rejected.append(exchange)
        self._chat.say(proposal.say)
        seat.plan = list(proposal.actions)
        seat.reasoning = proposal.reasoning[:MAX_REASONING]
        seat.done = proposal.done

    async def _wait(self, *asking: asyncio.Future[None]) -> None:
        """Wait for an event of the game, the team's answers, or the result of an action."""
        if self._event is None:
            # The task is kept across calls, because cancelling it could lose an event.
            self._event = asyncio.ensure_future(self._game.next_event())
        acting = [seat.acting for seat in self._seats.values() if seat.acting is not None]
        awaited: list[asyncio.Future[Any]] = [self._event, *acting, *asking]
        await asyncio.wait(awaited, return_when=asyncio.FIRST_COMPLETED)
        for seat in self._seats.values():
            if seat.acting is not None and seat.acting.done():
                seat.acting.result()
                seat.acting = None
        if self._event.done():
            self._chat.heed(self._event.result())
            self._event = None

    async def _act(self, player: str, seat: _Seat) -> None:
        """Send the rejected answers and then the next action.

        The server may accept an answer that was rejected here, and the game may end with it.
        """
        game, step = self._game, self._game.step
        rejected, seat.rejected = seat.rejected, []
        for exchange in rejected:
            if await self._record(player, seat, exchange):
                seat.plan.clear()  # The server accepted it, so the plan is out of date.
        if game.ended or not game.may_act(player):
            return
        action = seat.plan.pop(0) if seat.plan else ""
        result = await self._send(player, seat.basis, action or None, seat.reasoning)
        seat.reasoning = ""
        if result.applied:
            seat.decided = step
        elif action:
            seat.reject(step)
            self._team.rejected(player, action, result.reasons)

    async def _record(self, player: str, seat: _Seat, exchange: Exchange) -> bool:
        """Send a rejected answer, so that it is recorded, and return whether it was applied."""
        said = rejected_text(exchange)
        if said is None or not self._game.may_act(player):
            return False
        reasoning = exchange.reasoning[:MAX_REASONING]
        return (await self._send(player, seat.basis, said, reasoning)).applied

    async def _send(self, player: str, basis: int, action: str | None, reasoning: str) -> ActResult:
        """Send an action, without the reasoning if the server's quota for it is used up."""
        game = self._game
        result = await game.act(action, seat=player, basis=basis, reasoning=reasoning or None)
        if reasoning and result.code == ErrorCode.RATE_WORDS:
            result = await game.act(action, seat=player, basis=basis)
        return result
