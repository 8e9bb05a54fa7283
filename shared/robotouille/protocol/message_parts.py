"""What messages of the wire protocol are made of: their base, types of fields, and parts."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema, with_config
from typing_extensions import TypedDict

from robotouille.episode.events import Reason
from robotouille.episode.lifecycle import Controller, Phase
from robotouille.episode.pauses import PauseReason
from robotouille.episode.rules import PRINTABLE, Absence, Chat, Clock
from robotouille.world.unmet import Unmet, UnmetKind

__all__ = [
    "ByValue",
    "EpisodeInfo",
    "FromServer",
    "Identifier",
    "Kind",
    "Known",
    "Labels",
    "Message",
    "NamedAction",
    "OutcomeRow",
    "Pause",
    "Position",
    "Ref",
    "RulesRow",
    "SeatAnswer",
    "SeatInfo",
    "Seen",
    "TallyRow",
    "Token",
    "View",
    "Why",
]

Identifier = Annotated[str, Field(min_length=1, max_length=64)]
Token = Annotated[str, Field(min_length=1, max_length=2000)]
Position = Annotated[int, Field(ge=0, le=2**53)]
Ref = Annotated[int, Field(ge=0, le=2**31 - 1)]
Kind = Literal["human", "bot", "model"]
View = Literal["state", "text", "both"]
LabelName = Annotated[str, Field(min_length=1, max_length=64, pattern=PRINTABLE)]
LabelValue = Annotated[str, Field(min_length=1, max_length=200, pattern=PRINTABLE)]
Labels = Annotated[dict[LabelName, LabelValue], Field(max_length=16)]
"""What an episode belongs to, in words of a study: its condition, pair, round."""

E = TypeVar("E", bound=StrEnum)
ByValue = Annotated[E, Field(strict=False)]
"""A member of an enumeration, which comes as its value."""
Known = Annotated[
    ByValue[E] | str, Field(union_mode="left_to_right"), WithJsonSchema({"type": "string"})
]
"""A member of an enumeration if it is one that this version knows, else the text as it came."""


class Message(BaseModel):
    """Base of all messages: immutable, typed strictly, unknown fields refused, numbers finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class FromServer(Message):
    """What a server says: fields that only a newer one knows are left out."""

    model_config = ConfigDict(extra="ignore")


OPEN = ConfigDict(extra="allow", strict=True, allow_inf_nan=False)
"""Of rows that a newer server may have more fields in."""


class Seen(Message):
    """How much of an episode a client has: the step of its state, and its chat messages. With
    `stale` its state is not good any more, and it needs a whole picture."""

    episode: Identifier
    step: Annotated[int, Field(ge=0, le=2**53)] = 0
    said: Annotated[int, Field(ge=0, le=2**53)] = 0
    stale: bool = False


class NamedAction(Message):
    """An action by name and arguments, e.g. `move` of `robot1`, `table1`, `table2`."""

    name: Identifier
    args: Annotated[list[Identifier], Field(max_length=16)] = []


class SeatInfo(FromServer):
    """A seat and who plays it; `name` is empty while it is free.

    `controller` moves it at present: its participant (`human`, `bot`, `model`), nobody (`absent`)
    or a bot meanwhile (`stand-in`). Before the beginning, it waits for those who are not `ready`.
    `latency_ms` is what a message takes to the participant and back, to 50 ms: 0 while that is
    less, or not measured.
    """

    player: Identifier
    name: str = ""
    kind: str = ""
    present: bool = False
    controller: Known[Controller] = Controller.FREE
    acted: int = 0
    rejected: int = 0
    ready: bool = True
    latency_ms: int = 0


class Why(FromServer):
    """A reason for which an action was rejected, as a value; its words are in `reasons` (or
    `unmet`) at the same place."""

    kind: Known[UnmetKind]
    predicate: str = ""
    objects: list[str] = []
    expected: bool = True

    @classmethod
    def of(cls, unmet: Unmet) -> Why:
        """What goes with the words of a reason."""
        return cls(
            kind=unmet.kind,
            predicate=unmet.predicate,
            objects=list(unmet.objects),
            expected=unmet.expected,
        )

    def value(self, words: str) -> Unmet:
        """The reason with its words; a kind that a newer server knows is another to us."""
        kind = self.kind if isinstance(self.kind, UnmetKind) else UnmetKind.OTHER
        return Unmet(kind, words, self.predicate, tuple(self.objects), self.expected)


class Pause(FromServer):
    """Why the game stands still, and the seconds after which that ends by itself."""

    reason: Known[PauseReason]
    left: float | None = None


@with_config(OPEN)
class RulesRow(TypedDict, total=False):
    """The rules of an episode, as `Rules` has them; a newer server may have more."""

    clock: Known[Clock]
    step_rate: float
    move_budget: float | None
    max_steps: int
    thinking: str
    grace: float
    absence: Known[Absence]
    stand_in: str
    open_for: float
    countdown: float
    chat: Known[Chat]
    phrases: list[str]


@with_config(OPEN)
class TallyRow(TypedDict, total=False):
    """What one seat did over an episode. Each step counts as one of these: its participant's
    action was applied (`acted`); it could not act (`busy`); it asked for something that was refused
    or lost in the step, or it was another's turn (`waiting`); it could act and did nothing
    (`idle`); nobody moved it (`away`); a stand-in did (`substituted`). `rejected` is all that was
    asked for and not done; `invalid` and `malformed` are part of it. `said` are chat messages."""

    player: str
    acted: int
    busy: int
    waiting: int
    idle: int
    away: int
    substituted: int
    rejected: int
    invalid: int
    malformed: int
    said: int


@with_config(OPEN)
class OutcomeRow(TypedDict, total=False):
    """How an episode ended, as `Outcome.to_json` has it."""

    reason: Known[Reason]
    steps: int
    seconds: float
    detail: str
    seats: list[TallyRow]


class EpisodeInfo(FromServer):
    """An episode as the lobby lists it.

    `closes` are the seconds until it is closed if nobody comes, where that was asked for. `reason`
    and `detail` say how it ended, if it has; `created` is when it was opened (UTC).
    """

    episode: Identifier
    code: Identifier
    task: str
    clock: Known[Clock]
    phase: Known[Phase]
    step: int
    max_steps: int
    seats: list[SeatInfo]
    spectators: int = 0
    labels: dict[str, str] = {}
    created: str = ""
    closes: float | None = None
    reason: str = ""
    detail: str = ""


class SeatAnswer(FromServer):
    """What became of the last action of one of one's seats: the `seq`, taken in `step` or rejected
    for `reasons`. A `seq` of 0: none was decided so far."""

    seat: Identifier
    seq: int = 0
    step: int = 0
    reasons: list[str] = []
