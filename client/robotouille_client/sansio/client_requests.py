"""What a client has asked and has no answer to yet, and what became of the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from robotouille.errors import RobotouilleError
from robotouille.protocol import messages

__all__ = [
    "AGAIN_SECONDS",
    "ANSWER_SECONDS",
    "PendingRequest",
    "Request",
    "RequestDone",
    "RequestFailed",
    "Requests",
    "seats_asked",
]

ANSWER_SECONDS = 15.0
"""Within which hello and requests are answered; only time with a connection counts."""
AGAIN_SECONDS = 0.5
"""After which a request is sent again that the server asked us to repeat."""

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
    """A request was answered; a join once its first snapshot or observation is there."""

    ref: int
    answer: messages.ServerMessage


@dataclass(frozen=True, slots=True)
class RequestFailed:
    """A request was refused, or cannot be answered any more."""

    ref: int
    error: RobotouilleError


@dataclass(slots=True)
class PendingRequest:
    """A request without an answer.

    `sent`: it went out, over this connection or an earlier one. `again_at`: when it is to be sent
    once more. `joined`: it has its answer, but nothing is seen of the episode so far. `moves`: how
    often it was sent to another process.
    """

    request: Request
    due: float
    again_at: float | None = None
    sent: bool = False
    joined: messages.Joined | None = None
    moves: int = 0


class Requests:
    """All requests of a client, by their numbers."""

    def __init__(self) -> None:
        self._refs = 0
        self._events: list[RequestDone | RequestFailed] = []
        self.pending: dict[int, PendingRequest] = {}

    def next_ref(self) -> int:
        """A number that no request has had."""
        self._refs += 1
        return self._refs

    def add(self, request: Request, now: float) -> tuple[int, Request]:
        """A request gets its number."""
        ref = self.next_ref()
        numbered = request.model_copy(update={"ref": ref})
        self.pending[ref] = PendingRequest(numbered, now + ANSWER_SECONDS)
        return ref, numbered

    def find(self, message: messages.Message) -> PendingRequest | None:
        """The request that a message is, or answers."""
        return self.pending.get(getattr(message, "ref", None) or 0)

    def join(self) -> int | None:
        """The number of a join that has no answer."""
        pending = self.pending.items()
        return next((r for r, p in pending if isinstance(p.request, messages.Join)), None)

    def done(self, ref: int, answer: messages.ServerMessage) -> Request:
        """A request is answered."""
        self._events.append(RequestDone(ref, answer))
        return self.pending.pop(ref).request

    def fail(self, ref: int, error: RobotouilleError) -> None:
        """A request is refused, or given up."""
        del self.pending[ref]
        self._events.append(RequestFailed(ref, error))

    def events(self) -> list[RequestDone | RequestFailed]:
        """What became of requests since this was last asked."""
        events, self._events = self._events, []
        return events

    def timers(self) -> list[float]:
        """When to look at them again."""
        times = ((pending.due, pending.again_at) for pending in self.pending.values())
        return [time for pair in times for time in pair if time is not None]

    def to_repeat(self, now: float) -> list[Request]:
        """Those whose time has come to be sent once more."""
        due = [p for p in self.pending.values() if p.again_at is not None and p.again_at <= now]
        for pending in due:
            pending.again_at = None
        return [pending.request for pending in due]

    def overdue(self, now: float) -> list[tuple[int, PendingRequest]]:
        """Those that should have had an answer by now."""
        return [(ref, pending) for ref, pending in self.pending.items() if pending.due <= now]


def seats_asked(seats: Sequence[str]) -> dict[str, Any]:
    """The fields of a join that asks for these seats; a server of before knows of one only."""
    if len(seats) > 1:
        return {"seat": None, "seats": [*seats]}
    return {"seat": seats[0] if seats else None, "seats": []}
