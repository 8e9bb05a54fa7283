"""A client's side of the protocol without I/O: messages and the time in, messages and events out.

Whoever owns the connection tells of it (`connection_made`, `connection_failed`,
`connection_lost`), hands over what comes (`receive`), sends what `next_message` gives, calls
`handle_timer` at the time of `get_timer`, and heeds `state`: in OFFLINE and MOVING it connects to
`url` at `connect_at`, and otherwise it closes a connection that `state` says there is not.

A lost connection is sought again with growing pauses, and taken up where it was cut: requests and
actions without an answer are sent again.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Iterator
from typing import Generic, Literal, TypeVar

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille_client.errors import ConnectionFailedError, NotYetError, StrangerError
from robotouille_client.sansio.addresses import moved_url
from robotouille_client.sansio.backoff import pauses
from robotouille_client.sansio.client_requests import (
    AGAIN_SECONDS,
    ANSWER_SECONDS,
    PendingRequest,
    Request,
    RequestDone,
    RequestFailed,
    Requests,
    seats_asked,
)
from robotouille_client.sansio.client_state import ClientState, Trigger, next_state
from robotouille_client.sansio.game_replica import GameReplica

__all__ = ["ClientProtocol"]

MAX_MOVES = 4

LOST_TOKEN = (
    ErrorCode.AUTH_EXPIRED,
    ErrorCode.AUTH_INVALID,
    ErrorCode.AUTH_REQUIRED,
    ErrorCode.AUTH_REVOKED,
)
TEMPORARY = (ErrorCode.SERVER_HANDOVER, ErrorCode.SERVER_RECORDING, ErrorCode.RATE_LIMITED)
CLOSED = "the connection was closed"

G = TypeVar("G", bound=GameReplica)


class ClientProtocol(Generic[G]):
    """A participant's conversation with a server, over any number of connections.

    `make_game` makes the game of an episode that one has joined. `membership` is the join that
    takes us back into it where the server has forgotten us.
    """

    def __init__(
        self,
        make_game: Callable[[messages.Joined], G],
        *,
        url: str,
        name: str,
        kind: messages.Kind = "bot",
        reconnect: bool = True,
        token: str | None = None,
        resume: str | None = None,
        rng: random.Random,
    ) -> None:
        self.state = ClientState.OFFLINE
        self.url = url
        self.name = name
        self.kind: messages.Kind = kind
        self.reconnect = reconnect
        self.resume = resume
        self.role = ""
        self.readiness = False
        self.game: G | None = None
        self.membership: messages.Join | None = None
        self.connect_at = 0.0
        self.error: RobotouilleError | None = None
        self.farewell = ""
        self._make_game = make_game
        self._token = token
        self._rng = rng
        self._pauses: Iterator[float] = pauses(rng)
        self.welcomed = self.resumed = False
        self._moves = 0
        self._greeting_due = 0.0
        self._up_since = 0.0
        self._requests = Requests()
        self._rejoin: messages.Join | None = None
        self._rejoin_at: float | None = None
        self._joined: messages.Joined | None = None
        self._first: deque[messages.Message] = deque()
        self._outbox: deque[messages.Message] = deque()

    def _enter(self, trigger: Trigger) -> None:
        self.state = next_state(self.state, trigger)

    # The connection

    def connection_made(self, now: float) -> None:
        """There is a connection: say hello."""
        self._enter(Trigger.CONNECTED)
        self._greeting_due = now + ANSWER_SECONDS
        self._first.clear()
        self._rejoin = self._rejoin_at = None
        self._hello()

    def connection_failed(self, error: RobotouilleError, now: float) -> None:
        """There is no connection, or no welcome on it: try again later, if that may help."""
        hopeless = isinstance(error, StrangerError) or not isinstance(error, ConnectionFailedError)
        if hopeless or not self.welcomed or not self.reconnect:
            self.close(str(error), error)
        else:
            self._enter(Trigger.FAILED)
            self.connect_at = now + next(self._pauses)

    def connection_lost(self, now: float, reason: str = "") -> None:
        """The connection is gone."""
        if self.state is ClientState.GREETING:
            self._not_welcome(reason, now)
        elif self.reconnect:
            self._enter(Trigger.LOST)
            self.connect_at = now + next(self._pauses)
        else:
            self.close(CLOSED)

    def fail(self, error: RobotouilleError) -> None:
        """What the server sends cannot be made sense of."""
        if self.state is not ClientState.GREETING:
            self.close(f"the server's messages cannot be read: {error}", error)
            return
        if isinstance(error, ProtocolError) and self.game is None:  # A game is told the code.
            words = f"{self.url} is of another version, or is not Robotouille's"
            odd, error = error, ConnectionFailedError(words)
            error.__cause__ = odd  # What is odd about it is for those who mend servers.
        self.close(str(error), error)

    def close(self, reason: str = "", error: RobotouilleError | None = None) -> None:
        """The end, and why; without a reason we have had enough."""
        if self.state is ClientState.CLOSED:
            return
        self._enter(Trigger.CLOSE)
        self.farewell, self.error = reason, error
        for ref, pending in list(self._requests.pending.items()):
            self._requests.fail(ref, self._gone(pending))
        if self.game is not None and not self.game.over:
            code = error.code if isinstance(error, ProtocolError) else ErrorCode.SERVER_BYE
            self.game.receive(messages.Bye(reason=reason or CLOSED, code=code), 0.0)

    def _gone(self, pending: PendingRequest | None = None) -> ConnectionFailedError:
        """Why a request is not answered."""
        reason = self.farewell or CLOSED
        if pending is not None and pending.moves:
            return ConnectionFailedError(f"{self.url}, where the episode is: {reason}")
        return ConnectionFailedError(f"{self.url}: {reason}")

    # Requests

    def request(self, request: Request, now: float) -> int:
        """Ask the server; an event tells the answer by the number that is returned.

        Raises ConnectionFailedError where the connection is closed for good.
        """
        if self.state is ClientState.CLOSED:
            raise self._gone()
        ref, numbered = self._requests.add(request, now)
        self._outbox.append(numbered)
        return ref

    def forget(self, ref: int) -> None:
        """Nobody waits for this answer any more."""
        self._requests.pending.pop(ref, None)

    def events(self) -> list[RequestDone | RequestFailed]:
        """What became of requests since this was last asked."""
        return self._requests.events()

    def _done(self, ref: int, answer: messages.ServerMessage) -> None:
        request = self._requests.done(ref, answer)
        if isinstance(request, messages.Join):
            self.membership = request
        elif isinstance(request, messages.Leave):
            self.game = self.membership = None
            if self.state is ClientState.REJOINING:
                self._rejoin = self._rejoin_at = None
                self._enter(Trigger.LEFT)

    # What is sent

    def next_message(self) -> messages.Message | None:
        """What is to be sent next; `message_sent` says that it was."""
        if self.state.connected and self._first:
            return self._known(self._first[0])
        if not self.state.online:
            return None
        if self.game is not None:
            self._outbox.extend(self.game.messages_to_send())
        while self._outbox and not self._wanted(self._outbox[0]):
            self._outbox.popleft()
        return self._known(self._outbox[0]) if self._outbox else None

    def _known(self, message: messages.Message) -> messages.Message:
        """A message without what only a later server knows."""
        if isinstance(message, messages.Join) and not (message.ready or self.readiness):
            return message.model_copy(update={"ready": True})
        return message

    def message_sent(self) -> None:
        """The last message of `next_message` is on its way. Without this it is sent again, over
        the next connection."""
        message = (self._first or self._outbox).popleft()
        pending = self._requests.find(message)
        if pending is not None:
            pending.sent = True

    def _wanted(self, message: messages.Message) -> bool:
        """Whether an action still is: its game, and our seat in it, may be lost; or whether the
        server knows the message at all."""
        if isinstance(message, messages.Ready):
            return self.readiness and self.state is not ClientState.REJOINING
        if not isinstance(message, messages.Act):
            return True
        game = self.game
        return (
            self.state is not ClientState.REJOINING
            and game is not None
            and any(message is act for act in game.unanswered)
        )

    # Time

    def get_timer(self) -> float | None:
        """When to call `handle_timer`; None while there is nothing to wait for."""
        if self.state is ClientState.GREETING:
            return self._greeting_due
        if self.state is ClientState.CLOSED:
            return None
        times = self._requests.timers()
        if self.state is ClientState.REJOINING and self._rejoin_at is not None:
            times.append(self._rejoin_at)
        if (game_timer := self._game_timer()) is not None:
            times.append(game_timer)
        return min(times, default=None)

    def handle_timer(self, now: float) -> None:
        """Send again what is due, and give up what has had no answer for too long."""
        if self.state is ClientState.GREETING and self._greeting_due <= now:
            self._not_welcome("", now)
        self._outbox.extend(self._requests.to_repeat(now))
        for ref, pending in self._requests.overdue(now):
            self._overdue(ref, pending, now)
        if self.state is ClientState.REJOINING and self._rejoin is not None:
            self._join_again(self._rejoin, now)
        game_timer = self._game_timer()
        if game_timer is not None and game_timer <= now and self.game is not None:
            self.game.handle_timer(now)

    def _join_again(self, rejoin: messages.Join, now: float) -> None:
        if self._rejoin_at is not None and self._rejoin_at <= now:
            self._rejoin_at = None
            self._outbox.append(rejoin)

    def _game_timer(self) -> float | None:
        """Nothing is sent again before the server has told what we missed."""
        here = self.state in (ClientState.SYNCING, ClientState.PLAYING)
        return self.game.get_timer() if here and self.game is not None else None

    def _overdue(self, ref: int, pending: PendingRequest, now: float) -> None:
        if self.state.online and now - self._up_since >= ANSWER_SECONDS:
            self._requests.fail(ref, ConnectionFailedError(f"{self.url} does not answer"))
        else:
            pending.due = now + ANSWER_SECONDS

    # Hello

    def _hello(self) -> None:
        """Say hello; with a resume token, also what we have seen."""
        resume, game = self.resume, self.game
        self._first.append(
            messages.Hello(
                protocol=messages.PROTOCOL_VERSION,
                name=self.name,
                kind=self.kind,
                token=None if resume else self._token,
                resume=resume,
                seen=game.seen if resume and game is not None else None,
                view=self._view() if resume else None,
            )
        )

    def _view(self) -> messages.View | None:
        """The view that we have asked for, whether or not that was answered."""
        ref = self._requests.join()
        asked = self._requests.pending[ref].request if ref is not None else None
        join = asked if isinstance(asked, messages.Join) else self.membership
        return join.view if join is not None else None

    def _not_welcome(self, reason: str, now: float) -> None:
        error = ConnectionFailedError(f"{self.url} did not welcome us: {reason}")
        self.connection_failed(error, now)

    def _greeted(self, answer: messages.ServerMessage, now: float) -> None:
        """The answer to hello."""
        match answer:
            case messages.Welcome():
                self._welcome(answer, now)
            case messages.Error() if self.resume and answer.code in LOST_TOKEN:
                self._enter(Trigger.UNKNOWN)
                self.resume = None
                self._hello()
            case messages.Moved():
                self._greeted_elsewhere(answer, now)
            case messages.Error(code=ErrorCode.SERVER_HANDOVER):
                self.connection_failed(NotYetError(answer.message), now)
            case messages.Bye(retry=True):
                self.connection_failed(NotYetError(answer.reason), now)
            case messages.Error():
                message = answer.message
                if answer.code == ErrorCode.PROTOCOL_VERSION:
                    message = f"{self.url} is of another version ({message}); update this program"
                error = ProtocolError(answer.code, message, answer.field)
                self.connection_failed(error, now)
            case messages.Bye():
                self.connection_failed(ProtocolError(answer.code, answer.reason), now)
            case _:
                reason = f"{type(answer).__name__} in answer to hello"
                self.connection_failed(NotYetError(reason), now)

    def _greeted_elsewhere(self, moved: messages.Moved, now: float) -> None:
        """Go on at once, but not round and round."""
        self._moves += 1
        try:
            self.url = moved_url(self.url, moved)
        except StrangerError as error:
            self.connection_failed(error, now)
            return
        if self._moves < MAX_MOVES:
            self._enter(Trigger.MOVED)
            self.connect_at = now
        else:
            self._moves = 0
            self.connection_failed(self._round_and_round(), now)

    def _round_and_round(self) -> ConnectionFailedError:
        return ConnectionFailedError(f"{self.url} sends us from one process to the next")

    def _welcome(self, welcome: messages.Welcome, now: float) -> None:
        """Ask again what was not answered, and join again where the server has forgotten us."""
        join = self.membership or self._joined_without_asking()
        if welcome.resumed:
            self._enter(Trigger.RESUMED)
        elif join is None:
            self._enter(Trigger.WELCOMED)
        else:
            self._enter(Trigger.FORGOTTEN)
            ours = seats_asked(self.game.own_seats) if self.game is not None else {}
            self._rejoin = join.model_copy(update={"ref": self._requests.next_ref(), **ours})
            self._first.append(self._rejoin)
        for pending in self._requests.pending.values():
            if pending.sent and not isinstance(pending.request, messages.Create):
                self._first.append(pending.request)
        self.resume, self.role = welcome.resume, welcome.role
        self.readiness = welcome.readiness
        self.resumed = welcome.resumed
        self._up_since, self.welcomed, self._moves = now, True, 0
        self._pauses = pauses(self._rng)

    def _joined_without_asking(self) -> messages.Join | None:
        """What would bring us into a game that a resume token alone has brought us into."""
        game = self.game
        if game is None or game.ended:
            return None
        role: Literal["player", "spectator"] = "player" if game.seat else "spectator"
        view: messages.View = "text"
        if game.has_state:
            view = "state" if game.observation is None else "both"
        return messages.Join(
            episode=game.episode, role=role, view=view, **seats_asked(game.own_seats)
        )

    # Messages

    def receive(self, message: messages.ServerMessage, now: float) -> None:
        """Take a message of the server into account.

        Raises ProtocolError where it must not come now, or cannot be applied.
        """
        if self.state is ClientState.GREETING:
            self._greeted(message, now)
            return
        if not self.state.online or isinstance(message, messages.Welcome):
            name = type(message).__name__
            raise ProtocolError(ErrorCode.MESSAGE_UNEXPECTED, f"{name}, while {self.state.value}")
        if isinstance(message, messages.Bye) and message.retry:
            return
        if isinstance(message, messages.Joined):
            self._take_up(message, now)
        elif isinstance(message, messages.Left):
            self._enter(Trigger.LEFT)
            self.membership = None
        if self.game is not None:
            self.game.receive(message, now)
        if isinstance(message, messages.Bye):
            self.close(message.reason)
        elif isinstance(message, messages.Snapshot | messages.Observation):
            self._synced()
        else:
            self._answered(message, now)

    def _take_up(self, joined: messages.Joined, now: float) -> None:
        """We are in an episode: in another, or again."""
        game, asked = self.game, joined.ref is not None
        anew = joined.ref in self._requests.pending or (asked and game is not None and game.ended)
        if game is None or game.episode != joined.episode or anew:
            self._enter(Trigger.ENTERED)
            self.game = self._make_game(joined)
        else:
            self._enter(Trigger.RETURNED if game.synced else Trigger.ENTERED)
            game.rejoined(joined, now, anew=asked)
        self.resume = joined.resume or self.resume
        self._rejoin = self._rejoin_at = None
        self._joined = joined

    def _synced(self) -> None:
        """A join is answered once its first snapshot, or an observation of each seat, is there."""
        if self.state is ClientState.SYNCING and self.game is not None and self.game.synced:
            self._enter(Trigger.SYNCED)
            for ref, pending in list(self._requests.pending.items()):
                if pending.joined is not None:
                    self._done(ref, pending.joined)

    def _answered(self, message: messages.ServerMessage, now: float) -> None:
        ref = getattr(message, "ref", None)
        if isinstance(message, messages.Joined) and ref is None:
            ref = self._requests.join()
        if self._rejoin is not None and ref == self._rejoin.ref:
            self._rejoin_refused(message, now)
            return
        pending = self._requests.pending.get(ref) if ref is not None else None
        if ref is None or pending is None:
            return
        if isinstance(message, messages.Error):
            message = self._done_before(pending.request, message)
        match message:
            case messages.Joined() if self.state is ClientState.SYNCING:
                pending.joined = message
            case messages.Error(code=ErrorCode.SERVER_HANDOVER):
                pending.again_at = now + AGAIN_SECONDS
            case messages.Error():
                self._requests.fail(
                    ref, ProtocolError(message.code, message.message, message.field)
                )
            case messages.Moved():
                self._join_elsewhere(ref, pending, message, now)
            case _:
                self._done(ref, message)

    def _done_before(self, request: Request, error: messages.Error) -> messages.ServerMessage:
        """A request that was sent twice since its first answer was lost: it has been done."""
        if isinstance(request, messages.Leave) and error.code == ErrorCode.EPISODE_NONE:
            return messages.Left(ref=error.ref, episode=self.game.episode if self.game else "-")
        joined = self._joined
        if isinstance(request, messages.Join) and error.code == ErrorCode.EPISODE_JOINED and joined:
            asked = request.episode.replace("-", "").upper()
            if asked in (joined.episode.upper(), joined.code.replace("-", "").upper()):
                return joined
        return error

    def _join_elsewhere(
        self, ref: int, pending: PendingRequest, moved: messages.Moved, now: float
    ) -> None:
        """The episode is with another process: join there."""
        pending.moves += 1
        if pending.moves >= MAX_MOVES:
            self._requests.fail(ref, self._round_and_round())
            return
        try:
            self._move(moved, now)
        except StrangerError as error:
            self._requests.fail(ref, error)

    def _rejoin_refused(self, answer: messages.ServerMessage, now: float) -> None:
        """Our place was lost, and it is not simply given back."""
        if isinstance(answer, messages.Moved):
            try:
                self._move(answer, now)
            except StrangerError as error:
                self.close(str(error), error)
        elif isinstance(answer, messages.Error) and answer.code in TEMPORARY:
            self._rejoin_at = now + AGAIN_SECONDS
        elif isinstance(answer, messages.Error):
            self._enter(Trigger.REFUSED)
            self.membership = self._rejoin = None
            if self.game is not None:
                lost = messages.Bye(reason=answer.message, code=answer.code)
                self.game.receive(lost, 0.0)

    def _move(self, moved: messages.Moved, now: float) -> None:
        """Go to another process; StrangerError where that is none of this server."""
        url = moved_url(self.url, moved)
        self._enter(Trigger.MOVED)
        self.url, self.resume = url, None
        self.connect_at = now + next(self._pauses)
