"""Schema of the frames of a recording, for writing events as notes and for checking what is read.

The recorder writes the fields of a note in the order of this schema and omits optional fields at
their defaults. Bytes of a recording therefore depend on this schema.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Annotated, Any, Literal, Protocol, get_args

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from robotouille.episode.events import (
    ActionRejected,
    AnnouncementMade,
    ChatPosted,
    CountdownChanged,
    Event,
    Moderated,
    Noted,
    Paused,
    QuotaReached,
    ReadinessChanged,
    Restarted,
    Resumed,
    RoundTripMeasured,
    SeatChanged,
    Started,
)
from robotouille.episode.rules import MAX_LABELS, SeatTreatment
from robotouille.errors import RecordingError
from robotouille.protocol.states import MAX_TIMERS, why_row
from robotouille.world.grounding.actions import GroundAction
from robotouille.world.unmet import WORDED
from robotouille.world.world import State, Step, World


class Frames(Protocol):
    """Frames of a game, and its world."""

    @property
    def world(self) -> World:
        """A world of the task that was played."""
        ...

    def each_frame(self, *, states: bool = True) -> Iterator[dict[str, Any]]:
        """Yield the frames in order; without `states`, `STATE_FIELDS` may be missing."""
        ...


class FrameSource(Frames, Protocol):
    """Source of frames, such as a `Recording`."""

    def notes(self) -> Iterator[dict[str, Any]]:
        """Yield all notes in order."""
        ...

    def actions(self, frame: dict[str, Any]) -> list[GroundAction]:
        """Return the joint action of a step's frame."""
        ...

    def take(self, state: State, frame: dict[str, Any]) -> Step:
        """Take a recorded step in a state."""
        ...


STATE_FIELDS = frozenset(
    {"add", "atoms", "facts", "hash", "objects", "orders", "remove", "tables", "timers", "undone"}
)
"""Fields of frames that only describe states. In a hostile recording, they can be very long."""

# A pattern and not a list of codes: a recording of a later version may have new codes for
# unreadable messages.
CODE = r"^(action/(invalid|unknown|stale)|episode/waiting|rate/limited|message/[a-z-]+)$"
"""Codes of rejected requests that are recorded."""

Index = Annotated[int, Field(ge=0)]
MAX_MS = 10**15
"""Limit on times in milliseconds: 30,000 years, far beyond any game."""
Elapsed = Annotated[int, Field(ge=0, le=MAX_MS)]
"""Milliseconds since the start."""
Clock = Annotated[int, Field(ge=-MAX_MS, le=MAX_MS)]
"""Milliseconds on a clock."""
Utc = Annotated[int, Field(ge=-62_135_596_800_000, le=253_402_300_799_999)]
"""Milliseconds since 1970, in the years 1 to 9999."""
Row = Annotated[list[int], Field(min_length=1)]
# Without these limits and `MAX_TIMERS`, a few kilobytes of compressed frames could name millions
# of players and timers, and readers would visit all of them in each step.
MAX_PLAYERS = 1_000
"""Players in a list of a frame. A task has at most as many objects."""
MAX_HOLDS = 100
"""Reasons for a pause in a note."""
MAX_REASONS = 200
"""Reasons for a rejection. An action has at most 64 preconditions, and a few arguments."""
MAX_TEXT = 500_000
"""Characters of a text in a note or a move. The server accepts 8,000; runs may record more."""
Players = Field(max_length=MAX_PLAYERS)
Busy = Annotated[dict[str, int], Players]
MAX_NAME = 1_000
"""Characters of a name: of a participant, a session, an object or a reason for a pause. Readers
repeat names for each step."""
MAX_ARGUMENTS = 64
"""Name and arguments of an action."""
Text = Annotated[str, Field(max_length=MAX_TEXT)]
Name = Annotated[str, Field(max_length=MAX_NAME)]
Reasons = Annotated[list[Text], Field(max_length=MAX_REASONS)]
ObjectRow = Annotated[list[str], Field(min_length=3, max_length=3)]


class Frame(BaseModel):
    """Base of all parts of a frame. A field with a default may be absent, but never null.

    A default that its type does not permit, such as -1 for an index, only stands for absence.
    """

    model_config = ConfigDict(extra="forbid", strict=True)


class Tables(Frame):
    predicates: list[str]
    objects: list[ObjectRow]
    atoms: list[Row]


# Further fields are allowed in the task and the rules only. `Task.from_json` and `Rules` check them
# when an episode is restored; reading alone need not understand them.
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
    created: Annotated[str, Field(max_length=40)]
    task: PlayedTask
    digest: str
    seed: int
    rules: PlayedRules
    tables: Tables
    code: str = ""
    owner: str = ""
    labels: Annotated[dict[str, str], Field(max_length=MAX_LABELS)] = {}
    treatments: dict[str, SeatTreatment] = {}
    open_until: int = 0
    rematch_by: Annotated[list[Name], Field(max_length=2)] = []


OrdersRow = Annotated[list[int | list[list[int]]], Field(min_length=6, max_length=6)]
"""The orders of a shift; see `Orders.row`."""


class StateFrame(Frame):
    kind: Literal["state"]
    step: Index
    hash: str
    facts: list[Index]
    timers: Annotated[
        list[Annotated[list[str | list[int]], Field(min_length=2, max_length=2)]],
        Field(max_length=MAX_TIMERS),
    ]
    busy: Busy
    orders: OrdersRow | None = None


class RecordedMove(Frame):
    player: Name
    action: Annotated[list[Name], Field(min_length=1, max_length=MAX_ARGUMENTS)]
    seq: int
    ms: int
    basis: Index = -1
    reasoning: Text = ""


class StepFrame(Frame):
    # `default_factory`: pydantic copies a literal empty list with `deepcopy`, for every step.
    kind: Literal["step"]
    step: Annotated[int, Field(ge=1)]
    t: Elapsed
    late: Elapsed = 0
    moves: Annotated[list[RecordedMove], Players]
    idle: list[Annotated[list[str | int], Field(min_length=2, max_length=2)]] = Field(
        default_factory=list, max_length=MAX_PLAYERS
    )
    waits: list[str] = Field(default_factory=list, max_length=MAX_PLAYERS)
    undone: list[Annotated[list[str], Field(min_length=1)]] = Field(default_factory=list)
    unmet: dict[str, Reasons] = Field(default_factory=dict, max_length=MAX_PLAYERS)
    add: list[Index] = Field(default_factory=list)
    remove: list[Index] = Field(default_factory=list)
    timers: dict[str, list[int] | None] = Field(default_factory=dict, max_length=MAX_TIMERS)
    busy: Busy = Field(default_factory=dict)
    orders: OrdersRow | None = None
    objects: list[ObjectRow] = Field(default_factory=list)
    atoms: list[Row] = Field(default_factory=list)
    hash: str = ""


class RecordedTally(Frame):
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


class RecordedScore(Frame):
    points: int
    served: Index
    expired: Index


class RecordedOutcome(Frame):
    reason: str
    steps: int
    seconds: Annotated[float, Field(ge=0, le=MAX_MS / 1000)]
    detail: str
    seats: Annotated[list[RecordedTally], Players]
    score: RecordedScore | None = None


class Footer(Frame):
    kind: Literal["footer"]
    outcome: RecordedOutcome
    utc_ms: Utc = 0
    clock_ms: Clock = 0


# Notes


class NoteFields(Frame):
    """Base of all notes. `t`: milliseconds since the start of the game."""

    note: str
    t: int


class DatedNote(NoteFields):
    """Base of the notes with the time of day and of the server's clock.

    Before the start of the game, `t` is 0, so these are the only times of a note.
    """

    utc_ms: Utc = 0
    clock_ms: Clock = 0


class RosterNote(DatedNote):
    note: Literal["roster"]
    player: Name
    name: Name
    kind: Name
    present: bool
    taken: bool
    controller: Name
    session: Name
    participant: Name
    generation: int
    why: Name = ""
    agent: Annotated[str, Field(max_length=200)] = ""


class ReadyNote(DatedNote):
    note: Literal["ready"]
    player: Text
    ready: bool


class RecordedWhy(Frame):
    kind: Text
    predicate: Text = ""
    objects: list[str] = []
    expected: bool = True


class RejectedNote(NoteFields):
    note: Literal["rejected"]
    player: Text
    seq: int
    action: Text
    reasons: Reasons
    why: Annotated[list[RecordedWhy], Field(max_length=MAX_REASONS)] = []
    code: Annotated[str, Field(pattern=CODE)] = "action/invalid"
    text: Text = ""
    basis: Index = -1
    reasoning: Text = ""
    heard: bool = True


class QuotaNote(NoteFields):
    note: Literal["quota"]
    player: Text


class SaidNote(NoteFields):
    note: Literal["said"]
    name: Text
    player: Text
    text: Text
    intent: str = ""
    target: str = ""


class NotedNote(NoteFields):
    note: Literal["noted"]
    player: Text
    topic: Text
    text: Text
    more: bool = False


class CountdownNote(DatedNote):
    note: Literal["countdown"]
    ms: int = -1


class StartedNote(DatedNote):
    note: Literal["started"]


class AnnouncedNote(NoteFields):
    note: Literal["announced"]
    text: Text


class ModeratedNote(NoteFields):
    note: Literal["moderated"]
    what: Literal["banned", "muted", "unmuted"]
    session: Text
    participant: Text
    name: Text


class PausedNote(DatedNote):
    note: Literal["paused"]
    holds: Annotated[list[Name], Field(max_length=MAX_HOLDS)]


class ResumedNote(DatedNote):
    note: Literal["resumed"]


class RestartedNote(DatedNote):
    note: Literal["restarted"]


class RoundTripNote(NoteFields):
    note: Literal["round_trip"]
    player: Text
    ms: Annotated[float, Field(allow_inf_nan=False)]


NOTES: Mapping[type, type[NoteFields]] = {
    SeatChanged: RosterNote,
    ReadinessChanged: ReadyNote,
    ActionRejected: RejectedNote,
    ChatPosted: SaidNote,
    Noted: NotedNote,
    QuotaReached: QuotaNote,
    AnnouncementMade: AnnouncedNote,
    Moderated: ModeratedNote,
    CountdownChanged: CountdownNote,
    Started: StartedNote,
    Paused: PausedNote,
    Resumed: ResumedNote,
    Restarted: RestartedNote,
    RoundTripMeasured: RoundTripNote,
}
"""The note that records each event. Other events have frames of their own."""

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


class NotesFrame(Frame):
    kind: Literal["notes"]
    notes: Annotated[list[Note], Field(min_length=1)]


_frames: TypeAdapter[Any] = TypeAdapter(
    Annotated[Header | StateFrame | StepFrame | NotesFrame | Footer, Field(discriminator="kind")]
)


def check_frame(frame: dict[str, Any], number: int) -> None:
    """Raise RecordingError with the name of the first invalid field, if there is one."""
    try:
        _frames.validate_python(frame)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        field = ".".join(str(part) for part in first["loc"])
        raise RecordingError(f"frame {number}: {field}: {first['msg']}") from None


# Writing


def milliseconds(seconds: float) -> int:
    """Return a time as recordings have it."""
    return round(seconds * 1000)


def _why(event: ActionRejected) -> list[dict[str, Any]]:
    # Reasons that are only text have nothing to add to `reasons`.
    if all(unmet.kind in WORDED for unmet in event.unmet):
        return []
    return [why_row(unmet) for unmet in event.unmet]


# All other fields are copied by name, so adding a field to an event and to its note is enough to
# record it.
_COMPUTED: Mapping[type, Callable[[Any], dict[str, Any]]] = {
    ActionRejected: lambda event: {"why": _why(event)},
    CountdownChanged: lambda event: (
        {"ms": -1 if event.seconds is None else milliseconds(event.seconds)}
    ),
    Paused: lambda event: {"holds": event.reasons},
    RoundTripMeasured: lambda event: {"ms": round(event.seconds * 1000, 1)},
}
"""Fields that differ from the event's attribute of the same name."""

_FIELDS = {
    model: [(name, field.default) for name, field in model.model_fields.items() if name != "note"]
    for model in NOTES.values()
}
"""Fields of each note after `note`, with their defaults. Read once: pydantic's tables are slow."""
_NAMES = {model: get_args(model.model_fields["note"].annotation)[0] for model in NOTES.values()}


def note_of(event: Event, times: Mapping[str, int] = MappingProxyType({})) -> dict[str, Any]:
    """Return the note that records an event.

    Args:
        times: The fields of a `DatedNote`. Without them, the note has no time of day.
    """
    model = NOTES[type(event)]
    computed = _COMPUTED[type(event)](event) if type(event) in _COMPUTED else {}
    computed["t"] = milliseconds(getattr(event, "time", 0.0))
    if issubclass(model, DatedNote):
        computed |= {"utc_ms": None, "clock_ms": None, **times}
    note: dict[str, Any] = {"note": _NAMES[model]}
    for name, default in _FIELDS[model]:
        value = computed[name] if name in computed else getattr(event, name)
        # Omitted defaults keep recordings small, and allow a later version to add optional fields
        # without a new format version (docs/decisions/0030).
        if value is not None and value != default:
            note[name] = value
    return note
