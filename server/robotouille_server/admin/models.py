"""What the operator's HTTP API answers and takes: the shapes of its JSON."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

__all__ = [
    "AlertRow",
    "AnnounceRequest",
    "AudienceRow",
    "Done",
    "EndRequest",
    "EpisodeCounts",
    "EpisodeDetail",
    "EpisodeRow",
    "KickRequest",
    "Lateness",
    "Line",
    "MuteRequest",
    "NoRequest",
    "Overview",
    "PauseState",
    "Problem",
    "Rates",
    "RecordingFault",
    "RecordingPage",
    "RecordingRow",
    "RecordingState",
    "Result",
    "SeatRow",
    "ServerInfo",
    "Totals",
]


class ResponseModel(BaseModel):
    """Part of an answer."""

    model_config = ConfigDict(frozen=True)


class Problem(ResponseModel):
    """Why a request was not honoured."""

    code: str = Field(description="A stable code.")
    message: str = Field(description="The same for people; its words may change.")


class Rates(ResponseModel):
    """Messages a second over the last seconds; null until two moments have been seen."""

    received: float | None = Field(description="Messages a second from clients.")
    sent: float | None = Field(description="Messages a second to clients.")


class AudienceRow(ResponseModel):
    """Somebody who watches."""

    session: str = Field(description="Names the participant in `kick`.")
    name: str
    kind: str = Field(description="`human`, `bot` or `model`.")
    present: bool = Field(description="Whether the connection is open.")
    muted: bool = Field(False, description="Whether they may not talk; see `mute`.")
    latency_ms: float | None = Field(description="Round trip; null until it has been measured.")
    received_bytes: int = Field(description="What came from them since the server's start.")
    recorded_bytes: int = Field(description="Their chat and reasoning in the recording.")
    address: str | None = Field(description="Null unless the server keeps addresses.")


class SeatRow(ResponseModel):
    """A seat and who plays it."""

    player: str
    name: str = Field(description="Empty while the seat is free.")
    kind: str = Field(description="Who took it: `human`, `bot` or `model`; empty while free.")
    controller: str = Field(
        description="Who moves it now: `human`, `bot`, `model`, `absent`, `stand-in`, or empty."
    )
    shown_as: str = Field("", description="The kind that others see instead; empty: the real one.")
    delay_ms: int = Field(0, description="Milliseconds for which each action is held back.")
    present: bool
    ready: bool = Field(True, description="Before the beginning: false where it waits for them.")
    muted: bool = Field(False, description="Whether they may not talk; see `mute`.")
    session: str | None = Field(description="Names the participant in `kick`; null while free.")
    latency_ms: float | None = Field(description="Round trip; null until it has been measured.")
    received_bytes: int = Field(description="What came from them since the server's start.")
    recorded_bytes: int = Field(description="Their chat and reasoning in the recording.")
    address: str | None = Field(description="Null unless the server keeps addresses.")
    acted: int = Field(description="Steps in which the participant's action was applied.")
    busy: int = Field(description="Steps in which the player was walking or working.")
    waiting: int = Field(
        description="Steps for which something was asked for and not done, or that were another's."
    )
    idle: int = Field(description="Steps in which the participant could act, and did nothing.")
    away: int = Field(description="Steps in which nobody moved the player.")
    substituted: int = Field(description="Steps in which a stand-in was in control.")
    rejected: int = Field(description="What the participant asked for, and was not done.")


class PauseState(ResponseModel):
    """Why time stands still, and for how long."""

    reason: str = Field(description="`operator`, `absence`, `storage`, `restart` or `deserted`.")
    left: float | None = Field(description="Seconds until it ends by itself; null if never.")


class RecordingState(ResponseModel):
    """The recording of an episode that is open."""

    name: str
    size: int | None = Field(description="Bytes; null while nothing has been written.")
    problem: str = Field(description="Why it cannot be written; empty where all is well.")


class Result(ResponseModel):
    """How an episode ended."""

    reason: str = Field(description="`goal`, `step_limit`, `abandoned` or `aborted`.")
    steps: int
    seconds: float
    detail: str


class EpisodeRow(ResponseModel):
    """One episode."""

    episode: str
    code: str
    task: str
    clock: str
    step_rate: float | None = Field(description="Steps a second, in real time only.")
    phase: str = Field(description="`waiting`, `running`, `paused` or `over`.")
    pause: PauseState | None
    step: int
    max_steps: int
    seats: list[SeatRow]
    spectators: int
    rates: Rates
    recording: RecordingState | None = Field(description="Null where it is not recorded.")
    problem: str = Field(description="What the operator must see; empty where all is well.")
    outcome: Result | None
    watch: str = Field(description="The command that shows it in a window.")
    labels: dict[str, str] = Field({}, description="What a study says that it belongs to.")


class Line(ResponseModel):
    """One thing that happened, in words."""

    step: int = Field(description="The step it came with or after.")
    kind: Literal["act", "reject", "say", "seat", "note"]
    who: str
    text: str
    reasons: list[str] = Field(default_factory=list, description="Why an action did nothing.")


class EpisodeDetail(EpisodeRow):
    """One episode to watch: its state in words, what happened last, and who looks on."""

    audience: list[AudienceRow]
    turn: str | None
    text: str = Field(description="The state in words, as players read it.")
    lines: list[Line] = Field(description="The last things that happened, oldest first.")


class Lateness(ResponseModel):
    """How late the steps of the last minute were, in milliseconds.

    From the histogram's buckets: each value is the upper bound of its bucket, null where it is
    beyond the last one or there were no steps.
    """

    steps: int
    p50: float | None
    p99: float | None
    p999: float | None


class EpisodeCounts(ResponseModel):
    """Episodes by phase, and how many seats are taken in all."""

    waiting: int
    running: int
    paused: int
    over: int


class Totals(ResponseModel):
    """What the whole server does."""

    connections: int
    episodes: EpisodeCounts
    steps_per_second: float
    sent_bytes_per_second: float
    received_per_second: float = Field(description="Messages a second from clients.")
    lateness: Lateness
    history: dict[str, list[float]] = Field(
        description="A value for each of the last 60 seconds, oldest first: "
        "`steps`, `bytes`, `received`."
    )
    errors: dict[str, int] = Field(description="Errors answered since the start, by code.")
    dropped: dict[str, int] = Field(description="Connections dropped by the server, by reason.")


class RecordingFault(ResponseModel):
    """Something the operator must see."""

    text: str
    episodes: int = Field(description="How many episodes have it; 0 where it is about a file.")
    episode: str = Field(description="The first of them, or empty.")
    code: str = Field(description="Its code, or empty.")


class AlertRow(ResponseModel):
    """Something that is not wrong yet, or not with one episode."""

    kind: str = Field(description="`disk`, `log`, `descriptors`, `participant` or `audit`.")
    text: str
    severity: Literal["warning", "critical"]


class ServerInfo(ResponseModel):
    """Which server this is."""

    version: str
    url: str
    uptime: float = Field(description="Seconds since this page's port was opened.")
    only: str = Field(description="The only episode that your token is for; empty for all.")


class Overview(ResponseModel):
    """Everything the page's first view shows."""

    server: ServerInfo
    totals: Totals
    alerts: list[AlertRow] = Field(description="Those that are critical first.")
    faults: list[RecordingFault]
    found: int = Field(description="How many episodes match.")
    episodes: list[EpisodeRow] = Field(description="Those in trouble first, those over last.")


class RecordingRow(ResponseModel):
    """A file in the recordings folder."""

    name: str
    size: int
    created: str = Field(description="As its header says; empty where that cannot be read.")
    task: str
    outcome: str = Field(description="`goal` … `aborted`, `live`, `unfinished` or `unreadable`.")
    steps: int | None
    episode: str | None = Field(description="The open episode that writes it.")


class RecordingPage(ResponseModel):
    """A part of the list of recordings, the newest first."""

    found: int
    recordings: list[RecordingRow]


class Done(ResponseModel):
    """A request was carried out."""

    done: str = Field(description="What happened, in words.")


class Request(BaseModel):
    """The body of a request."""

    model_config = ConfigDict(extra="forbid", strict=True)


Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=500)]
Reason = Annotated[str, StringConstraints(strip_whitespace=True, max_length=200)]


class NoRequest(Request):
    """Nothing to say: `{}`."""


class EndRequest(Request):
    """End an episode."""

    reason: Reason = Field("", description="Told to everybody in it, and recorded.")


class KickRequest(Request):
    """Remove somebody from an episode."""

    session: Annotated[str, Field(min_length=1, max_length=64)]
    reason: Reason = Field("", description="Told to whom it concerns.")


class MuteRequest(Request):
    """Take the right to talk in an episode from somebody, or give it back."""

    session: Annotated[str, Field(min_length=1, max_length=64)]
    muted: bool


class AnnounceRequest(Request):
    """Say something to everybody."""

    text: Text
