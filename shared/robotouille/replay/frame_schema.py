"""The frames of a recording as schemas: what a reader may rely on, and all that there may be. The
task and the rules are as free here as their own schemas are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal, Protocol

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from robotouille.episode.rules import SeatTreatment
from robotouille.errors import RecordingError
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.world import State, Step, World

__all__ = ["FrameSource", "check_frame"]


class FrameSource(Protocol):
    """What has frames: a `Recording`."""

    @property
    def world(self) -> World:
        """A world of the task that was played."""
        ...

    def each_frame(self) -> Iterator[dict[str, Any]]:
        """The frames in order."""
        ...

    def notes(self) -> Iterator[dict[str, Any]]:
        """All notes in order."""
        ...

    def actions(self, frame: dict[str, Any]) -> list[GroundAction]:
        """The joint action of a step's frame."""
        ...

    def take(self, state: State, frame: dict[str, Any]) -> Step:
        """Take a recorded step in a state."""
        ...


CODE = r"^(action/(invalid|unknown|stale)|episode/waiting|rate/limited|message/[a-z-]+)$"
"""Codes of what is rejected."""

Index = Annotated[int, Field(ge=0)]
Row = Annotated[list[int], Field(min_length=1)]
ObjectRow = Annotated[list[str], Field(min_length=3, max_length=3)]


class Frame(BaseModel):
    """Whatever has a default may be absent; nothing may be null instead."""

    model_config = ConfigDict(extra="forbid", strict=True)


class Tables(Frame):
    predicates: list[str]
    objects: list[ObjectRow]
    atoms: list[Row]


class PlayedTask(Frame):
    model_config = ConfigDict(extra="allow", strict=True)

    name: str
    domain: dict[str, Any]
    problem: dict[str, Any]
    timing: str


class PlayedRules(Frame):
    model_config = ConfigDict(extra="allow", strict=True)

    clock: str
    max_steps: int


class Header(Frame):
    kind: Literal["header"]
    software: str
    episode: str
    created: str
    task: PlayedTask
    digest: str
    seed: int
    rules: PlayedRules
    tables: Tables
    code: str = ""
    owner: str = ""
    labels: dict[str, str] = {}
    treatments: dict[str, SeatTreatment] = {}
    open_until: int = 0


class StateFrame(Frame):
    kind: Literal["state"]
    step: Index
    hash: str
    facts: list[Index]
    timers: list[Annotated[list[str | list[int]], Field(min_length=2, max_length=2)]]
    busy: dict[str, int]


class RecordedMove(Frame):
    player: str
    action: Annotated[list[str], Field(min_length=1)]
    seq: int
    ms: int
    basis: Index = 0
    reasoning: str = ""


class RosterNote(Frame):
    note: Literal["roster"]
    t: int
    player: str
    name: str
    kind: str
    present: bool
    taken: bool = True
    controller: str = ""
    session: str = ""
    participant: str = ""
    generation: int = 0
    why: str = ""


class ReadyNote(Frame):
    note: Literal["ready"]
    t: int
    player: str
    ready: bool


class RecordedWhy(Frame):
    kind: str
    predicate: str = ""
    objects: list[str] = []
    expected: bool = True


class RejectedNote(Frame):
    note: Literal["rejected"]
    t: int
    player: str
    seq: int
    action: str
    reasons: list[str]
    why: list[RecordedWhy] = []
    code: Annotated[str, Field(pattern=CODE)] = "action/invalid"
    text: str = ""
    basis: Index = 0
    reasoning: str = ""
    heard: bool = True


class QuotaNote(Frame):
    note: Literal["quota"]
    t: int
    player: str


class SaidNote(Frame):
    note: Literal["said"]
    t: int
    name: str
    player: str
    text: str


class NotedNote(Frame):
    note: Literal["noted"]
    t: int
    player: str
    topic: str
    text: str
    more: bool = False


class CountdownNote(Frame):
    note: Literal["countdown"]
    t: int
    ms: int = 0
    utc_ms: int = 0


class StartedNote(Frame):
    note: Literal["started"]
    t: int
    utc_ms: int = 0


class AnnouncedNote(Frame):
    note: Literal["announced"]
    t: int
    text: str


class ModeratedNote(Frame):
    note: Literal["moderated"]
    t: int
    what: Literal["banned", "muted", "unmuted"]
    session: str
    participant: str
    name: str


class PausedNote(Frame):
    note: Literal["paused"]
    t: int
    holds: list[str]


class ResumedNote(Frame):
    note: Literal["resumed"]
    t: int
    utc_ms: int = 0


class RestartedNote(Frame):
    note: Literal["restarted"]
    t: int
    utc_ms: int = 0


class RoundTripNote(Frame):
    note: Literal["round_trip"]
    t: int
    player: str
    ms: float


Note = Annotated[
    RosterNote
    | ReadyNote
    | RejectedNote
    | SaidNote
    | NotedNote
    | QuotaNote
    | AnnouncedNote
    | ModeratedNote
    | CountdownNote
    | StartedNote
    | PausedNote
    | ResumedNote
    | RestartedNote
    | RoundTripNote,
    Field(discriminator="note"),
]


class StepFrame(Frame):
    # Made anew by a function: pydantic would copy an empty list with `deepcopy`, for every step.
    kind: Literal["step"]
    step: Annotated[int, Field(ge=1)]
    t: int
    moves: list[RecordedMove]
    idle: list[Annotated[list[str | int], Field(min_length=2, max_length=2)]] = Field(
        default_factory=list
    )
    waits: list[str] = Field(default_factory=list)
    undone: list[Annotated[list[str], Field(min_length=1)]] = Field(default_factory=list)
    unmet: dict[str, list[str]] = Field(default_factory=dict)
    add: list[Index] = Field(default_factory=list)
    remove: list[Index] = Field(default_factory=list)
    timers: dict[str, list[int] | None] = Field(default_factory=dict)
    busy: dict[str, int] = Field(default_factory=dict)
    objects: list[ObjectRow] = Field(default_factory=list)
    atoms: list[Row] = Field(default_factory=list)
    hash: str = ""


class RecordedTally(Frame):
    player: str
    acted: int = 0
    busy: int = 0
    waiting: int = 0
    idle: int = 0
    away: int = 0
    substituted: int = 0
    rejected: int
    invalid: int = 0
    malformed: int = 0
    said: int = 0
    applied: int = 0


class RecordedOutcome(Frame):
    reason: str
    steps: int
    seconds: float
    detail: str = ""
    seats: list[RecordedTally] = []


class Footer(Frame):
    kind: Literal["footer"]
    outcome: RecordedOutcome


class NotesFrame(Frame):
    kind: Literal["notes"]
    notes: list[Note]


_frames: TypeAdapter[Any] = TypeAdapter(
    Annotated[Header | StateFrame | StepFrame | NotesFrame | Footer, Field(discriminator="kind")]
)


def check_frame(frame: dict[str, Any], number: int) -> None:
    """RecordingError names the field of a frame that is not as it must be."""
    try:
        _frames.validate_python(frame)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        raise RecordingError(f"frame {number}: {field}: {first['msg']}") from None
