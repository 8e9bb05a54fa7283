"""An open game of an MCP client, and the log of what its player has not read yet."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Literal

from robotouille.errors import RobotouilleError
from robotouille.protocol import messages
from robotouille.terminal import quoted
from robotouille_client.client import Client
from robotouille_client.game import ActDetails, Game
from robotouille_client.mcp_server.limits import MAX_CALLS_OF_GAME
from robotouille_client.mcp_server.results import (
    MAX_LINE,
    ActionOutcome,
    ChatMessage,
    EpisodeOutcome,
    GameView,
    ValidActions,
    shortened,
)
from robotouille_client.mcp_server.turns import waiting
from robotouille_client.sansio.game_events import (
    ActResult,
    Announced,
    ChatReceived,
    ChatRejected,
    GameEnded,
    GameEvent,
    RosterChanged,
    StateChanged,
)

MAX_LINES = 40
MAX_CHAT = 40
"""Maximum numbers of unread lines and chat messages, because a model's context is limited."""
MAX_REASONS = 16


@dataclass(frozen=True, slots=True)
class HeardChat:
    """A chat message. `seat` is empty for a spectator; `own` marks the player's own messages."""

    name: str
    seat: str
    text: str
    own: bool = False


@dataclass(frozen=True, slots=True)
class NewEvents:
    """Unread lines and chat messages, and the number that was dropped."""

    happened: tuple[str, ...] = ()
    chat: tuple[HeardChat, ...] = ()
    left_out: int = 0


class GameLog:
    """Unread events of a game, as lines.

    Attributes:
        unread: True if there is news for a player who waits for a change: actions or messages of
            others, or changes in the kitchen.
        own_messages: Number of the player's chat messages that the server has delivered.
    """

    def __init__(self, game: Game) -> None:
        self.unread = False
        self.own_messages = 0
        self._game = game
        self._phase = game.phase
        self._seats = game.seats
        self._step = game.step
        self._lines: deque[str] = deque(maxlen=MAX_LINES)
        self._chat: deque[HeardChat] = deque(maxlen=MAX_CHAT)
        self._taken = 0

    def take(self, event: GameEvent) -> None:
        """Add an event."""
        match event:
            case StateChanged():
                self._changed(event)
            case ChatReceived():
                self._heard(event)
            case RosterChanged():
                for line in (*self._phase_lines(event), *self._seat_lines(event.seats)):
                    self._write(line)
            case Announced():
                self._write(f"The server's operator announces {quoted(event.text)}")
            case ChatRejected():
                self._write(f"Your chat message was rejected: {quoted(event.reason)}")
            case GameEnded():
                why = f" ({quoted(event.reason)})" if event.reason else ""
                self._write(f"The episode has ended for you{why}.")
            case _:
                pass

    def read(self) -> NewEvents:
        """Return the unread events and mark them as read."""
        lines, chat = tuple(self._lines), tuple(self._chat)
        news = NewEvents(lines, chat, self._taken - len(lines) - len(chat))
        self._lines.clear()
        self._chat.clear()
        self._taken, self.unread = 0, False
        return news

    def _write(self, line: str) -> None:
        self.unread = True
        self._taken += 1
        self._lines.append(shortened(line, MAX_LINE))

    def _changed(self, event: StateChanged) -> None:
        step, self._step = self._step, event.step
        if event.previous is None:
            if event.step > step + 1:
                self._write(
                    f"Steps {step + 1} to {event.step} passed while the connection was lost."
                )
            return
        if event.state.facts != event.previous.facts:
            self.unread = True
        for player, action, applied in event.did:
            if player != self._game.seat:
                failed = "" if applied else " (rejected)"
                self._write(f"Step {event.step}: {player}: {action.sentence}{failed}")

    def _heard(self, event: ChatReceived) -> None:
        own = event.name == self._game.name and event.seat == (self._game.seat or "")
        self._taken += 1
        self._chat.append(HeardChat(event.name, event.seat, shortened(event.text), own))
        if own:
            self.own_messages += 1
        else:
            self.unread = True

    def _phase_lines(self, event: RosterChanged) -> Iterator[str]:
        before, self._phase = self._phase, event.phase
        if before == event.phase:
            return
        if event.phase == "running":
            yield "The game has begun." if before == "waiting" else "The game continues."
        elif event.phase == "paused":
            why = f" ({event.pause.reason})" if event.pause is not None else ""
            yield f"The game is paused{why}."

    def _seat_lines(self, seats: tuple[messages.SeatInfo, ...]) -> Iterator[str]:
        known = {seat.player: seat for seat in self._seats}
        self._seats = seats
        for seat in seats:
            before = known.get(seat.player)
            if before is None or seat.player == self._game.seat:
                continue
            if (before.name, before.controller) != (seat.name, seat.controller):
                yield _who_plays(seat)


def _who_plays(seat: messages.SeatInfo) -> str:
    if not seat.name:
        return f"{seat.player} is free."
    match seat.controller:
        case "absent":
            return f"{seat.player} is idle: {quoted(seat.name)} is away."
        case "substitute":
            return f"A substitute plays {seat.player}: {quoted(seat.name)} is away."
        case _:
            return f"{seat.player} is played by {quoted(seat.name)} ({seat.kind})."


Until = Literal["change", "my_move"]

LEAVE_SECONDS = 2.0
ECHO_SECONDS = 3.0
"""Maximum time for the server to deliver the player's chat message."""
END_SECONDS = 2.0
"""Maximum time between the last step and the outcome."""


class OpenGame:
    """A game that an MCP client has joined, as player or spectator.

    Attributes:
        handle: Name of the game in tool calls.
        owner: The only caller who may use the handle.
        mcp_session: The MCP session in which the game was joined, if there is one.
        last_used: Time of the end of the last call.
    """

    def __init__(
        self, handle: str, owner: str, client: Client, game: Game, mcp_session: str | None = None
    ) -> None:
        self.handle = handle
        self.owner = owner
        self.mcp_session = mcp_session
        self.game = game
        self.last_used = 0.0
        self._calls: dict[asyncio.Timeout, None] = {}
        self._lost_at = 0.0
        self._client = client
        self._log = GameLog(game)
        self._shown = ""
        self._seen_step = 0
        self._asked: tuple[str, asyncio.Future[ActResult]] | None = None

    # Calls

    @property
    def calls(self) -> int:
        """The number of calls in progress."""
        return len(self._calls)

    @asynccontextmanager
    async def call(self) -> AsyncIterator[None]:
        """Count a call, above the limit in place of the oldest one.

        The calls of a client that closes its connection go on, so they must not use up the limit.

        Raises:
            RobotouilleError: Newer calls have replaced this one.
        """
        now = asyncio.get_running_loop().time
        if len(self._calls) >= MAX_CALLS_OF_GAME:
            oldest = next(iter(self._calls))
            del self._calls[oldest]
            oldest.reschedule(now())
        call = asyncio.timeout(None)
        try:
            async with call:
                self._calls[call] = None
                yield
        except TimeoutError:
            if not call.expired():
                raise
            raise RobotouilleError(
                "newer calls have replaced this one: make at most "
                f"{MAX_CALLS_OF_GAME} calls of a game at the same time"
            ) from None
        finally:
            self._calls.pop(call, None)
            self.last_used = now()

    async def act(
        self, action: str, reasoning: str | None, timeout: float, max_age: int | None = None
    ) -> GameView:
        """Send an action, and wait for its result, but at most `timeout` seconds.

        The action is based on the last view that the caller received.

        Raises:
            ProtocolError: `seat/none`: spectators cannot act.
            ValueError: The message does not allow one of the arguments.
        """
        details: ActDetails = {"basis": self._seen_step, "reasoning": reasoning}
        if max_age is not None:  # Servers without this rule reject the field.
            details["max_age"] = max_age
        future = self.game.submit(action, **details)
        self._asked = (action, future)
        async with waiting():
            await asyncio.wait({future}, timeout=timeout)
        if self._at_its_end:
            await self._wait_for(lambda: False, END_SECONDS)
        return self.view()

    async def wait(self, until: Until, timeout: float) -> GameView:
        """Wait for a change or for the player's move, but at most `timeout` seconds."""
        self._listen()
        done = self._something_new if until == "change" else lambda: self.your_move
        await self._wait_for(done, timeout)
        return self.view()

    async def say(self, text: str) -> bool:
        """Send a chat message, and return whether the server delivered it.

        Raises:
            ValueError: The text does not have 1 to 500 characters.
        """
        before = self._log.own_messages
        self.game.say(text)
        await self._wait_for(lambda: self._log.own_messages > before, ECHO_SECONDS)
        return self._log.own_messages > before

    def is_lost(self, now: float, seconds: float) -> bool:
        """Return whether the game server closed the connection for good, `seconds` ago or earlier.

        The time counts from the first call after that.
        """
        if not self._client.farewell:
            return False
        self._lost_at = self._lost_at or now
        return now >= self._lost_at + seconds

    async def close(self) -> None:
        """Leave the episode, so that the seat is free at once, and close the connection."""
        try:
            with contextlib.suppress(RobotouilleError, TimeoutError):
                async with asyncio.timeout(LEAVE_SECONDS):
                    await self._client.leave()
        finally:
            await self._client.close()

    # View

    @property
    def your_move(self) -> bool:
        """True if the seat may act and has no undecided action."""
        return self.game.my_move and not self._undecided

    @property
    def actions(self) -> list[str]:
        """The sentences of the seat's valid actions."""
        return [] if self.game.ended else [action.sentence for action in self.game.actions]

    def valid_actions(self) -> ValidActions:
        """Return the seat's valid actions now."""
        self._seen_step = self.game.step
        return ValidActions(step=self.game.step, your_move=self.your_move, actions=self.actions)

    def view(self, *, whole: bool = False) -> GameView:
        """Return the current view with all unread events.

        Args:
            whole: Include the kitchen even if it has not changed or the player is busy.
        """
        self._listen()
        news = self._log.read()
        game = self.game
        self._seen_step = game.step
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
            chat=[ChatMessage(name=c.name, seat=c.seat, text=c.text, own=c.own) for c in news.chat],
            observation=self._observation(whole),
            actions=self.actions,
            connected=self._client.connected.is_set(),
            outcome=self._outcome(),
        )

    def _observation(self, whole: bool) -> str | None:
        text = self.game.text_view
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
            reason=shortened(str(row["reason"])),
            steps=int(row["steps"]),
            detail=shortened(str(row.get("detail", ""))),
        )

    def _action(self) -> ActionOutcome | None:
        # A decided action is reported once.
        if self._asked is None:
            return None
        action, future = self._asked
        if not future.done():
            return ActionOutcome(
                action=action,
                status="pending",
                step=self.game.step,
                reasons=[],
                code="",
                age=None,
            )
        self._asked = None
        result = future.result()
        return ActionOutcome(
            action=action,
            status="applied" if result.applied else "rejected",
            step=result.step,
            reasons=[shortened(reason) for reason in result.reasons[:MAX_REASONS]],
            code=result.code,
            age=result.age,
        )

    def _next(self) -> str:
        game = self.game
        if game.outcome is not None:
            return "The episode has ended. Call leave."
        if game.ended:
            why = self._client.farewell or game.farewell
            reason = f" ({quoted(shortened(why))})" if why else ""
            return f"You are out of the episode{reason}. Call leave, then join to return."
        if not self._client.connected.is_set():
            return "The game server does not answer. Reconnecting to your seat. Call wait."
        if game.phase == "waiting":
            if game.starts_at is not None:
                return "The game begins in a moment. Call wait."
            if away := ", ".join(s.player for s in game.seats if s.name and not s.present):
                return f"The game begins when all players are there; away: {away}. Call wait."
            free = ", ".join(seat.player for seat in game.seats if not seat.name)
            unready = ", ".join(s.player for s in game.seats if not s.ready)
            if unready and not free:
                return (
                    f"The game begins when all players are ready; not ready: {unready}. Call wait."
                )
            return f"The game begins when all seats are taken; free: {free or 'none'}. Call wait."
        if game.paused:
            why = game.pause.reason if game.pause is not None else "unknown"
            return f"The game is paused ({why}). Call wait."
        if game.seat is None:
            return "You are a spectator. Call wait to see what happens."
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

    # Events

    @property
    def _undecided(self) -> bool:
        return self._asked is not None and not self._asked[1].done()

    def _something_new(self) -> bool:
        decided = self._asked is not None and self._asked[1].done()
        return self._log.unread or decided

    def _listen(self) -> None:
        for event in self.game.poll():
            self._log.take(event)

    @property
    def _at_its_end(self) -> bool:
        """True after the last step, when the outcome is about to arrive."""
        game = self.game
        return game.goal_reached or game.step >= game.clock["max_steps"]

    async def _wait_for(self, done: Callable[[], bool], timeout: float) -> None:
        async with waiting():
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(timeout):
                    while not (done() or self.game.ended):
                        self._log.take(await self.game.next_event())
