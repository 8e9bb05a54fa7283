"""Request and response bodies of the operator API."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from robotouille.protocol import messages

RANKS = 8
"""Ranks of episodes in the overview: with and without a problem, in each phase."""
MAX_OPENED = 100
"""Episodes that one request opens."""


class ResponseModel(BaseModel):
    """Part of a response body."""

    model_config = ConfigDict(frozen=True)


class Problem(ResponseModel):
    """Reason why a request was refused."""

    code: str = Field(description="A stable code.")
    message: str = Field(description="Text for people. It may change between releases.")
    field: str = Field("", description="The invalid field of the request, or empty.")


class Rates(ResponseModel):
    """Messages per second over the last seconds; null until they have been measured."""

    received: float | None = Field(description="Messages per second from clients.")
    sent: float | None = Field(description="Messages per second to clients.")


class ParticipantRow(ResponseModel):
    """Player or spectator of an episode."""

    name: str = Field(description="Empty while the seat is free.")
    kind: str = Field(description="`human`, `bot` or `model`; empty while the seat is free.")
    session: str | None = Field(description="Session id, for `kick` and `mute`; null while free.")
    present: bool = Field(description="True while the connection is open.")
    muted: bool = Field(False, description="True if the operator forbade them to chat.")
    latency_ms: float | None = Field(description="Round trip; null until it has been measured.")
    received_bytes: int = Field(description="Bytes received from them since the server's start.")
    recorded_bytes: int = Field(description="Bytes of their chat and reasoning in the recording.")
    address: str | None = Field(description="Null unless `record_addresses` is set.")


class SeatRow(ParticipantRow):
    """Seat and its participant."""

    player: str
    controller: str = Field(
        description="Current controller: `human`, `bot`, `model`, `absent`, `substitute`, or empty."
    )
    shown_as: str = Field("", description="Kind that others see instead, if any.")
    delay_ms: int = Field(0, description="Delay of each action in milliseconds.")
    ready: bool = Field(True, description="False while the episode waits for them to be ready.")
    acted: int = Field(description="Steps in which the participant's action was applied.")
    busy: int = Field(description="Steps in which the player was walking or working.")
    waiting: int = Field(
        description="Steps in which a requested action was not applied, or it was another's turn."
    )
    idle: int = Field(description="Steps in which the participant could act but did nothing.")
    away: int = Field(description="Steps without a controller.")
    substituted: int = Field(description="Steps in which a substitute was in control.")
    rejected: int = Field(description="Rejected actions of the participant.")


class PauseState(ResponseModel):
    """Reason for a pause, and how long it lasts."""

    reason: str = Field(description="`operator`, `absence`, `storage`, `restart` or `deserted`.")
    left: float | None = Field(description="Seconds until it ends by itself; null if it does not.")


class RecordingState(ResponseModel):
    """Recording of an episode on the server."""

    name: str
    size: int | None = Field(description="Bytes written so far; null once it is closed.")
    problem: str = Field(description="Reason why it cannot be written, or empty.")


class EpisodeResult(ResponseModel):
    """Outcome of an episode."""

    reason: str = Field(description="`goal`, `step_limit`, `abandoned` or `aborted`.")
    steps: int
    seconds: float
    detail: str


class EpisodeRow(ResponseModel):
    """Episode in the overview."""

    episode: str
    code: str
    task: str
    clock: str
    step_rate: float | None = Field(description="Steps per second, in real time only.")
    phase: str = Field(description="`waiting`, `running`, `paused` or `ended`.")
    pause: PauseState | None
    step: int
    max_steps: int
    seats: list[SeatRow]
    spectators: int
    rates: Rates
    recording: RecordingState | None = Field(description="Null if the episode is not recorded.")
    problem: str = Field(description="Problem that needs the operator, or empty.")
    outcome: EpisodeResult | None
    watch: str = Field(description="Command that shows the episode in a window.")
    labels: dict[str, str] = Field({}, description="Labels that a study gave the episode.")
    node: str = Field("", description="Address of the episode's node; empty without a cluster.")


class LogLine(ResponseModel):
    """Event of an episode, as text."""

    step: int = Field(description="Step with or after which it happened.")
    kind: Literal["act", "reject", "say", "seat", "note"]
    who: str
    text: str
    reasons: list[str] = Field(default_factory=list, description="Reasons for a rejected action.")


class EpisodeDetail(EpisodeRow):
    """Episode with its state as text, its spectators and recent events."""

    audience: list[ParticipantRow] = Field(description="Spectators.")
    turn: str | None
    state: dict[str, Any] = Field(
        description="State in the form of the message `snapshot`, and the `size` of the tables for "
        "reading it, which `kitchen` returns."
    )
    text: str = Field(description="State as text, as language models read it.")
    lines: list[LogLine] = Field(description="Recent events, oldest first.")


class Lateness(ResponseModel):
    """Lateness of the steps of the last minute, in milliseconds.

    Each value is the upper bound of its bucket in a histogram. It is null if there were no steps,
    or if the lateness exceeds the last bucket. In a cluster, it is that of the slowest node.
    """

    steps: int
    p50: float | None
    p99: float | None
    p999: float | None


class EpisodeCounts(ResponseModel):
    """Number of episodes in each phase."""

    waiting: int
    running: int
    paused: int
    ended: int


class Totals(ResponseModel):
    """Figures of the whole server, or of all nodes of a cluster together."""

    connections: int
    episodes: EpisodeCounts
    steps_per_second: float
    sent_bytes_per_second: float
    received_per_second: float = Field(description="Messages per second from clients.")
    lateness: Lateness
    history: dict[str, list[float]] = Field(
        description="One value for each of the last 60 seconds, oldest first: "
        "`steps`, `bytes`, `received`."
    )
    errors: dict[str, int] = Field(description="Error messages sent since the start, by code.")
    dropped: dict[str, int] = Field(description="Connections dropped by the server, by reason.")


class RecordingFault(ResponseModel):
    """Problem of recordings that needs the operator."""

    text: str
    episodes: int = Field(description="Number of affected episodes; 0 for a problem of a file.")
    episode: str = Field(description="First affected episode, or empty.")
    code: str = Field(description="Code of this episode, or empty.")
    node: str = Field("", description="Address of the node; empty without a cluster.")


class AlertRow(ResponseModel):
    """Warning about the whole server."""

    kind: str = Field(description="`disk`, `log`, `descriptors`, `participant` or `audit`.")
    text: str
    severity: Literal["warning", "critical"]
    node: str = Field("", description="Address of the node; empty without a cluster.")


class ServerInfo(ResponseModel):
    """Identity of the server."""

    version: str
    url: str
    uptime: float = Field(description="Seconds since the operator port was opened.")
    draining: bool = Field(
        False, description="True after SIGTERM, while running episodes may still end."
    )
    only: str = Field(description="The only episode that your token allows; empty for all.")
    page: str = Field("", description="Address of the page for browsers; empty if it is off.")


class NodeRow(ResponseModel):
    """Node of a cluster."""

    node: str = Field(description="Address for clients.")
    operator: str = Field(description="Address of its operator page, or empty.")
    seats: int = Field(description="Seats in its episodes that have not ended.")
    silent: float = Field(description="Seconds since its last report, which it renews each second.")
    leaving: bool = Field(description="True if it hands its episodes over and stops.")
    version: str = Field(description="Its software and version.")
    same_version: bool = Field(description="False if it differs from the node that you asked.")
    same_keys: bool = Field(description="False if it signs tokens with other keys.")
    same_tasks: bool = Field(description="False if it has other tasks of your own.")
    problem: str = Field("", description="Reason why its episodes are missing, or empty.")


class Overview(ResponseModel):
    """First view of the operator page. In a cluster, it contains all nodes that answer."""

    server: ServerInfo
    totals: Totals
    alerts: list[AlertRow] = Field(description="Warnings of the whole server, critical ones first.")
    faults: list[RecordingFault]
    found: int = Field(description="Number of matching episodes.")
    episodes: list[EpisodeRow] = Field(description="Episodes with problems first, ended ones last.")
    nodes: list[NodeRow] = Field(
        [], description="Nodes of the cluster, the one that you asked first; empty without one."
    )


class NodeOverview(Overview):
    """Part of a node in the overview of its cluster."""

    ranks: Annotated[
        list[Annotated[int, Field(ge=0)]],
        Field(
            min_length=RANKS,
            max_length=RANKS,
            description="Number of matching episodes of each rank, in the order of the list.",
        ),
    ]


class RecordingRow(ResponseModel):
    """File in the recordings folder."""

    name: str
    size: int
    created: str = Field(description="Date from the header; empty if it cannot be read.")
    task: str
    code: str = Field(description="Code of the episode; empty without one.")
    labels: dict[str, str] = Field(description="Labels of the study.")
    players: list[str] = Field(description="Names in the seats when the game began.")
    outcome: str = Field(description="`goal` … `aborted`, `live`, `unfinished` or `unreadable`.")
    steps: int | None
    episode: str | None = Field(description="Episode that still writes it, or null.")
    node: str = Field("", description="Address of another node of the cluster that has the file.")


class RecordingPage(ResponseModel):
    """Part of the list of recordings, newest first."""

    found: int
    recordings: list[RecordingRow]


class TaskRow(ResponseModel):
    """Task of an episode that the server can open."""

    name: str
    seats: list[int] = Field(description="Possible numbers of seats, the usual one first.")
    shift: bool = Field(description="True for a shift, in which guests order dishes.")


class TaskList(ResponseModel):
    """Tasks of the server, and skills of bots."""

    tasks: list[TaskRow]
    skills: list[str] = Field(description="Skills of planner bots, from low to high.")


class KitchenLook(ResponseModel):
    """Look of a task that is not shipped. Other clients request it with `get_rendering`."""

    rendering: dict[str, Any] | None = Field(None, description="Null for shipped tasks.")
    bindings: dict[str, Any] | None = None
    pictures: dict[str, str] = Field({}, description="Digests of pictures, by file name.")


class KitchenTables(ResponseModel):
    """Everything for drawing an episode, besides its changing state.

    The fields `predicates`, `objects` and `atoms` are those of the message `snapshot`.
    """

    task: dict[str, Any]
    look: KitchenLook
    size: int = Field(description="Number of facts that the tables describe.")
    predicates: list[str]
    objects: list[list[str]]
    atoms: list[list[int]]


class PictureData(ResponseModel):
    """Picture of a task that is not shipped."""

    data: str = Field(description="The file in base64.")


class SpectatorLink(ResponseModel):
    """Personal link of a spectator."""

    link: str = Field(
        description="Short token. The page's address ends with `watch#` and this token."
    )


class OpenedEpisode(ResponseModel):
    """Episode that a request or a command opened."""

    episode: str = Field(description="Id of the episode.")
    code: str = Field(description="Code for joining.")
    tokens: dict[str, str] = Field({}, description="Seat tokens by player, if requested.")
    links: dict[str, str] = Field(
        {}, description="Personal links by player, if tokens were requested."
    )

    @classmethod
    def of(cls, created: messages.Created) -> Self:
        """Return the episode of an answer to `create`."""
        return cls(**created.model_dump(include=set(cls.model_fields)))


class OpenedEpisodes(ResponseModel):
    """Answer to a request to open episodes."""

    opened: list[OpenedEpisode]
    problem: Problem | None = Field(
        None, description="Reason why the server did not open the others; null if it opened all."
    )


class Done(ResponseModel):
    """Confirmation of a change."""

    done: str = Field(description="Description of the change.")


class Request(BaseModel):
    """Body of a request."""

    # A misspelt field or a number as text would otherwise be ignored or converted silently.
    model_config = ConfigDict(extra="forbid", strict=True)


Text = Annotated[
    str,
    StringConstraints(strip_whitespace=True, min_length=1, max_length=500),
    messages.PlainText,
    Field(min_length=1),  # `PlainText` may leave nothing.
]
Reason = Annotated[str, StringConstraints(strip_whitespace=True, max_length=200), messages.Line]


class NoRequest(Request):
    """Empty body: `{}`."""


class OpenRequest(Request):
    """Body of a request to open several episodes with the same options."""

    count: Annotated[int, Field(ge=1, le=MAX_OPENED)] = 1
    create: messages.Create = messages.Create()


class EndRequest(Request):
    """Body of a request to end an episode."""

    reason: Reason = Field("", description="Sent to everyone in the episode, and recorded.")


class KickRequest(Request):
    """Body of a request to remove a participant from an episode."""

    session: Annotated[str, Field(min_length=1, max_length=64)]
    reason: Reason = Field("", description="Sent to the removed participant.")


class MuteRequest(Request):
    """Body of a request to forbid or allow chat."""

    session: Annotated[str, Field(min_length=1, max_length=64)]
    muted: bool


class AnnounceRequest(Request):
    """Body of a request to send an announcement."""

    text: Text
