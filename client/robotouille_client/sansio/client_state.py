"""The client's state machine and its pending requests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille.protocol import messages
from robotouille.protocol.error_codes import ErrorCode

# Time limit for the answer to `hello` or a request. Only time with a connection counts, so that
# requests survive a restart of the server.
ANSWER_SECONDS = 15.0
# Delay before repeating a request that the server could not answer yet, during a handover.
AGAIN_SECONDS = 0.5

Request = (
    messages.ListEpisodes
    | messages.Create
    | messages.Close
    | messages.Join
    | messages.GetRendering
    | messages.GetPicture
    | messages.Leave
)


@dataclass(frozen=True, slots=True)
class RequestDone:
    """An answered request. A join is answered once its first snapshot or observation arrives."""

    ref: int
    answer: messages.ServerMessage


@dataclass(frozen=True, slots=True)
class RequestFailed:
    """A request that the server refused or that can no longer be answered."""

    ref: int
    error: RobotouilleError


@dataclass(slots=True)
class PendingRequest:
    """A request without an answer.

    Attributes:
        sent: True if the request was sent, over this connection or an earlier one.
        again_at: The time at which to send the request again.
        joined: The answer to a join whose first snapshot or observation has not arrived.
        moves: How often the request was redirected to another server process.
    """

    request: Request
    due: float
    again_at: float | None = None
    sent: bool = False
    joined: messages.Joined | None = None
    moves: int = 0


class PendingRequests:
    """All unanswered requests of a client, by their `ref`."""

    def __init__(self) -> None:
        self._last_ref = 0  # Refs begin at 1; `find` uses 0 for messages without one.
        self._events: list[RequestDone | RequestFailed] = []
        self.pending: dict[int, PendingRequest] = {}

    def next_ref(self) -> int:
        """Return an unused `ref`."""
        self._last_ref += 1
        return self._last_ref

    def add(self, request: Request, now: float) -> tuple[int, Request]:
        """Add a request and return its `ref` and the request with that `ref`."""
        ref = self.next_ref()
        numbered = request.model_copy(update={"ref": ref})
        self.pending[ref] = PendingRequest(numbered, now + ANSWER_SECONDS)
        return ref, numbered

    def find(self, message: messages.Message) -> PendingRequest | None:
        """Return the pending request with the `ref` of the message."""
        return self.pending.get(getattr(message, "ref", None) or 0)

    def join(self) -> int | None:
        """Return the `ref` of the pending join, if there is one."""
        pending = self.pending.items()
        return next((r for r, p in pending if isinstance(p.request, messages.Join)), None)

    def done(self, ref: int, answer: messages.ServerMessage) -> Request:
        """Remove an answered request, record the event and return the request."""
        self._events.append(RequestDone(ref, answer))
        return self.pending.pop(ref).request

    def fail(self, ref: int, error: RobotouilleError) -> None:
        """Remove a request that was refused or given up, and record the event."""
        del self.pending[ref]
        self._events.append(RequestFailed(ref, error))

    def events(self) -> list[RequestDone | RequestFailed]:
        """Return the requests that were answered or failed since the last call."""
        events, self._events = self._events, []
        return events

    def timers(self) -> list[float]:
        """Return the times at which a request has to be repeated or given up."""
        times = ((pending.due, pending.again_at) for pending in self.pending.values())
        return [time for pair in times for time in pair if time is not None]

    def to_repeat(self, now: float) -> list[Request]:
        """Return the requests to send again now."""
        due = [p for p in self.pending.values() if p.again_at is not None and p.again_at <= now]
        for pending in due:
            pending.again_at = None  # The next answer decides whether to repeat it once more.
        return [pending.request for pending in due]

    def overdue(self, now: float) -> list[tuple[int, PendingRequest]]:
        """Return the requests whose time limit has passed."""
        return [(ref, pending) for ref, pending in self.pending.items() if pending.due <= now]


def seat_fields(seats: Sequence[str]) -> dict[str, Any]:
    """Return the fields of a `join` that asks for these seats."""
    # Servers before `seats` existed read `seat` only, so a single seat goes there.
    if len(seats) > 1:
        return {"seat": None, "seats": [*seats]}
    return {"seat": seats[0] if seats else None, "seats": []}


class ClientState(Enum):
    """The state of a client's conversation with its server."""

    OFFLINE = "there is no connection"
    MOVING = "on the way to another process of the server"
    GREETING = "hello has no answer yet"
    LOBBY = "welcomed, and in no episode"
    RESUMING = "session resumed; `joined` follows if the client is in an episode"
    REJOINING = "welcomed with a new session; asking for the old seat again"
    SYNCING = "joined; the first snapshot or observation is on its way"
    PLAYING = "in an episode"
    CLOSED = "closed for good"

    @property
    def connected(self) -> bool:
        """True if there is a connection."""
        return self not in (ClientState.OFFLINE, ClientState.MOVING, ClientState.CLOSED)

    @property
    def online(self) -> bool:
        """True if there is a connection on which the server has welcomed the client."""
        return self.connected and self is not ClientState.GREETING


class Trigger(Enum):
    """An event that changes the state."""

    CONNECTED = "a connection was made"
    FAILED = "a connection could not be made, or was not welcomed"
    UNKNOWN = "the server does not accept the resume token"
    WELCOMED = "welcomed with a new session"
    RESUMED = "welcomed with the old session"
    FORGOTTEN = "welcomed with a new session, although the client was in an episode"
    ENTERED = "joined an episode that the client has no copy of"
    RETURNED = "joined an episode that the client has a copy of"
    SYNCED = "the first snapshot or observation arrived"
    REFUSED = "the server refuses to give the seat back"
    LEFT = "left the episode"
    MOVED = "redirected to another process"
    LOST = "the connection was lost"
    CLOSE = "the client closed"


# Without a connection the client can only connect or give up.
_AWAY = {
    Trigger.CONNECTED: ClientState.GREETING,
    Trigger.FAILED: ClientState.OFFLINE,
    Trigger.CLOSE: ClientState.CLOSED,
}
# The server may send `left` or `moved` at any time after its welcome.
_WELCOMED = {
    Trigger.LEFT: ClientState.LOBBY,
    Trigger.MOVED: ClientState.MOVING,
    Trigger.LOST: ClientState.OFFLINE,
    Trigger.CLOSE: ClientState.CLOSED,
}
TRANSITIONS: dict[ClientState, dict[Trigger, ClientState]] = {
    ClientState.OFFLINE: _AWAY,
    ClientState.MOVING: _AWAY,
    ClientState.GREETING: {
        # The client says hello again on the same connection, now with its role token. If it is
        # welcomed, it asks for its old seat (FORGOTTEN).
        Trigger.UNKNOWN: ClientState.GREETING,
        Trigger.WELCOMED: ClientState.LOBBY,
        Trigger.RESUMED: ClientState.RESUMING,
        Trigger.FORGOTTEN: ClientState.REJOINING,
        Trigger.MOVED: ClientState.MOVING,
        Trigger.FAILED: ClientState.OFFLINE,
        Trigger.CLOSE: ClientState.CLOSED,
    },
    ClientState.LOBBY: {Trigger.ENTERED: ClientState.SYNCING, **_WELCOMED},
    # A resumed session that was in no episode stays in this state until the client joins one. The
    # server does not announce whether `joined` follows, and every request is allowed until then.
    ClientState.RESUMING: {
        Trigger.ENTERED: ClientState.SYNCING,
        Trigger.RETURNED: ClientState.PLAYING,
        **_WELCOMED,
    },
    ClientState.REJOINING: {
        Trigger.ENTERED: ClientState.SYNCING,
        Trigger.RETURNED: ClientState.PLAYING,
        Trigger.REFUSED: ClientState.LOBBY,
        **_WELCOMED,
    },
    ClientState.SYNCING: {
        Trigger.ENTERED: ClientState.SYNCING,
        Trigger.SYNCED: ClientState.PLAYING,
        **_WELCOMED,
    },
    ClientState.PLAYING: {
        Trigger.ENTERED: ClientState.SYNCING,
        Trigger.RETURNED: ClientState.PLAYING,
        **_WELCOMED,
    },
    ClientState.CLOSED: {},
}
"""The state that each trigger leads to. Every other combination is a protocol error."""


def next_state(state: ClientState, trigger: Trigger) -> ClientState:
    """Return the state that a trigger leads to.

    Raises:
        ProtocolError: `message/unexpected`: the trigger is illegal in this state.
    """
    try:
        return TRANSITIONS[state][trigger]
    except KeyError:
        detail = f"{trigger.value}, in the state: {state.value}"
        raise ProtocolError(ErrorCode.MESSAGE_UNEXPECTED, detail) from None
