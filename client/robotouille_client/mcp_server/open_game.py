"""A place in one episode, with a connection of its own to the game server."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Literal

from robotouille.errors import RobotouilleError
from robotouille.program import quoted
from robotouille_client.client import Client
from robotouille_client.game import Game
from robotouille_client.mcp_server.journal import Journal
from robotouille_client.mcp_server.results import ActionOutcome, Chat, EpisodeOutcome, GameView
from robotouille_client.sansio.game_events import ActResult

__all__ = ["OpenGame", "Until"]

Until = Literal["change", "my_move"]

LEAVE_SECONDS = 2.0
ECHO_SECONDS = 3.0
"""Within which one hears one's own words."""
END_SECONDS = 2.0
"""What the outcome may take after the last step."""


class OpenGame:
    """A seat, or a spectator's place, and what its player was told of the game.

    `handle` names it in tool calls; only `owner` may use it. `mcp_session` is the session of the
    Model Context Protocol in which it was joined, where there is one.
    """

    def __init__(
        self, handle: str, owner: str, client: Client, game: Game, mcp_session: str | None = None
    ) -> None:
        self.handle = handle
        self.owner = owner
        self.mcp_session = mcp_session
        self.game = game
        self.calls = 0
        self.last_used = 0.0
        self._client = client
        self._journal = Journal(game)
        self._shown = ""
        self._asked: tuple[str, asyncio.Future[ActResult]] | None = None

    # What tools do

    async def act(self, action: str, reasoning: str | None, timeout: float) -> GameView:
        """Ask for an action, and wait until its fate is decided, but not for ever.

        Raises:
            ProtocolError: `seat/none`: spectators do not act.
            ValueError: The message cannot have such an argument.
        """
        future = self.game.submit(action, reasoning=reasoning)
        self._asked = (action, future)
        await asyncio.wait({future}, timeout=timeout)
        if self._at_its_end:
            await self._wait_for(lambda: False, END_SECONDS)
        return self.view()

    async def wait(self, until: Until, timeout: float) -> GameView:
        """Wait until something changes, or until it is one's move, but not for ever."""
        self._listen()
        done = self._something_new if until == "change" else lambda: self.your_move
        await self._wait_for(done, timeout)
        return self.view()

    async def say(self, text: str) -> bool:
        """Say something to everybody; whether it was heard.

        Raises:
            ValueError: The text has not 1 to 500 characters.
        """
        before = self._journal.own_words
        self.game.say(text)
        await self._wait_for(lambda: self._journal.own_words > before, ECHO_SECONDS)
        return self._journal.own_words > before

    async def close(self) -> None:
        """Leave the episode, so that the seat is free at once, and close the connection."""
        try:
            with contextlib.suppress(RobotouilleError, TimeoutError):
                async with asyncio.timeout(LEAVE_SECONDS):
                    await self._client.leave()
        finally:
            await self._client.close()

    # What its player sees

    @property
    def your_move(self) -> bool:
        """Whether an action of this seat is waited for."""
        return self.game.my_move and not self._undecided

    @property
    def actions(self) -> list[str]:
        """The sentences of the seat's valid actions; none where it cannot act at all."""
        return [] if self.game.ended else [action.sentence for action in self.game.actions]

    def view(self, *, whole: bool = False) -> GameView:
        """The game now, and what its player was not told before; with `whole` also a kitchen
        that is as it was, or in which the player cannot act yet."""
        self._listen()
        news = self._journal.read()
        game = self.game
        return GameView(
            game=self.handle,
            episode=game.code,
            seat=game.seat or "",
            name=game.name,
            phase=game.phase,
            step=game.step,
            your_move=self.your_move,
            next=self._next(),
            action=self._action(),
            happened=list(news.happened),
            left_out=news.left_out,
            chat=[Chat(name=c.name, seat=c.seat, text=c.text, own=c.own) for c in news.chat],
            observation=self._observation(whole),
            actions=self.actions,
            connected=self._client.connected.is_set(),
            outcome=self._outcome(),
        )

    def _observation(self, whole: bool) -> str | None:
        text = self.game.state.text_view(self.game.seat)
        if not whole and (text == self._shown or self._busy_steps):
            return None
        self._shown = text
        return text

    @property
    def _busy_steps(self) -> int:
        game = self.game
        return 0 if game.seat is None or game.ended else game.state.busy_steps(game.seat)

    def _outcome(self) -> EpisodeOutcome | None:
        row = self.game.outcome
        if row is None:
            return None
        return EpisodeOutcome(
            reason=str(row["reason"]), steps=int(row["steps"]), detail=str(row.get("detail", ""))
        )

    def _action(self) -> ActionOutcome | None:
        """What became of the last action; told once, when it is decided."""
        if self._asked is None:
            return None
        action, future = self._asked
        if not future.done():
            return ActionOutcome(
                action=action, status="pending", step=self.game.step, reasons=[], code=""
            )
        self._asked = None
        result = future.result()
        return ActionOutcome(
            action=action,
            status="applied" if result.applied else "rejected",
            step=result.step,
            reasons=list(result.reasons),
            code=result.code,
        )

    def _next(self) -> str:
        """What its player does best now."""
        game = self.game
        if game.outcome is not None:
            return "The episode is over. Call leave."
        if game.ended:
            why = self._client.farewell or game.farewell
            said = f" ({quoted(why)})" if why else ""
            return f"You are out of the episode{said}. Call leave, then join if you want back."
        if not self._client.connected.is_set():
            return "The game server does not answer; we try to get back into your seat. Call wait."
        if game.phase == "waiting":
            if game.starts_at is not None:
                return "The game begins in a moment. Call wait."
            if away := ", ".join(s.player for s in game.seats if s.name and not s.present):
                return f"The game begins when everybody is there; away: {away}. Call wait."
            free = ", ".join(seat.player for seat in game.seats if not seat.name)
            unready = ", ".join(s.player for s in game.seats if not s.ready)
            if unready and not free:
                return f"The game begins when everybody is ready; not yet: {unready}. Call wait."
            return f"The game begins when all seats are taken; free: {free or 'none'}. Call wait."
        if game.paused:
            why = game.pause.reason if game.pause is not None else "unknown"
            return f"The game stands still ({why}). Call wait."
        if game.seat is None:
            return "You watch. Call wait to see what happens."
        if self._undecided:
            return f"Your action waits for {self._waited_for()}. Call wait, or act to replace it."
        if game.turn not in (None, game.seat):
            return f"It is {game.turn}'s turn. Call wait until my_move."
        if self._busy_steps:
            return (
                f"{game.seat} is busy for {self._busy_steps} more steps. Call wait until my_move."
            )
        return "It is your move: call act with one of the valid actions."

    def _waited_for(self) -> str:
        others = [player for player in self.game.waits_for if player != self.game.seat]
        return ", ".join(others) or "its step"

    # What comes

    @property
    def _undecided(self) -> bool:
        return self._asked is not None and not self._asked[1].done()

    def _something_new(self) -> bool:
        decided = self._asked is not None and self._asked[1].done()
        return self._journal.unread or decided

    def _listen(self) -> None:
        for event in self.game.poll():
            self._journal.take(event)

    @property
    def _at_its_end(self) -> bool:
        """Whether the step was the last: the outcome is on its way."""
        game = self.game
        return game.state.goal_reached or game.step >= game.clock["max_steps"]

    async def _wait_for(self, done: Callable[[], bool], timeout: float) -> None:
        """Take in what comes until something is so, the game is over, or time is up."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                while not (done() or self.game.ended):
                    self._journal.take(await self.game.next_event())
