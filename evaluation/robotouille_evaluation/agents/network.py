"""A language model in one seat or several of a game on a server, by the text view: as anybody's bot
would.

The world waits for it; where it does not, see `realtime.network`. Should steps go by all the same,
an answer may come late, and is then an action that is not valid any more, which the server says and
records.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from robotouille.protocol.error_codes import ErrorCode
from robotouille.replay.model_calls import TOPIC, CallNotes
from robotouille.world.sentences import MAX_SENTENCE
from robotouille_client import Game
from robotouille_client.sansio.game_events import ActResult, GameEvent, Heard, Observed
from robotouille_evaluation.agents.exchange_rows import exchange_note
from robotouille_evaluation.agents.proposal import (
    MAX_REASONING,
    Exchange,
    Observation,
    Proposal,
)
from robotouille_evaluation.agents.teams.chat import Chat
from robotouille_evaluation.agents.teams.team import Team
from robotouille_evaluation.models import ModelErrorKind

__all__ = ["GameChat", "NetworkAgent", "give_up", "refused_words"]


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


async def give_up(task: asyncio.Task[Any] | None) -> None:
    """Cancel what nobody waits for any more; what it has failed at is nobody's fault now."""
    if task is not None and not task.done():
        task.cancel()
        with suppress(asyncio.CancelledError, Exception):
            await task


class GameChat:
    """The chat of a game: what others have said since the model looked, and its own words."""

    def __init__(self, game: Game) -> None:
        self._game = game
        self._chat = Chat()

    def heed(self, event: GameEvent) -> None:
        """Something has happened: if somebody else has said something, keep it."""
        if isinstance(event, Heard) and event.seat not in self._game.own_seats:
            kinds = {seat.player: seat.kind for seat in self._game.seats}
            self._chat.hear(event.seat, event.name, kinds.get(event.seat, ""), event.text)

    def read(self) -> tuple[str, ...]:
        """A line for each, once."""
        return self._chat.read()

    def say(self, text: str) -> None:
        """Say something to everybody, if it is anything."""
        if text and not self._game.ended:
            self._game.say(text)


@dataclass(slots=True)
class _Seat:
    """What a seat is to do, by the last answer for it."""

    notes: CallNotes = field(default_factory=CallNotes)
    plan: list[str] = field(default_factory=list)
    refused: list[Exchange] = field(default_factory=list)
    reasoning: str = ""
    basis: int = 0
    done: bool = False
    decided: int = -1
    acting: asyncio.Task[None] | None = None


class NetworkAgent:
    """Plays the seats of a game as a team; `told` hears of each exchange with a model.

    What a model was sent and has said goes into the recording as notes. Answers that are no action
    are sent as actions, too: the server refuses them, and they are recorded with their reasons.
    """

    def __init__(
        self,
        game: Game,
        team: Team,
        told: Callable[[Exchange], None] = lambda _: None,
    ) -> None:
        self._game = game
        self._team = team
        self._told = told
        self._chat = GameChat(game)
        self._seats = {seat: _Seat() for seat in game.own_seats}
        self._news: asyncio.Task[GameEvent] | None = None

    async def play(self) -> Mapping[str, Any]:
        """Play to the end; the outcome, empty if the connection was lost for good. What a model is
        still asked then is given up."""
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
            for task in (self._news, *(seat.acting for seat in self._seats.values())):
                await give_up(task)
        return game.outcome or {}

    def _free(self) -> dict[str, Observed]:
        """The seats that are to decide now, and what they see; none before all of it has come."""
        game, free = self._game, {}
        if game.has_state and (game.state.goal_reached or game.step >= game.clock["max_steps"]):
            return {}  # It is over; that it is said is on its way.
        for player, seat in self._seats.items():
            seen = game.observations.get(player)
            if seen is None or seen.step != game.step:
                return {}
            waits = seat.acting is None and game.step > seat.decided and game.may_act(player)
            if waits and not seen.actions:  # It is still walking or working.
                seat.decided = game.step
            elif waits:
                free[player] = seen
        return free

    async def _move(self, free: Mapping[str, Observed]) -> None:
        asked = {
            player: seen
            for player, seen in free.items()
            if not (self._seats[player].plan or self._seats[player].done)
        }
        if asked:
            await self._ask(asked)
        if self._game.ended:
            return
        for player in free:
            seat = self._seats[player]
            seat.acting = asyncio.ensure_future(self._act(player, seat))
        await self._wait()

    async def _ask(self, asked: Mapping[str, Observed]) -> None:
        heard = self._chat.read()
        shown = {}
        for player, seen in asked.items():
            self._seats[player].basis = seen.step
            shown[player] = Observation(seen.text, seen.actions, player, heard=heard)
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
            self._told(exchange)
            self._game.note(TOPIC, exchange_note(seat.notes, exchange), seat=player)
            self._seats.get(exchange.player, seat).refused.append(exchange)
        self._chat.say(proposal.say)
        seat.plan = list(proposal.actions)
        seat.reasoning = proposal.reasoning[:MAX_REASONING]
        seat.done = proposal.done

    async def _wait(self, *asking: asyncio.Future[None]) -> None:
        """Until something happens in the game, the team is asked no more, or it is known what
        became of an action."""
        if self._news is None:
            self._news = asyncio.ensure_future(self._game.next_event())
        acting = [seat.acting for seat in self._seats.values() if seat.acting is not None]
        awaited: list[asyncio.Future[Any]] = [self._news, *acting, *asking]
        await asyncio.wait(awaited, return_when=asyncio.FIRST_COMPLETED)
        for seat in self._seats.values():
            if seat.acting is not None and seat.acting.done():
                seat.acting.result()
                seat.acting = None
        if self._news.done():
            self._chat.heed(self._news.result())
            self._news = None

    # One seat

    async def _act(self, player: str, seat: _Seat) -> None:
        """Do what comes next, after what was refused: the server may take that for an action, and
        the game may end with it."""
        game, step = self._game, self._game.step
        refused, seat.refused = seat.refused, []
        for exchange in refused:
            if await self._record(player, seat, exchange):
                seat.plan.clear()  # The server has read it better; what was thought of is stale.
        if game.ended or not game.may_act(player):
            return
        action = seat.plan.pop(0) if seat.plan else ""
        result = await self._send(player, seat.basis, action or None, seat.reasoning)
        seat.reasoning = ""
        if result.applied:
            seat.decided = step
        elif action:
            seat.plan.clear()
            self._team.refused(player, action, result.reasons)

    async def _record(self, player: str, seat: _Seat, exchange: Exchange) -> bool:
        """Let the server refuse what was no action, so that it is in the recording; whether it has
        taken it for one."""
        said = refused_words(exchange)
        if said is None or not self._game.may_act(player):
            return False
        reasoning = exchange.reasoning[:MAX_REASONING]
        return (await self._send(player, seat.basis, said, reasoning)).applied

    async def _send(self, player: str, basis: int, action: str | None, reasoning: str) -> ActResult:
        """Without the reasoning where no more of it is recorded."""
        game = self._game
        result = await game.act(action, seat=player, basis=basis, reasoning=reasoning or None)
        if reasoning and result.code == ErrorCode.RATE_WORDS:
            result = await game.act(action, seat=player, basis=basis)
        return result
