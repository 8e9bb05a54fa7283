"""The client's conversation with a server without I/O: a state machine over messages and time.

The owner of the connection

- reports its events (`connection_made`, `connection_failed`, `connection_lost`),
- passes received messages to `receive`, and calls `handle_timer` at the time of `get_timer`,
- sends what `next_message` returns, and confirms it with `message_sent`,
- follows `state`: in OFFLINE and MOVING it connects to `url` at `connect_at`; in any other state
  without a connection (CLOSED) it closes the one it has.

The client reconnects with growing delays and resumes where it was cut off: unanswered requests and
actions are sent again. If the server has several nodes, each round of attempts goes through their
addresses.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode
from robotouille_client.errors import (
    ConnectionFailedError,
    RetryLaterError,
    UntrustedRedirectError,
)
from robotouille_client.sansio.answers import (
    all_failures,
    answer_behind,
    implied_join,
    refused_hello,
)
from robotouille_client.sansio.attempts import ServerAddresses
from robotouille_client.sansio.client_state import (
    AGAIN_SECONDS,
    ANSWER_SECONDS,
    ClientState,
    PendingRequest,
    PendingRequests,
    Request,
    RequestDone,
    RequestFailed,
    Trigger,
    next_state,
    seat_fields,
)
from robotouille_client.sansio.game_replica import GameReplica

# Number of redirects in a row after which the client gives up. Otherwise, two processes that
# disagree about an episode would send it back and forth.
MAX_MOVES = 4
# A connection that was moved on sooner is followed by a delay, for the same reason.
SETTLED_SECONDS = 1.0
# Number of sooner losses in a row, without a step of the game, after which the delays grow, and
# after which the client gives up. The second one takes about three minutes.
BRIEF_AT_FIRST, MAX_BRIEF = 5, 50

# Answers to `hello` that mean the resume token is of no use.
TOKEN_ERRORS = (
    ErrorCode.AUTH_EXPIRED,
    ErrorCode.AUTH_INVALID,
    ErrorCode.AUTH_REQUIRED,
    ErrorCode.AUTH_REVOKED,
)
# Answers to a rejoin after which the same rejoin may succeed.
TEMPORARY_ERRORS = (ErrorCode.SERVER_HANDOVER, ErrorCode.SERVER_RECORDING, ErrorCode.RATE_LIMITED)
CLOSED = "the connection was closed"

G = TypeVar("G", bound=GameReplica)


class ClientProtocol(Generic[G]):
    """A participant's conversation with a server, over any number of connections.

    Args:
        url: One address, or several addresses of one server, separated by commas.

    Attributes:
        addresses: The addresses of the server.
        game: The episode that the client is in, made by `make_game`.
        membership: The join that brings the client back if the server has forgotten its session.
        connect_at: The time of the next connection attempt, in OFFLINE and MOVING.
        welcomed: True if a server has ever welcomed the client.
        resumed: True if the last welcome continued the session of the connection before.
        readiness: True if the server supports `ready`.
        opens_limited_sight: True if players see a part of the kitchen in episodes that are opened
            without rules about it.
        workers: Addresses of the server's processes, for hosts and operators, if there are several.
        farewell: The reason why the client is CLOSED; empty if its owner closed it.
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
        rng: random.Random | None = None,
    ) -> None:
        self.state = ClientState.OFFLINE
        self.addresses = ServerAddresses(url, rng or random.Random())
        self.name = name
        self.kind: messages.Kind = kind
        self.reconnect = reconnect
        self.resume = resume
        self.role = ""
        self.readiness = self.opens_limited_sight = False
        self.workers: tuple[messages.WorkerAddress, ...] = ()
        self.game: G | None = None
        self.membership: messages.Join | None = None
        self.connect_at = 0.0
        self.error: RobotouilleError | None = None
        self.farewell = ""
        self.welcomed = self.resumed = False
        self._make_game = make_game
        self._token = token
        self._failures: list[ConnectionFailedError] = []
        self._moves = 0
        self._greeting_due = 0.0
        self._online_since = 0.0
        self._brief, self._last_step = 0, -1
        self._requests = PendingRequests()
        self._rejoin: messages.Join | None = None
        self._rejoin_at: float | None = None
        self._joined: messages.Joined | None = None
        # Messages for the current connection only are sent first, and dropped when it is lost. The
        # others are kept for the next connection.
        self._first: deque[messages.Message] = deque()
        self._outbox: deque[messages.Message] = deque()

    @property
    def url(self) -> str:
        """The address of the connection, or of the next attempt."""
        return self.addresses.current

    @url.setter
    def url(self, url: str) -> None:
        self.addresses.current = url

    def _enter(self, trigger: Trigger) -> None:
        self.state = next_state(self.state, trigger)

    # Connection

    def connection_made(self, now: float) -> None:
        """Start a conversation over a new connection."""
        self._enter(Trigger.CONNECTED)
        self._greeting_due = now + ANSWER_SECONDS
        self._first.clear()
        self._rejoin = self._rejoin_at = None
        self._send_hello()

    def connection_failed(self, error: RobotouilleError, now: float) -> None:
        """Schedule the next attempt after a failed connection, or close if retrying is useless."""
        self._moves = 0
        if isinstance(error, UntrustedRedirectError) or not isinstance(
            error, ConnectionFailedError
        ):
            self.close(str(error), error)
        elif not self.welcomed:
            self._first_failed(error, now)
        elif not self.reconnect:
            self.close(str(error), error)
        else:
            self._try_next(now)

    def _first_failed(self, error: ConnectionFailedError, now: float) -> None:
        # Before the first welcome, a wrong address is more likely than a stopped server, so the
        # user gets the error once each address was tried.
        self._failures.append(error)
        if self.addresses.left:
            self._try_next(now)
            return
        error = all_failures(self._failures)
        self.close(str(error), error)

    def _try_next(self, now: float) -> None:
        self._enter(Trigger.FAILED)
        self.connect_at = now + self.addresses.failed()
        if self.addresses.dead_end:
            # The redirects did not go in a circle: the next node takes the episode over.
            for pending in self._requests.pending.values():
                pending.moves = 0

    def connection_lost(self, now: float, reason: str = "") -> None:
        """Schedule the next attempt after a lost connection."""
        if self.state is ClientState.GREETING:
            self._not_welcome(reason, now)
        elif not self.reconnect:
            self.close(CLOSED)
        elif not self._gives_up(now):
            self._enter(Trigger.LOST)
            self.connect_at = now + self.addresses.lost()

    def _gives_up(self, now: float) -> bool:
        """Close after too many connections in a row that were lost at once; return whether."""
        step = self.game.step if self.game is not None else -1
        brief = now - self._online_since < SETTLED_SECONDS and step == self._last_step
        self._brief = self._brief + 1 if brief else 0
        self._last_step = step
        if self._brief < MAX_BRIEF:
            return False
        words = f"welcomed the client {MAX_BRIEF} times in a row and closed the connection at once"
        error = ConnectionFailedError(f"{self.url} {words}")
        self.close(str(error), error)
        return True

    def fail(self, error: RobotouilleError) -> None:
        """Close because a message of the server is invalid."""
        if self.state is not ClientState.GREETING:
            self.close(f"invalid message from the server: {error}", error)
            return
        # With a game, `close` passes the original error code on to it.
        if isinstance(error, ProtocolError) and self.game is None:
            message = f"{self.url} is not a Robotouille server, or has an incompatible version"
            cause, error = error, ConnectionFailedError(message)
            error.__cause__ = cause
        self.close(str(error), error)

    def close(self, reason: str = "", error: RobotouilleError | None = None) -> None:
        """Close for good: fail all pending requests and end the game.

        Args:
            reason: The reason; empty if the client's owner closes it.
        """
        if self.state is ClientState.CLOSED:
            return
        self._enter(Trigger.CLOSE)
        self.farewell, self.error = reason, error
        for ref, pending in list(self._requests.pending.items()):
            self._requests.fail(ref, self._closed_error(pending))
        # Programs that await events or results of the game must not wait for ever.
        if self.game is not None and not self.game.finished:
            code = error.code if isinstance(error, ProtocolError) else ErrorCode.SERVER_BYE
            self.game.receive(messages.Bye(reason=reason or CLOSED, code=code), 0.0)

    def _closed_error(self, pending: PendingRequest | None = None) -> ConnectionFailedError:
        reason = self.farewell or CLOSED
        if pending is not None and pending.moves:
            return ConnectionFailedError(f"{self.url}, which has the episode: {reason}")
        return ConnectionFailedError(f"{self.url}: {reason}")

    # Requests

    def request(self, request: Request, now: float) -> int:
        """Queue a request and return the `ref` under which `events` reports its answer.

        Raises:
            ConnectionFailedError: The client is closed.
        """
        if self.state is ClientState.CLOSED:
            raise self._closed_error()
        ref, numbered = self._requests.add(request, now)
        self._outbox.append(numbered)
        return ref

    def forget(self, ref: int) -> None:
        """Ignore the answer to a request."""
        self._requests.pending.pop(ref, None)

    def events(self) -> list[RequestDone | RequestFailed]:
        """Return the requests that were answered or failed since the last call."""
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

    # Sending

    def next_message(self) -> messages.Message | None:
        """Return the next message to send. Call `message_sent` once it is sent."""
        if self.state.connected and self._first:
            return self._compatible(self._first[0])
        if not self.state.online:
            return None
        if self.game is not None:
            self._outbox.extend(self.game.messages_to_send())
        while self._outbox and not self._still_wanted(self._outbox[0]):
            self._outbox.popleft()
        return self._compatible(self._outbox[0]) if self._outbox else None

    def _compatible(self, message: messages.Message) -> messages.Message:
        # Servers before readiness existed reject the field; `ready=True` is not sent at all.
        if isinstance(message, messages.Join) and not (message.ready or self.readiness):
            return message.model_copy(update={"ready": True})
        return message

    def message_sent(self) -> None:
        """Confirm that the last `next_message` was sent.

        A message without confirmation is sent again over the next connection.
        """
        message = (self._first or self._outbox).popleft()
        pending = self._requests.find(message)
        if pending is not None:
            pending.sent = True

    def _still_wanted(self, message: messages.Message) -> bool:
        if isinstance(message, messages.Ready):
            return self.readiness and self.state is not ClientState.REJOINING
        if not isinstance(message, messages.Act):
            return True
        # A rejoin may have lost the seat, and a newer action may have replaced this one. Identity
        # is compared, because a lost seat restarts the sequence numbers.
        game = self.game
        return (
            self.state is not ClientState.REJOINING
            and game is not None
            and any(message is act for act in game.unanswered)
        )

    # Time

    def get_timer(self) -> float | None:
        """Return when to call `handle_timer`, or None if there is nothing to wait for."""
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
        """Repeat what is due, and give up requests that are unanswered for too long."""
        if self.state is ClientState.GREETING and self._greeting_due <= now:
            self._not_welcome("", now)
        self._outbox.extend(self._requests.to_repeat(now))
        for ref, pending in self._requests.overdue(now):
            self._overdue(ref, pending, now)
        rejoin, due = self._rejoin, self._rejoin_at
        if self.state is ClientState.REJOINING and rejoin and due is not None and due <= now:
            self._rejoin_at = None
            self._outbox.append(rejoin)
        game_timer = self._game_timer()
        if game_timer is not None and game_timer <= now and self.game is not None:
            self.game.handle_timer(now)

    def _game_timer(self) -> float | None:
        synced = self.state in (ClientState.SYNCING, ClientState.PLAYING)
        return self.game.get_timer() if synced and self.game is not None else None

    def _overdue(self, ref: int, pending: PendingRequest, now: float) -> None:
        # Time without a connection does not count, so a request survives a server's restart.
        if self.state.online and now - self._online_since >= ANSWER_SECONDS:
            self._requests.fail(ref, ConnectionFailedError(f"{self.url} does not answer"))
        else:
            pending.due = now + ANSWER_SECONDS

    # Greeting

    def _send_hello(self) -> None:
        resume, game = self.resume, self.game
        self._first.append(
            messages.Hello(
                protocol=messages.PROTOCOL_VERSION,
                name=self.name,
                kind=self.kind,
                # A resume token names the session, which already has a role.
                token=None if resume else self._token,
                resume=resume,
                seen=game.seen if resume and game is not None else None,
                view=self._requested_view() if resume else None,
            )
        )

    def _requested_view(self) -> messages.View | None:
        ref = self._requests.join()
        request = self._requests.pending[ref].request if ref is not None else None
        join = request if isinstance(request, messages.Join) else self.membership
        return join.view if join is not None else None

    def _not_welcome(self, reason: str, now: float) -> None:
        why = reason or f"no answer within {ANSWER_SECONDS:g} s"
        error = ConnectionFailedError(f"{self.url} did not welcome the client: {why}")
        self.connection_failed(error, now)

    def _greeted(self, answer: messages.ServerMessage, now: float) -> None:
        match answer:
            case messages.Welcome():
                self._welcome(answer, now)
            case messages.Error() if self.resume and answer.code in TOKEN_ERRORS:
                self._enter(Trigger.UNKNOWN)
                self.resume = None
                self._send_hello()
            # Another process of the server has this session.
            case messages.Moved():
                self._greeted_elsewhere(answer, now)
            case _:
                self.connection_failed(refused_hello(answer, self.url), now)

    def _greeted_elsewhere(self, moved: messages.Moved, now: float) -> None:
        # The resume token is kept: the redirect leads to where it is valid.
        self._moves += 1
        try:
            url = self.addresses.resolve(moved)
        except UntrustedRedirectError as error:
            self.connection_failed(error, now)
            return
        if not self.addresses.redirect_within_round(url):
            reason = f"{self.url} redirects to {url}, which has just failed"
            self.connection_failed(RetryLaterError(reason), now)
        elif self._moves < MAX_MOVES:
            self._enter(Trigger.MOVED)
            self.connect_at = now
        else:
            self.connection_failed(self._too_many_moves(), now)

    def _too_many_moves(self) -> ConnectionFailedError:
        return ConnectionFailedError(f"{self.url} redirects from one process to the next")

    def _welcome(self, welcome: messages.Welcome, now: float) -> None:
        join = self.membership or implied_join(self.game)
        if welcome.resumed:
            self._enter(Trigger.RESUMED)
        elif join is None:
            self._enter(Trigger.WELCOMED)
        else:
            self._enter(Trigger.FORGOTTEN)
            ours = seat_fields(self.game.own_seats) if self.game is not None else {}
            self._rejoin = join.model_copy(update={"ref": self._requests.next_ref(), **ours})
            self._first.append(self._rejoin)
        for pending in self._requests.pending.values():
            # A `create` is not repeated: if only its answer was lost, a second episode would open.
            if pending.sent and not isinstance(pending.request, messages.Create):
                self._first.append(pending.request)
        self.resume, self.role = welcome.resume, welcome.role
        self.readiness, self.workers = welcome.readiness, tuple(welcome.workers)
        self.opens_limited_sight = welcome.opens_limited_sight
        self.resumed = welcome.resumed
        self._online_since, self.welcomed, self._moves = now, True, 0
        self.addresses.reached(welcome.nodes, stable=self._brief < BRIEF_AT_FIRST)

    # Messages

    def receive(self, message: messages.ServerMessage, now: float, size: int = 0) -> None:
        """Process a message from the server; `size` is its size in bytes.

        Raises:
            ProtocolError: The message is not allowed in this state, or cannot be applied.
        """
        if self.state is ClientState.GREETING:
            self._greeted(message, now)
            return
        if not self.state.online or isinstance(message, messages.Welcome):
            detail = f"{type(message).__name__}, in the state: {self.state.value}"
            raise ProtocolError(ErrorCode.MESSAGE_UNEXPECTED, detail)
        if isinstance(message, messages.Moved) and message.ref is None:
            self._continue_elsewhere(message, now)
            return
        if isinstance(message, messages.Bye) and message.retry:
            return  # The server is restarting. It closes the connection, and the client returns.
        if isinstance(message, messages.Joined):
            self._enter_game(message, now)
        elif isinstance(message, messages.Left):
            self._enter(Trigger.LEFT)
            self.membership = None
        if self.game is not None:
            self.game.receive(message, now, size)
        if isinstance(message, messages.Bye):
            self.close(message.reason)
        # Snapshots and observations have no `ref`, but the first one completes a join.
        elif isinstance(message, messages.Snapshot | messages.Observation):
            self._synced()
        else:
            self._answered(message, now)

    def _continue_elsewhere(self, moved: messages.Moved, now: float) -> None:
        """Follow the episode, and resume there as after a lost connection."""
        try:
            url = self.addresses.resolve(moved)
        except UntrustedRedirectError as error:
            self.close(str(error), error)
            return
        if self._gives_up(now):
            return
        self._enter(Trigger.MOVED)
        settled = now - self._online_since >= SETTLED_SECONDS
        self.connect_at = now + self.addresses.redirect(url, at_once=settled)

    def _enter_game(self, joined: messages.Joined, now: float) -> None:
        game, asked = self.game, joined.ref is not None
        # A join by the user starts with a new copy of the game, even in the same episode. Only a
        # rejoin, or `joined` without a request after a resume, continues with the old copy.
        fresh = joined.ref in self._requests.pending or (asked and game is not None and game.ended)
        if game is None or game.episode != joined.episode or fresh:
            self._enter(Trigger.ENTERED)
            self.game = self._make_game(joined)
        else:
            self._enter(Trigger.RETURNED if game.synced else Trigger.ENTERED)
            game.rejoined(joined, now, new_session=asked)
        self.addresses.answered()
        self.resume = joined.resume or self.resume
        self._rejoin = self._rejoin_at = None
        self._joined = joined

    def _synced(self) -> None:
        if self.state is ClientState.SYNCING and self.game is not None and self.game.synced:
            self._enter(Trigger.SYNCED)
            for ref, pending in list(self._requests.pending.items()):
                if pending.joined is not None:
                    self._done(ref, pending.joined)

    def _answered(self, message: messages.ServerMessage, now: float) -> None:
        ref = getattr(message, "ref", None)
        # After a resume, `joined` has no `ref`, but it also answers a join from before.
        if isinstance(message, messages.Joined) and ref is None:
            ref = self._requests.join()
        rejoined = self._rejoin is not None and ref == self._rejoin.ref
        joins = rejoined or (ref is not None and ref == self._requests.join())
        if joins and not isinstance(message, messages.Moved):
            self.addresses.answered()
        if rejoined:
            self._rejoin_refused(message, now)
            return
        pending = self._requests.pending.get(ref) if ref is not None else None
        if ref is None or pending is None:
            return
        if isinstance(message, messages.Error):
            left = self.game.episode if self.game else "-"
            message = answer_behind(pending.request, message, self._joined, left)
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

    def _join_elsewhere(
        self, ref: int, pending: PendingRequest, moved: messages.Moved, now: float
    ) -> None:
        pending.moves += 1
        if pending.moves >= MAX_MOVES:
            self._requests.fail(ref, self._too_many_moves())
            return
        try:
            self._move(moved, now)
        except UntrustedRedirectError as error:
            self._requests.fail(ref, error)

    def _rejoin_refused(self, answer: messages.ServerMessage, now: float) -> None:
        if isinstance(answer, messages.Moved):
            try:
                self._move(answer, now)
            except UntrustedRedirectError as error:
                self.close(str(error), error)
        elif isinstance(answer, messages.Error) and answer.code in TEMPORARY_ERRORS:
            self._rejoin_at = now + AGAIN_SECONDS
        elif isinstance(answer, messages.Error):
            # The client stays in the lobby, where its owner may join another episode.
            self._enter(Trigger.REFUSED)
            self.membership = self._rejoin = None
            if self.game is not None:
                lost = messages.Bye(reason=answer.message, code=answer.code)
                self.game.receive(lost, 0.0)

    def _move(self, moved: messages.Moved, now: float) -> None:
        url = self.addresses.resolve(moved)
        self._enter(Trigger.MOVED)
        # The session stays with the process that opened it: the next one needs the role token.
        self.resume = None
        self.connect_at = now + self.addresses.redirect(url)
