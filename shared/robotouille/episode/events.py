"""What an episode reports: frozen values, in the order in which things happened."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

from robotouille.episode.lifecycle import Controller
from robotouille.episode.pauses import PauseReason
from robotouille.episode.tallies import SeatTally
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.objects import Atom
from robotouille.world.unmet import Attempt, Unmet, UnmetKind
from robotouille.world.world import State

__all__ = [
    "ACTION_INVALID",
    "ACTION_UNKNOWN",
    "UNREADABLE",
    "Announced",
    "CountdownChanged",
    "Departure",
    "Ended",
    "Event",
    "Moderated",
    "Moderation",
    "Move",
    "Noted",
    "Outcome",
    "Paused",
    "QuotaReached",
    "ReadinessChanged",
    "Reason",
    "Rejected",
    "RejectionKind",
    "Restarted",
    "Resumed",
    "RosterChanged",
    "RoundTripMeasured",
    "Said",
    "Started",
    "Stepped",
]


ACTION_INVALID = "action/invalid"
"""The code of a known action that is not valid now."""
ACTION_UNKNOWN = "action/unknown"
"""The code of what is no action at all."""
UNREADABLE = "message/"
"""How the codes of messages begin that cannot be read."""


class Reason(StrEnum):
    """Why an episode ended."""

    GOAL = "goal"
    STEP_LIMIT = "step_limit"
    ABANDONED = "abandoned"
    ABORTED = "aborted"


class Departure(StrEnum):
    """Why a participant has no seat any more: it left, was away too long, or was sent out."""

    LEFT = "left"
    LOST = "lost"
    REMOVED = "removed"


class Moderation(StrEnum):
    """What an operator decides on somebody: to send them out for good, or whether they may talk."""

    BANNED = "banned"
    MUTED = "muted"
    UNMUTED = "unmuted"


@dataclass(frozen=True, slots=True)
class Outcome:
    """How an episode ended, as data; `seconds` are those since its start, pauses included; 0
    if it never began."""

    reason: Reason
    steps: int
    seconds: float
    seats: tuple[SeatTally, ...]
    detail: str = ""

    @property
    def success(self) -> bool:
        """Whether the goal was reached."""
        return self.reason is Reason.GOAL

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> Outcome:
        """The outcome that `to_json` wrote."""
        seats = tuple(SeatTally.from_json(seat) for seat in row.get("seats", ()))
        return cls(
            Reason(row["reason"]), row["steps"], row["seconds"], seats, row.get("detail", "")
        )

    def to_json(self) -> dict[str, Any]:
        """The outcome as JSON values, its seconds to the nearest millisecond."""
        return {
            "reason": self.reason.value,
            "steps": self.steps,
            "seconds": round(self.seconds, 3),
            "detail": self.detail,
            "seats": [tally.to_json() for tally in self.seats],
        }


class Move(NamedTuple):
    """One seat's action in a step: its sequence number and the seconds the seat took for it, while
    the game ran and the seat could act.

    `basis` is the step on which the choice was made, if the seat says so.
    """

    player: str
    action: GroundAction
    seq: int
    latency: float
    reasoning: str = ""
    basis: int | None = None


@dataclass(frozen=True, slots=True)
class CountdownChanged:
    """Everybody is there and ready, and the game begins in so many seconds; None: it does not,
    since somebody is missing again, or is not ready."""

    seconds: float | None


@dataclass(frozen=True, slots=True)
class Started:
    """Everybody is there and ready, and time runs."""

    time: float


@dataclass(frozen=True, slots=True)
class RosterChanged:
    """Somebody came, went, or lost or regained the connection; `controller` moves the seat now.

    `session` and `participant` are pseudonyms, `generation` that of the resume token in use.
    `why` a seat is free, if somebody has just lost it.
    """

    player: str
    name: str
    kind: str
    present: bool
    time: float
    taken: bool = True
    controller: Controller = Controller.FREE
    session: str = ""
    participant: str = ""
    generation: int = 0
    why: Departure | None = None


@dataclass(frozen=True, slots=True)
class ReadinessChanged:
    """Before the beginning: a seat's participant is ready for it, or is not (any more)."""

    player: str
    ready: bool


class RejectionKind(StrEnum):
    """What an action was that was taken into no step."""

    INVALID = "invalid"
    """A known action that was not valid when it was asked for."""
    MALFORMED = "malformed"
    """No action at all."""
    SUPERSEDED = "superseded"
    """A valid one, which a later one of the seat has replaced."""
    UNHEARD = "unheard"
    """One that was not looked at: older than the last, one too many, or before the beginning."""

    @classmethod
    def of(cls, code: str, unmet: Iterable[Unmet], *, heard: bool = True) -> RejectionKind:
        """What was rejected with this code and for these reasons; `heard`: it was looked at."""
        if code == ACTION_UNKNOWN or code.startswith(UNREADABLE):
            return cls.MALFORMED
        if not heard:
            return cls.UNHEARD
        superseded = any(each.kind is UnmetKind.SUPERSEDED for each in unmet)
        return cls.SUPERSEDED if superseded else cls.INVALID


@dataclass(frozen=True, slots=True)
class Rejected:
    """An action that was not taken into a step, and why.

    `action` is its sentence, or what was asked for where that is no action; `text` what was asked
    for where it is another text. `code` is that of the wire: `action/invalid`, `action/unknown`,
    `action/stale`, or another of what was not `heard`: that is not the seat's last action, and a
    `seq` of 0 says that it had none. It is `recorded` unless the seat's quota of text is used up.
    `basis` is the step on which the choice was made, if the seat says so.
    """

    player: str
    seq: int
    action: str
    unmet: tuple[Unmet, ...]
    time: float
    reasoning: str = ""
    recorded: bool = True
    code: str = ACTION_INVALID
    text: str = ""
    basis: int | None = None
    heard: bool = True

    @property
    def reasons(self) -> tuple[str, ...]:
        """What is unmet, in words."""
        return tuple(unmet.words for unmet in self.unmet)

    @property
    def kind(self) -> RejectionKind:
        """What it was."""
        return RejectionKind.of(self.code, self.unmet, heard=self.heard)


@dataclass(frozen=True, slots=True)
class RoundTripMeasured:
    """How long a message takes to a seat's participant and back, in seconds, as measured now."""

    player: str
    seconds: float
    time: float


@dataclass(frozen=True, slots=True)
class QuotaReached:
    """What somebody writes is not recorded any more: a seat's player, or (empty) spectators."""

    player: str
    time: float


@dataclass(frozen=True, slots=True)
class Said:
    """A chat message of a participant; `number` counts those of an episode from 1."""

    name: str
    player: str
    text: str
    time: float
    number: int = 0


@dataclass(frozen=True, slots=True)
class Noted:
    """A seat's text for the recording, which nobody is told; the next piece follows if `more`."""

    player: str
    topic: str
    text: str
    time: float
    more: bool = False


@dataclass(frozen=True, slots=True)
class Announced:
    """Something the operator says to everybody in the episode."""

    text: str
    time: float


@dataclass(frozen=True, slots=True)
class Moderated:
    """Somebody was sent out for good, or may not talk, or again.

    It holds for the session and for the participant, a pseudonym, under any later session.
    """

    what: Moderation
    session: str
    participant: str
    name: str
    time: float


@dataclass(frozen=True, slots=True)
class Paused:
    """Time stands still for these reasons: the first, or others than before."""

    reasons: tuple[PauseReason, ...]
    time: float


@dataclass(frozen=True, slots=True)
class Resumed:
    """Time runs again."""

    time: float


@dataclass(frozen=True, slots=True)
class Restarted:
    """Another process goes on with the episode, from its recording."""

    time: float


class Stepped(NamedTuple):
    """A step was taken: `moves` with their `attempts`, in the order in which they applied.

    `turn` is whose turn it is after it, with the turn clock; `idle` are the seats that decided to
    do nothing, with the sequence numbers of these decisions; those of them in `waits` said that
    they wait for a place or for somebody. `undone` are facts that held after
    the actions, and were then taken back by chance: `state` is without them.
    """

    step: int
    time: float
    moves: tuple[Move, ...]
    attempts: tuple[Attempt, ...]
    before: State
    state: State
    turn: str | None = None
    idle: tuple[tuple[str, int], ...] = ()
    undone: tuple[Atom, ...] = ()
    waits: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Ended:
    """The episode has ended."""

    outcome: Outcome


Event = (
    CountdownChanged
    | Started
    | RosterChanged
    | ReadinessChanged
    | Rejected
    | QuotaReached
    | Said
    | Noted
    | Announced
    | Moderated
    | Paused
    | Resumed
    | Restarted
    | RoundTripMeasured
    | Stepped
    | Ended
)
"""Whatever an episode reports."""
