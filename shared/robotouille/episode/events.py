"""Events that an episode reports, as immutable values in the order in which they happened.

The `time` of an event is in seconds since the game started, pauses included.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

from robotouille.episode.lifecycle import Controller, PauseReason
from robotouille.episode.tallies import SeatTally
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.grounding.objects import Atom
from robotouille.world.presentation.signals import Signal, signal_from
from robotouille.world.unmet import Attempt, Unmet, UnmetKind
from robotouille.world.world import State

ACTION_INVALID = "action/invalid"
"""Code for an action whose preconditions do not hold."""
ACTION_UNKNOWN = "action/unknown"
"""Code for a text that names no action."""
ACTION_STALE = "action/stale"
"""Code for an action that is outdated."""
# These four are texts and not members of `robotouille.protocol.ErrorCode`: the game's logic must
# not depend on the protocol (docs/decisions/0023).
UNREADABLE = "message/"
"""Prefix of the codes for messages that cannot be read."""


class Reason(StrEnum):
    """Reason for the end of an episode."""

    GOAL = "goal"
    SHIFT_OVER = "shift_over"
    STEP_LIMIT = "step_limit"
    ABANDONED = "abandoned"
    ABORTED = "aborted"


class Departure(StrEnum):
    """Reason for which a participant lost a seat: left, absent too long, or removed."""

    LEFT = "left"
    LOST = "lost"
    REMOVED = "removed"


class Moderation(StrEnum):
    """Operator's decision about a participant."""

    BANNED = "banned"
    MUTED = "muted"
    UNMUTED = "unmuted"


class Score(NamedTuple):
    """Result of a shift: its points, and the numbers of served and expired orders."""

    points: int
    served: int
    expired: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """The way in which an episode ended.

    `seconds` is the time since the start, pauses included; 0 if the game never started. Only
    shifts have a `score`.
    """

    reason: Reason
    steps: int
    seconds: float
    seats: tuple[SeatTally, ...]
    detail: str = ""
    score: Score | None = None

    @property
    def success(self) -> bool:
        """True if the goal was reached."""
        return self.reason is Reason.GOAL

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> Outcome:
        """Return the outcome from the values of `to_json`."""
        # An unknown count raises TypeError, which `robotouille.replay.restore` reports as a fault
        # of the recording.
        seats = tuple(SeatTally(**seat) for seat in row["seats"])
        score = Score(**row["score"]) if row.get("score") else None
        return cls(Reason(row["reason"]), row["steps"], row["seconds"], seats, row["detail"], score)

    def to_json(self) -> dict[str, Any]:
        """Return the outcome as JSON values, with seconds rounded to milliseconds."""
        row: dict[str, Any] = {
            "reason": self.reason.value,
            "steps": self.steps,
            # The time is rounded like all times in a recording, which are whole milliseconds.
            "seconds": round(self.seconds, 3),
            "detail": self.detail,
            "seats": [tally.to_json() for tally in self.seats],
        }
        if self.score is not None:
            row["score"] = self.score._asdict()
        return row


# A named tuple, because every step creates them and a frozen dataclass takes twice as long.
class PlayedMove(NamedTuple):
    """A seat's action in a step.

    `latency` is the number of seconds that the seat took to decide while it could act. `basis` is
    the step on whose state the choice was made, if known. `seq` is 0 for a substitute's action.
    """

    player: str
    action: GroundAction
    seq: int
    latency: float
    reasoning: str = ""
    basis: int | None = None


@dataclass(frozen=True, slots=True)
class CountdownChanged:
    """The countdown started with so many seconds, or stopped (None)."""

    seconds: float | None


@dataclass(frozen=True, slots=True)
class Started:
    """The game started."""

    time: float


@dataclass(frozen=True, slots=True)
class SeatChanged:
    """A participant took or lost a seat, or lost or regained the connection.

    `session` and `participant` are pseudonyms, and `generation` is that of the resume token in use.
    `agent` is the program that plays, in its own words.
    `why` is set if the participant has just lost the seat.
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
    agent: str = ""


@dataclass(frozen=True, slots=True)
class ReadinessChanged:
    """Before the start: a seat's participant became ready, or is not ready any more."""

    player: str
    ready: bool


class RejectionKind(StrEnum):
    """Kind of a request that was not taken into a step."""

    INVALID = "invalid"
    """An action whose preconditions did not hold on arrival, or that was too old."""
    MALFORMED = "malformed"
    """A text that names no action."""
    SUPERSEDED = "superseded"
    """A valid action that a later one of the seat replaced."""
    UNHEARD = "unheard"
    """A request that was not evaluated: outdated, one too many, or before the start."""

    @classmethod
    def of(cls, code: str, unmet: Iterable[Unmet], *, heard: bool = True) -> RejectionKind:
        """Return the kind of a rejection; `heard` is False for a request not evaluated."""
        # This comes before `heard`: an unreadable message was not evaluated either, but it counts
        # as a mistake of the participant.
        if code == ACTION_UNKNOWN or code.startswith(UNREADABLE):
            return cls.MALFORMED
        if not heard:
            return cls.UNHEARD
        superseded = any(each.kind is UnmetKind.SUPERSEDED for each in unmet)
        return cls.SUPERSEDED if superseded else cls.INVALID


@dataclass(frozen=True, slots=True)
class ActionRejected:
    """A request that was not taken into a step.

    Attributes:
        seq: The request's number; 0 if it had none.
        action: The action's sentence, or the requested text if it names no action.
        text: The requested text, if it differs from `action`.
        recorded: False if the seat's quota of text is used up.
        code: The error code on the wire.
        basis: The step on whose state the choice was made, if known.
        heard: False for a request that was not evaluated. The seat's last action stays the same.
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
        """The unmet conditions as text."""
        return tuple(unmet.words for unmet in self.unmet)

    @property
    def kind(self) -> RejectionKind:
        """The kind of the rejection."""
        return RejectionKind.of(self.code, self.unmet, heard=self.heard)


@dataclass(frozen=True, slots=True)
class RoundTripMeasured:
    """The round-trip time of messages to a seat's participant, in seconds."""

    player: str
    seconds: float
    time: float


@dataclass(frozen=True, slots=True)
class QuotaReached:
    """The quota of recorded text of a seat, or of the spectators (empty), is used up."""

    player: str
    time: float


@dataclass(frozen=True, slots=True)
class ChatPosted:
    """A chat message. `number` counts the messages of the episode from 1.

    A signal has an `intent`, and possibly a `target`; `text` is then its sentence.
    """

    name: str
    player: str
    text: str
    time: float
    number: int = 0
    intent: str = ""
    target: str = ""

    @property
    def signal(self) -> Signal | None:
        """The signal, or None for other messages."""
        return signal_from(self.intent, self.target)


TEAM_TOPIC = "team"
"""Topic of notes that bots send to each other."""


@dataclass(frozen=True, slots=True)
class Noted:
    """A seat's text for the recording. The next note continues it if `more`."""

    player: str
    topic: str
    text: str
    time: float
    more: bool = False


@dataclass(frozen=True, slots=True)
class AnnouncementMade:
    """A message from the operator to everybody in the episode."""

    text: str
    time: float


@dataclass(frozen=True, slots=True)
class Moderated:
    """A participant was banned, muted or unmuted, in this session and in later ones."""

    what: Moderation
    session: str
    participant: str
    name: str
    time: float


@dataclass(frozen=True, slots=True)
class Paused:
    """The game was paused, or the reasons for the pause changed."""

    reasons: tuple[PauseReason, ...]
    time: float


@dataclass(frozen=True, slots=True)
class Resumed:
    """The game resumed."""

    time: float


@dataclass(frozen=True, slots=True)
class Restarted:
    """Another process goes on with the episode from its recording."""

    time: float


# Both states are kept, because the recorder and the fan-out each need the difference. States are
# immutable, so this costs two references.
class Stepped(NamedTuple):
    """A step was taken.

    Attributes:
        moves: The moves, in the order in which they applied; `attempts` are their results.
        before: The state before the step.
        state: The state after the step and after random reversals.
        turn: The player whose turn it is now, with the turn clock.
        idle: Seats that decided to do nothing, with the sequence numbers of these decisions.
        undone: Facts that chance reversed after the actions.
        waits: Seats in `idle` that declared a wait.
        late: Seconds between `time`, at which the step was due, and the tick that took it.
    """

    step: int
    time: float
    moves: tuple[PlayedMove, ...]
    attempts: tuple[Attempt, ...]
    before: State
    state: State
    turn: str | None = None
    idle: tuple[tuple[str, int], ...] = ()
    undone: tuple[Atom, ...] = ()
    waits: tuple[str, ...] = ()
    late: float = 0.0


@dataclass(frozen=True, slots=True)
class EpisodeEnded:
    """The episode ended."""

    outcome: Outcome


Event = (
    CountdownChanged
    | Started
    | SeatChanged
    | ReadinessChanged
    | ActionRejected
    | QuotaReached
    | ChatPosted
    | Noted
    | AnnouncementMade
    | Moderated
    | Paused
    | Resumed
    | Restarted
    | RoundTripMeasured
    | Stepped
    | EpisodeEnded
)
"""Any event of an episode."""
