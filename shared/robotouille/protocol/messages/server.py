"""Messages that the server sends."""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from pydantic import Field, TypeAdapter

from robotouille.episode.lifecycle import Phase
from robotouille.protocol.error_codes import ErrorCode
from robotouille.protocol.messages.values import (
    ChatText,
    EpisodeInfo,
    FromServer,
    Identifier,
    Known,
    NodeAddress,
    NoticeText,
    OutcomeRow,
    Pause,
    ReasonText,
    ReasonTexts,
    Ref,
    RulesRow,
    SeatAnswer,
    SeatInfo,
    ShownName,
    Token,
    Why,
    WorkerAddress,
)


class Welcome(FromServer):
    """The answer to `hello`."""

    type: Literal["welcome"] = "welcome"
    ref: Ref = None
    protocol: int = Field(description="The server's protocol version.")
    server: str = Field(description="The server's software and version.")
    session: Identifier = Field(description="The participant's id.")
    resume: Token = Field(
        description="Secret token that resumes this session once, after a lost connection."
    )
    resumed: bool = Field(
        default=False, description="True if this connection continues an earlier one."
    )
    role: str = Field(description="The client's role: `operator`, `host`, `player` or `spectator`.")
    grace: float = Field(description="Seconds for which the seat of a lost connection is kept.")
    readiness: bool = Field(
        default=False, description="True if the server supports `ready`, also in `join`."
    )
    opens_limited_sight: bool = Field(
        default=False,
        description="True if players see a part of the kitchen in episodes that are opened without "
        "`sight` and `sight_blocked`.",
    )
    workers: list[WorkerAddress] = Field(
        default=[],
        description="For hosts and operators of a server with several processes: all of them. "
        "Each opens, lists and closes only its own episodes.",
    )
    nodes: Annotated[list[NodeAddress], Field(max_length=64)] = Field(
        default=[],
        description="Addresses of the other nodes of a cluster. A client that loses its node "
        "tries them.",
    )


class Episodes(FromServer):
    """The answer to `list`."""

    type: Literal["episodes"] = "episodes"
    ref: Ref = None
    episodes: list[EpisodeInfo] = Field(
        description="At most 500 episodes: waiting ones first, then running, then ended ones."
    )
    total: int = Field(default=0, description="Number of all episodes that match the request.")


class Created(FromServer):
    """The answer to `create`."""

    type: Literal["created"] = "created"
    ref: Ref = None
    episode: Identifier = Field(description="The new episode's id.")
    code: Identifier = Field(description="The code to share with participants.")
    tokens: dict[str, str] = Field(
        default={},
        description="Role tokens by player, if requested. Each is for one seat only and expires "
        "one day after `open_for`.",
    )
    links: dict[str, str] = Field(
        default={},
        description="Personal links by player, if tokens were requested: short role tokens with "
        "the episode's code. The page's address ends with `play#` and a link.",
    )


class Rendering(FromServer):
    """The answer to `get_rendering`. For shipped tasks it contains no files."""

    type: Literal["rendering"] = "rendering"
    ref: Ref = None
    rendering: dict[str, Any] | None = Field(
        default=None, description="The complete rendering file; null for a shipped task."
    )
    bindings: dict[str, Any] | None = Field(
        default=None, description="The input file; null for a shipped task."
    )
    pictures: dict[str, str] = Field(
        default={},
        description="Digests for `get_picture`, by file name. Pictures not listed are shipped.",
    )
    stars: list[int] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="Largest numbers of steps for three and for two stars, of a task with a known "
        "plan; null for a shift.",
    )


class Picture(FromServer):
    """The answer to `get_picture`."""

    type: Literal["picture"] = "picture"
    ref: Ref = None
    digest: Identifier = Field(description="The picture's digest.")
    data: str = Field(
        description="The PNG or SVG file in Base64: at most 256 KiB and 1,024 pixels per side."
    )


class Closed(FromServer):
    """The answer to `close`."""

    type: Literal["closed"] = "closed"
    ref: Ref = None
    episode: Identifier = Field(description="The episode's id.")


class Joined(FromServer):
    """The answer to `join`, and part of the answer to `hello` with `resume`."""

    type: Literal["joined"] = "joined"
    ref: Ref = None
    episode: Identifier = Field(description="The episode's id.")
    code: Identifier = Field(description="The episode's code.")
    role: str = Field(description="`player` or `spectator`.")
    seat: str | None = Field(
        default=None, description="The client's first seat; null for spectators."
    )
    name: ShownName = Field(default="", description="The participant's name in this episode.")
    seq: int = Field(
        default=0,
        description="The seat's last sequence number, or the highest one of several seats. The "
        "next action needs a higher number.",
    )
    step: int = Field(
        default=0,
        description="The current step. After a resume, the deltas that follow lead up to it.",
    )
    said: int = Field(default=0, description="Number of chat messages so far.")
    resume: Token | None = Field(
        default=None,
        description="Secret token that replaces the token in `welcome`. It resumes this seat, also "
        "after a restart of the server.",
    )
    seats: list[str] = Field(
        default=[], description="The client's seats in seat order, if it has several."
    )


class Moved(FromServer):
    """Another process or node has the episode. Answers `join` or `hello`, or comes by itself."""

    type: Literal["moved"] = "moved"
    ref: Ref = None
    episode: Identifier = Field(
        description="The id or code of the request; without a request, the episode's id."
    )
    port: int = Field(description="The other process's port on the same host.")
    url: str = Field(default="", description="The address to connect to instead of `port`, if set.")


OrdersRow = list[int | list[list[int]]]
ORDERS = (
    "`[time, open, arrived, score, served, expired]`; each open order as `[number, due]`, where "
    "`number` counts the task's `arrivals` from 0 and `due` is the `time` at which it expires."
)


class Snapshot(FromServer):
    """The complete state at one step."""

    type: Literal["snapshot"] = "snapshot"
    episode: Identifier = Field(description="The episode's id.")
    step: int = Field(description="The step of this state.")
    phase: Known[Phase] = Field(description="`waiting`, `running`, `paused` or `ended`.")
    digest: str = Field(description="The task's content hash.")
    task: dict[str, Any] | None = Field(
        default=None,
        description="The task: `name`, `domain`, `problem`, `seats`, `timing`. Absent if the "
        "client knows it.",
    )
    predicates: list[str] = Field(description="Names of the predicates that can change.")
    objects: list[list[str]] = Field(description="Each object as `[name, kind, type]`.")
    atoms: list[list[int]] = Field(
        description="Each atom as `[predicate, object, …]`, indices into the two lists above."
    )
    facts: list[int] = Field(description="Indices of the atoms that are true.")
    timers: list[list[str | list[int]]] = Field(
        description="Active effects in order of creation, each as `[label, counters]`."
    )
    busy: dict[str, int] = Field(
        description="Players who cannot act, with the number of steps that remain."
    )
    orders: OrdersRow | None = Field(
        default=None, description="The orders, if the task is a shift. " + ORDERS
    )
    hidden: list[str] | None = Field(
        default=None,
        description="Objects out of sight; null if the client receives the whole state.",
    )
    hash: str = Field(description="The digest of the state, as the client receives it.")
    seat: str | None = Field(
        default=None, description="The client's first seat; null for spectators."
    )
    seq: int = Field(
        default=0,
        description="The seat's last sequence number, or the highest one of several seats.",
    )
    last_seq: int = Field(
        default=0, description="Sequence number of the first seat's last decided action."
    )
    last_step: int = Field(default=0, description="The step in which that action was decided.")
    last_reasons: list[str] = Field(
        default=[], description="Reasons for its rejection; empty if it was applied."
    )
    answers: list[SeatAnswer] = Field(
        default=[],
        description="`last_seq`, `last_step` and `last_reasons` of the client's further seats.",
    )
    turn: str | None = Field(
        default=None, description="The player whose turn it is, with the clock `turn`."
    )
    clock: RulesRow = Field(description="The rules of the episode.")
    left: float | None = Field(
        default=None,
        description="Seconds until the server acts by itself: the next step, or the end of the "
        "move budget, a pause or a grace period.",
    )
    starts_in: float | None = Field(
        default=None, description="Seconds until the episode starts, during the countdown."
    )
    pause: Pause | None = Field(
        default=None, description="The reason for the pause, if `phase` is `paused`."
    )
    said: int = Field(default=0, description="Number of chat messages so far.")
    seats: list[SeatInfo] = Field(description="The seats.")
    spectators: int = Field(default=0, description="Number of spectators.")
    spectator_names: list[ShownName] = Field(
        default=[], description="Names of the first eight spectators, in order of arrival."
    )
    outcome: OutcomeRow | None = Field(
        default=None, description="The outcome; absent before the end."
    )


class Delta(FromServer):
    """The changes of one step. Step numbers have no gaps."""

    type: Literal["delta"] = "delta"
    step: int = Field(description="The number of the step.")
    add: list[int] = Field(default=[], description="Indices of atoms that became true.")
    remove: list[int] = Field(default=[], description="Indices of atoms that became false.")
    timers: dict[str, list[int] | None] = Field(
        default={},
        description="New counters of effects by label; null if the effect ended. Append labels "
        "not seen before.",
    )
    busy: dict[str, int] | None = Field(
        default=None,
        description="All busy players, with the steps that remain; absent if unchanged.",
    )
    orders: OrdersRow | None = Field(
        default=None,
        description="The orders of a shift, as in `snapshot`; absent if only `time` has advanced.",
    )
    did: list[list[int | str]] = Field(
        default=[],
        description="The joint action in order: `[seat index, action, argument, …]` per row.",
    )
    seq: list[int] = Field(default=[], description="The sequence numbers of the rows of `did`.")
    waits: list[int] = Field(
        default=[],
        description="Indices of the seats that declared a wait. Seats whose kind a study hides "
        "are left out.",
    )
    unmet: dict[str, list[str]] = Field(
        default={}, description="Unmet preconditions of rejected rows of `did`, by row index."
    )
    why: dict[str, list[Why]] = Field(
        default={}, description="The reasons of `unmet` as data, by row index."
    )
    turn: str | None = Field(
        default=None, description="The player whose turn is next, with the clock `turn`."
    )
    objects: list[list[str]] = Field(
        default=[], description="Created objects. Append those that the snapshot's table lacks."
    )
    atoms: list[list[int]] = Field(
        default=[], description="Their atoms. Append those that the snapshot's table lacks."
    )
    hidden: list[str] | None = Field(
        default=None, description="Objects out of sight; absent if unchanged."
    )
    hash: str | None = Field(
        default=None,
        description="The digest of the state, sent every tenth step; never with limited sight.",
    )


class Observation(FromServer):
    """The state in words for one seat, for the views `text` and `both`."""

    type: Literal["observation"] = "observation"
    episode: Identifier = Field(description="The episode's id.")
    step: int = Field(description="The step of this state.")
    phase: Known[Phase] = Field(
        default=Phase.RUNNING, description="`waiting`, `running`, `paused` or `ended`."
    )
    seat: str | None = Field(default=None, description="The client's seat; null for spectators.")
    text: str = Field(
        description="The player, the objects, the valid actions and the goal's conditions."
    )
    actions: list[str] = Field(
        description="The seat's valid actions as sentences; empty for spectators and busy players."
    )
    turn: str | None = Field(
        default=None, description="The player whose turn it is, with the clock `turn`."
    )
    seq: int = Field(default=0, description="Sequence number of the seat's last decided action.")
    reasons: list[str] = Field(
        default=[], description="Reasons for its rejection; empty if it was applied."
    )


class Rejected(FromServer):
    """An action was not applied."""

    type: Literal["rejected"] = "rejected"
    seq: int = Field(description="The action's sequence number.")
    step: int = Field(description="The episode's step at the time.")
    action: ReasonText = Field(description="The action's sentence, or the requested text.")
    reasons: ReasonTexts = Field(description="The unmet preconditions in words, or another reason.")
    why: list[Why] = Field(
        default=[], description="The same reasons as data, in the same order; may be empty."
    )
    code: Known[ErrorCode] = Field(default=ErrorCode.ACTION_INVALID, description="An error code.")
    seat: ShownName = Field(
        default="", description="The seat that acted; empty if the client has one seat."
    )


class Said(FromServer):
    """A chat message."""

    type: Literal["said"] = "said"
    step: int = Field(
        description="The episode's step at the time; 0 for messages from before a restart."
    )
    number: int = Field(
        default=0, description="The message's number in the episode, counted from 1."
    )
    name: ShownName = Field(description="The sender's name.")
    seat: ShownName = Field(default="", description="The sender's seat; empty for a spectator.")
    text: ChatText = Field(description="The message.")
    intent: ShownName = Field(default="", description="The intent, if the message is a signal.")
    target: ShownName = Field(default="", description="The object that the signal points at.")


class Told(FromServer):
    """A bot's note with the topic `team`. Only bots receive it, the sender included.

    If the sender's seat is shown as another kind, only the sender receives it.
    """

    type: Literal["told"] = "told"
    seat: ShownName = Field(description="The sender's seat.")
    text: ShownName = Field(description="The text.")


class Notice(FromServer):
    """A message from the server's operator to everybody in the episode."""

    type: Literal["notice"] = "notice"
    text: NoticeText = Field(description="The message.")


class Roster(FromServer):
    """The participants and the phase of the episode. Sent whenever one of them changes."""

    type: Literal["roster"] = "roster"
    phase: Known[Phase] = Field(description="`waiting`, `running`, `paused` or `ended`.")
    turn: str | None = Field(
        default=None, description="The player whose turn it is, with the clock `turn`."
    )
    pause: Pause | None = Field(
        default=None, description="The reason for the pause, if `phase` is `paused`."
    )
    seats: list[SeatInfo] = Field(description="The seats.")
    waits_for: list[Identifier] = Field(
        default=[],
        description="Players who have not decided, if the step has waited for at least 2 seconds.",
    )
    starts_in: float | None = Field(
        default=None, description="Seconds until the episode starts, during the countdown."
    )
    spectators: int = Field(default=0, description="Number of spectators.")
    spectator_names: list[ShownName] = Field(
        default=[], description="Names of the first eight spectators, in order of arrival."
    )
    rematch: ShownName = Field(
        default="", description="The code of the rematch, if a participant has created one."
    )


class Ended(FromServer):
    """The episode has ended."""

    type: Literal["ended"] = "ended"
    step: int = Field(description="The last step.")
    outcome: OutcomeRow = Field(description="The outcome.")
    hash: str = Field(
        description="The digest of the final state; empty for players with limited sight."
    )


class Left(FromServer):
    """The client is no longer in the episode."""

    type: Literal["left"] = "left"
    ref: Ref = None
    episode: Identifier = Field(description="The episode's id.")
    reason: ReasonText = Field(
        default="", description="The reason; empty if the client sent `leave`."
    )


class Error(FromServer):
    """A message was refused. The connection stays open unless `bye` follows."""

    type: Literal["error"] = "error"
    ref: Ref = None
    code: Known[ErrorCode] = Field(description="A stable error code.")
    message: ReasonText = Field(description="Explanation for people. Its wording may change.")
    field: ReasonText = Field(
        default="", description="The invalid field, with its path if nested; empty if none."
    )


class Bye(FromServer):
    """The server closes the connection."""

    type: Literal["bye"] = "bye"
    reason: ReasonText = Field(description="The reason, for people.")
    code: Known[ErrorCode] = Field(default=ErrorCode.SERVER_BYE, description="A stable error code.")
    retry: bool = Field(
        default=False, description="True if the client may reconnect soon with the resume token."
    )


ServerMessage = Annotated[
    Welcome
    | Episodes
    | Created
    | Closed
    | Rendering
    | Picture
    | Joined
    | Moved
    | Snapshot
    | Delta
    | Observation
    | Rejected
    | Said
    | Told
    | Notice
    | Roster
    | Ended
    | Left
    | Error
    | Bye,
    Field(discriminator="type"),
]
SERVER_MESSAGES: tuple[type[FromServer], ...] = get_args(get_args(ServerMessage)[0])
server_messages: TypeAdapter[ServerMessage] = TypeAdapter(ServerMessage)
