"""Parts of messages in both directions: base classes, field types and nested objects.

Enumerations from servers are read leniently (`Known`): a value from a newer server stays a plain
string.
"""

from __future__ import annotations

import re
from enum import StrEnum
from typing import Annotated, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    WithJsonSchema,
    with_config,
)
from typing_extensions import TypedDict

from robotouille.episode.events import Reason
from robotouille.episode.lifecycle import Absence, Controller, PauseReason, Phase
from robotouille.episode.rules import MAX_LABELS, PRINTABLE, Chat, Clock
from robotouille.visible_text import plain_text, visible_text
from robotouille.world.unmet import Unmet, UnmetKind

PROTOCOL_VERSION = 1

Identifier = Annotated[str, Field(min_length=1, max_length=64)]
Token = Annotated[str, Field(min_length=1, max_length=2000)]
NodeAddress = Annotated[str, Field(min_length=1, max_length=300)]
# JSON numbers are doubles in many languages, which are exact up to 2**53.
Position = Annotated[int, Field(ge=0, le=2**53)]
Ref = Annotated[
    Annotated[int, Field(ge=0, le=2**31 - 1)] | None,
    Field(description="Request number chosen by the client; the answer or error repeats it."),
]
# Clients keep these texts of a server, and a hostile server could fill their memory.
ShownName = Annotated[str, Field(max_length=64)]
"""Name in a server's message, possibly empty."""
ChatText = Annotated[str, Field(max_length=500)]
MAX_NOTICE = 2000
NoticeText = Annotated[str, Field(max_length=MAX_NOTICE)]
MAX_REASONS, MAX_REASON = 64, 4000


def _shortened(text: str) -> str:
    return text if len(text) <= MAX_REASON else f"{text[:MAX_REASON]}…"


# Programs print these texts. They are cut and not refused, because some repeat what a client sent.
ReasonText = Annotated[str, AfterValidator(_shortened)]
ReasonTexts = Annotated[list[ReasonText], AfterValidator(lambda texts: texts[:MAX_REASONS])]
Kind = Literal["human", "bot", "model"]
View = Literal["state", "text", "both"]
LabelName = Annotated[str, Field(min_length=1, max_length=64, pattern=PRINTABLE)]
LabelValue = Annotated[str, Field(min_length=1, max_length=200, pattern=PRINTABLE)]
Labels = Annotated[dict[LabelName, LabelValue], Field(max_length=MAX_LABELS)]
"""Labels that a study attaches to an episode, such as its condition, pair or round."""

# A line end could forge a line of another participant, and a NUL cannot be stored in PostgreSQL.
_LINE_ENDS = re.compile(r"[\t\n\v\f\r\x1c-\x1e\x85\u2028\u2029]+")


def one_line(text: str) -> str:
    """Return a text without invisible characters; line ends become spaces.

    Raises:
        ValueError: Nothing is left.
    """
    # The usual case, without the searches.
    if text.isascii() and text.isprintable() and not text.isspace():
        return text
    shown = visible_text(_LINE_ENDS.sub(" ", text))
    if not shown:
        raise ValueError("has no visible character")
    return shown


Line = AfterValidator(one_line)
PlainText = AfterValidator(plain_text)

E = TypeVar("E", bound=StrEnum)
ByValue = Annotated[E, Field(strict=False)]
"""Enumeration member, sent as its value."""
Known = Annotated[
    ByValue[E] | ShownName, Field(union_mode="left_to_right"), WithJsonSchema({"type": "string"})
]
"""Enumeration member if this version knows the value, otherwise the text as received."""


class Message(BaseModel):
    """Base of all messages: immutable, strictly typed, without unknown fields or NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


# Only servers refuse unknown fields: a misspelled option of a client must not pass unnoticed, but
# an older client has to understand a newer server.
class FromServer(Message):
    """Base of server messages. Unknown fields, from a newer server, are ignored."""

    model_config = ConfigDict(extra="ignore")


OPEN = ConfigDict(extra="allow", strict=True, allow_inf_nan=False)
"""Configuration of objects to which a newer server may add fields."""


class Seen(Message):
    """The part of an episode that a reconnecting client already has."""

    episode: Identifier = Field(description="The episode's id. Any other episode is ignored.")
    step: Annotated[int, Field(ge=0, le=2**53)] = Field(
        default=0, description="The step of the client's last state."
    )
    said: Annotated[int, Field(ge=0, le=2**53)] = Field(
        default=0, description="The highest `number` of a chat message received."
    )
    stale: bool = Field(
        default=False,
        description="True if the client's state is unusable, for example after a gap. The server "
        "then sends a snapshot instead of deltas.",
    )


class NamedAction(Message):
    """An action by name and arguments."""

    name: Identifier = Field(description="The action's name in the domain, such as `move`.")
    args: Annotated[list[Identifier], Field(max_length=16)] = Field(
        default=[], description="The arguments, the acting player first."
    )


class SeatInfo(FromServer):
    """A seat and the participant who plays it."""

    player: Identifier = Field(description="The player that this seat moves, such as `robot1`.")
    name: ShownName = Field(
        default="", description="The participant's name; empty if the seat is free."
    )
    kind: ShownName = Field(
        default="",
        description="The participant's kind: `human`, `bot` or `model`; empty if the seat is free.",
    )
    present: bool = Field(default=False, description="True if the participant is connected.")
    controller: Known[Controller] = Field(
        default=Controller.FREE,
        description="Controller of the seat now: `human`, `bot` or `model` for the participant, "
        "`substitute` for a bot that plays for an absent participant, `absent` for nobody; empty "
        "if the seat is free.",
    )
    acted: int = Field(
        default=0,
        description="Number of steps in which the participant's action was applied. Actions of a "
        "substitute do not count.",
    )
    rejected: int = Field(
        default=0, description="Number of the participant's actions that were rejected."
    )
    ready: bool = Field(
        default=True,
        description="True if the seat is ready for the start; always true after the start.",
    )
    latency_ms: int = Field(
        default=0,
        description="Round-trip time to the participant in milliseconds, rounded to 50. 0 if it "
        "is below 50 or not measured, or if the participant is away.",
    )


class Why(FromServer):
    """A reason for a rejection, as data. `reasons` (or `unmet`) has its text at the same index."""

    kind: Known[UnmetKind] = Field(
        description="`condition`: `predicate` of `objects` is not as `expected`. `missing`: an "
        "object does not exist. `busy`: the player cannot act yet. `acted`: the player has already "
        "acted in this step. `turn`: it is another player's turn. `seat`: the action moves another "
        "seat's player. `superseded`: a later action replaced this one. `stale`: the "
        "action is outdated. `unknown`: there is no such action. `other`: see the text. "
        "Treat unknown values as `other`."
    )
    predicate: str = Field(default="", description="The unmet predicate, if `kind` is `condition`.")
    objects: list[str] = Field(default=[], description="The objects concerned.")
    expected: bool = Field(
        default=True, description="The truth value that the precondition requires."
    )

    @classmethod
    def of(cls, unmet: Unmet) -> Why:
        """Return the message part for an unmet condition, without its text."""
        return cls(
            kind=unmet.kind,
            predicate=unmet.predicate,
            objects=list(unmet.objects),
            expected=unmet.expected,
        )

    def value(self, words: str) -> Unmet:
        """Return the unmet condition with its text. An unknown kind becomes `OTHER`."""
        kind = self.kind if isinstance(self.kind, UnmetKind) else UnmetKind.OTHER
        return Unmet(kind, words, self.predicate, tuple(self.objects), self.expected)


class Pause(FromServer):
    """The reason for which an episode is paused."""

    reason: Known[PauseReason] = Field(
        description="`operator`, `storage`, `restart`, `absence` or `deserted`."
    )
    left: float | None = Field(
        default=None,
        description="Seconds until the pause ends by itself; null if that is not known.",
    )


@with_config(OPEN)
# A typed dictionary and not a model: clients read a few values of it, and every snapshot has one.
class RulesRow(TypedDict, total=False):
    """The rules of an episode. A newer server may send more of them."""

    clock: Annotated[Known[Clock], Field(description="`turn`, `lockstep` or `realtime`.")]
    step_rate: Annotated[float, Field(description="Steps per second in real time.")]
    move_budget: Annotated[
        float | None, Field(description="Seconds allowed for one decision; null: no limit.")
    ]
    max_steps: Annotated[int, Field(description="The step limit.")]
    thinking: Annotated[
        str, Field(description="Cost of thinking in real time: `wall` or `declared`.")
    ]
    grace: Annotated[
        float, Field(description="Seconds for which an absent participant keeps the seat.")
    ]
    absence: Annotated[Known[Absence], Field(description="`wait`, `pause`, `bot` or `end`.")]
    substitute: Annotated[
        str, Field(description="Bot that plays for absent participants: `planner` or `random`.")
    ]
    open_for: Annotated[
        float, Field(description="Seconds for which the episode waits for its first participant.")
    ]
    countdown: Annotated[float, Field(description="Seconds of countdown before the start.")]
    chat: Annotated[Known[Chat], Field(description="`free`, `signals`, `phrases` or `off`.")]
    phrases: Annotated[
        list[str], Field(description="The permitted chat messages, if `chat` is `phrases`.")
    ]
    sight: Annotated[int, Field(description="Number of tiles that players see.")]
    sight_blocked: Annotated[
        bool, Field(description="True if stations hide from players what is behind them.")
    ]


@with_config(OPEN)
class TallyRow(TypedDict, total=False):
    """Counts for one seat over an episode.

    Each step counts once, in `acted`, `busy`, `waiting`, `idle`, `away` or `substituted`.
    """

    player: Annotated[str, Field(description="The seat's player.")]
    acted: Annotated[int, Field(description="Steps in which the participant's action applied.")]
    busy: Annotated[int, Field(description="Steps in which the player could not act.")]
    waiting: Annotated[
        int,
        Field(
            description="Steps without an action because it was another seat's turn, the "
            "participant declared a wait, or its request was rejected. 0 for a seat with "
            "`shown_as`, whose waiting steps count as idle."
        ),
    ]
    idle: Annotated[int, Field(description="Steps in which the player could act and did not.")]
    away: Annotated[int, Field(description="Steps in which nobody moved the seat.")]
    substituted: Annotated[int, Field(description="Steps in which a substitute moved the seat.")]
    rejected: Annotated[int, Field(description="Actions that were rejected.")]
    invalid: Annotated[
        int, Field(description="Rejected actions whose preconditions did not hold on arrival.")
    ]
    malformed: Annotated[
        int, Field(description="Rejected actions that did not name an existing action.")
    ]
    said: Annotated[int, Field(description="Chat messages sent.")]


@with_config(OPEN)
class ScoreRow(TypedDict, total=False):
    """Result of a shift."""

    points: Annotated[int, Field(description="The score; it can be negative.")]
    served: Annotated[int, Field(description="Orders served.")]
    expired: Annotated[int, Field(description="Orders that expired.")]


@with_config(OPEN)
class OutcomeRow(TypedDict, total=False):
    """The way in which an episode ended."""

    reason: Annotated[
        Known[Reason],
        Field(description="`goal`, `shift_over`, `step_limit`, `abandoned` or `aborted`."),
    ]
    steps: Annotated[int, Field(description="Steps taken.")]
    seconds: Annotated[float, Field(description="Duration in seconds.")]
    detail: Annotated[str, Field(description="Explanation for people, possibly empty.")]
    seats: Annotated[list[TallyRow], Field(description="Counts for each seat, in seat order.")]
    score: Annotated[ScoreRow, Field(description="The result, if the task is a shift.")]


class WorkerAddress(FromServer):
    """The address of one of a server's processes."""

    port: int = Field(description="The process's port on the same host.")
    url: str = Field(default="", description="The address to connect to instead of `port`, if set.")


class EpisodeInfo(FromServer):
    """An episode in the answer to `list`."""

    episode: Identifier = Field(description="The episode's id.")
    code: Identifier = Field(description="The code to share with participants.")
    task: str = Field(description="The task's name.")
    clock: Known[Clock] = Field(description="`turn`, `lockstep` or `realtime`.")
    phase: Known[Phase] = Field(description="`waiting`, `running`, `paused` or `ended`.")
    step: int = Field(description="Number of steps taken.")
    max_steps: int = Field(description="The step limit.")
    seats: list[SeatInfo] = Field(description="The seats, in the order of the task's players.")
    spectators: int = Field(default=0, description="Number of spectators.")
    sight: int | None = Field(
        default=None, description="Number of tiles that players see; null: any number."
    )
    sight_blocked: bool = Field(
        default=False, description="True if stations hide from players what is behind them."
    )
    labels: dict[str, str] = Field(
        default={}, description="The episode's labels; only for its creator and for operators."
    )
    created: str = Field(
        default="",
        description="Time of creation in UTC; sent with labels and for episodes with `open_for`.",
    )
    closes: float | None = Field(
        default=None,
        description="Seconds until the episode closes if nobody joins; null after the first "
        "`joined`, or without `open_for`.",
    )
    reason: str = Field(default="", description="The outcome's reason; empty before the end.")
    detail: str = Field(default="", description="The outcome's explanation for people.")

    @property
    def limits_sight(self) -> bool:
        """True if players see a part of the kitchen."""
        return self.sight is not None or self.sight_blocked


class SeatAnswer(FromServer):
    """The result of a seat's last decided action, for clients that play several seats."""

    seat: Identifier = Field(description="The seat.")
    seq: int = Field(
        default=0, description="Sequence number of the last decided action; 0 before the first."
    )
    step: int = Field(default=0, description="The step in which it was decided.")
    reasons: list[str] = Field(
        default=[], description="Reasons for its rejection; empty if it was applied."
    )
