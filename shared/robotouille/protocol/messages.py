"""Messages of the wire protocol, version 1, as two discriminated unions.

Clients send `ClientMessage`s and the server sends `ServerMessage`s; `type` names the message.
The message reference in docs/protocol.md is generated from these models.

Enumerations in server messages are read leniently (`Known`): a value from a newer server stays a
plain string. Client messages are read strictly.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from pydantic import (
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
)

from robotouille.domain.task import Timing
from robotouille.episode.lifecycle import Absence, Phase
from robotouille.episode.quota import MAX_NOTE
from robotouille.episode.rules import (
    MAX_PHRASES,
    Chat,
    Clock,
    Grace,
    MaxSteps,
    MoveBudget,
    OpenFor,
    Phrase,
    SeatTreatment,
    SightDistance,
    StepRate,
    Substitute,
    Thinking,
)
from robotouille.protocol.error_codes import ErrorCode
from robotouille.protocol.message_parts import (
    ByValue,
    EpisodeInfo,
    FromServer,
    Identifier,
    Kind,
    Known,
    Labels,
    Line,
    Message,
    NamedAction,
    NodeAddress,
    OutcomeRow,
    Pause,
    PlainText,
    Position,
    Ref,
    RulesRow,
    SeatAnswer,
    SeatInfo,
    Seen,
    TallyRow,
    Token,
    View,
    Why,
    WorkerAddress,
)
from robotouille.world.presentation.signals import Intent
from robotouille.world.text import MAX_SENTENCE

__all__ = [
    "CLIENT_MESSAGES",
    "PROTOCOL_VERSION",
    "SERVER_MESSAGES",
    "Act",
    "Bye",
    "ClientMessage",
    "Close",
    "Closed",
    "Create",
    "Created",
    "Delta",
    "Ended",
    "EpisodeInfo",
    "Episodes",
    "Error",
    "GetPicture",
    "GetRendering",
    "Hello",
    "Join",
    "Joined",
    "Kind",
    "Leave",
    "Left",
    "ListEpisodes",
    "Message",
    "Moved",
    "NamedAction",
    "Note",
    "Notice",
    "Observation",
    "OutcomeRow",
    "Pause",
    "Picture",
    "Ready",
    "Rejected",
    "Rendering",
    "Resync",
    "Roster",
    "RulesRow",
    "Said",
    "Say",
    "SeatAnswer",
    "SeatInfo",
    "Seen",
    "ServerMessage",
    "Signal",
    "Snapshot",
    "TallyRow",
    "Told",
    "View",
    "Welcome",
    "Why",
    "WorkerAddress",
    "client_messages",
    "server_messages",
]

PROTOCOL_VERSION = 1

# Messages from client to server


class Hello(Message):
    """Introduce the client. This must be the first message on a connection."""

    type: Literal["hello"] = "hello"
    ref: Ref = None
    protocol: Annotated[int, Field(ge=0, le=2**31 - 1)] = Field(
        description="The protocol version; must be 1."
    )
    name: Annotated[str, Field(min_length=1, max_length=40)] = Field(
        description="The name that others see."
    )
    kind: Kind = Field(
        default="human", description="The kind of participant. It is shown and recorded."
    )
    token: Token | None = Field(
        default=None, description="A role token from the operator. Ignored together with `resume`."
    )
    resume: Token | None = Field(
        default=None,
        description="The last `resume` token of a lost connection, to return to its seat.",
    )
    seen: Seen | None = Field(
        default=None,
        description="With `resume`: the part of the episode that the client has. The server sends "
        "only the rest.",
    )
    view: View | None = Field(
        default=None,
        description="With `resume`: the `view` of the original `join`, in case `joined` was lost.",
    )


class ListEpisodes(Message):
    """Request the episodes that the client may join or watch."""

    type: Literal["list"] = "list"
    ref: Ref = None
    labels: Labels = Field(default={}, description="Return only episodes with all these labels.")
    skip: Position = Field(default=0, description="Number of episodes to skip, for paging.")
    closed: bool = Field(
        default=False,
        description="Return episodes that were closed because nobody joined: the client's own, or "
        "all for an operator.",
    )


class Create(Message):
    """Create an episode without joining it. Options left out use the server's settings."""

    type: Literal["create"] = "create"
    ref: Ref = None
    task: Annotated[str, Field(min_length=1, max_length=200)] | None = Field(
        default=None,
        description="A task's name, or an unambiguous prefix of a shipped task's name. `@N` asks "
        "for N seats.",
    )
    seats: Annotated[int, Field(ge=1, le=16)] | None = Field(
        default=None, description="Number of seats, for tasks that support several."
    )
    clock: ByValue[Clock] | None = Field(
        default=None, description="The clock: when steps are taken."
    )
    timing: ByValue[Timing] | None = Field(
        default=None,
        description="The timing profile. Without a server setting the default is `people` in real "
        "time and `benchmark` otherwise.",
    )
    step_rate: StepRate | None = Field(default=None, description="Steps per second in real time.")
    move_budget: MoveBudget | None = Field(
        default=None,
        description="Seconds allowed for one decision: 0 (no limit), or at least 0.01.",
    )
    max_steps: MaxSteps | None = Field(
        default=None,
        description="The step limit. With the timing `people` the default is derived from the "
        "shortest known plan.",
    )
    thinking: Thinking | None = Field(
        default=None,
        description="Cost of thinking in real time: elapsed time (`wall`) or `think_ms` "
        "(`declared`).",
    )
    seed: Annotated[int, Field(ge=0, le=2**53)] | None = Field(
        default=None, description="Seed for the objects that the problem leaves to chance."
    )
    absence: ByValue[Absence] | None = Field(
        default=None, description="Rule for absent participants."
    )
    substitute: Substitute | None = Field(
        default=None,
        description="The bot that plays for absent participants, if `absence` is `bot`.",
    )
    grace: Grace | None = Field(
        default=None, description="Seconds for which an absent participant keeps the seat."
    )
    open_for: OpenFor | None = Field(
        default=None,
        description="Seconds after which the episode closes if nobody has joined; restarts do not "
        "extend this time. By default ten minutes, counted again after a restart.",
    )
    labels: Labels = Field(
        default={},
        description="Labels of a study. They are recorded, and shown to the creator and operators.",
    )
    chat: ByValue[Chat] | None = Field(
        default=None,
        description="Permitted chat: anything (`free`, the default), `signals` only, the "
        "`phrases`, or nothing (`off`).",
    )
    phrases: Annotated[list[Phrase], Field(max_length=MAX_PHRASES)] = Field(
        default=[], description="The permitted chat messages, if `chat` is `phrases`."
    )
    sight: SightDistance | None = Field(
        default=None,
        description="Number of tiles that players see in each direction. Their clients receive "
        "nothing else; see [Sight](#sight).",
    )
    sight_blocked: bool | None = Field(
        default=None, description="True if stations hide what is behind them."
    )
    treatments: Annotated[dict[Identifier, SeatTreatment], Field(max_length=16)] = Field(
        default={}, description="A study's treatment of seats, by player."
    )
    participants: Annotated[dict[Identifier, Identifier], Field(max_length=16)] = Field(
        default={},
        description="Participant ids for the seats' tokens, by player. An id gets the same "
        "pseudonym in all episodes of one owner.",
    )
    tokens: bool = Field(
        default=False, description="Request a role token for each seat in `created`."
    )
    rematch: Identifier | None = Field(
        default=None,
        description="Id or code of an ended episode in which the client had a seat. Creates an "
        "episode of the same kind. Only `ref` may accompany it.",
    )


class Close(Message):
    """Close an episode. Hosts may close their own episodes, operators any."""

    type: Literal["close"] = "close"
    ref: Ref = None
    episode: Identifier = Field(description="The episode's id or code.")
    reason: Annotated[str, Field(min_length=1, max_length=200), Line] | None = Field(
        default=None, description="Reason for the participants, sent as the outcome's `detail`."
    )


class Join(Message):
    """Join an episode as a player of one or several seats, or as a spectator."""

    type: Literal["join"] = "join"
    ref: Ref = None
    episode: Identifier = Field(
        description="The episode's code. Case and dashes are ignored. Hosts, operators and "
        "bearers of a token for the episode may send its id instead."
    )
    role: Literal["player", "spectator"] = Field(default="player", description="Play or watch.")
    seat: Identifier | None = Field(
        default=None, description="The seat to take; by default a free one. Not for spectators."
    )
    view: View = Field(
        default="state",
        description="`state`: snapshots and deltas. `text`: observations in words. `both`: both.",
    )
    known: Annotated[list[Identifier], Field(max_length=64)] = Field(
        default=[],
        description="Digests of tasks that the client has. Snapshots omit these tasks.",
    )
    seats: Annotated[list[Identifier], Field(max_length=16)] | Literal["all"] = Field(
        default=[],
        description='Several seats to take, or `"all"` that are free. The server assigns all of '
        "them or none. Not together with `seat`, and not for spectators.",
    )
    ready: bool = Field(
        default=True,
        description="False: the episode does not start before the client sends `ready`. Only valid "
        "if `welcome` has `readiness`.",
    )
    partial: bool = Field(
        default=False,
        description="True: the client can play with a part of the state. Required for the views "
        "`state` and `both` in episodes with limited [sight](#sight).",
    )
    agent: Annotated[str, Field(max_length=200), Line] = Field(
        default="",
        description="A description of the program that plays, with its version and settings. It is "
        "recorded and not shown to others.",
    )

    @field_validator("seat")
    @classmethod
    def _check_seat(cls, value: str | None, info: ValidationInfo) -> str | None:
        if value is not None and info.data.get("role") != "player":
            raise ValueError("cannot be combined with the role 'spectator'")
        return value

    @field_validator("seats", mode="wrap")
    @classmethod
    def _check_seats(
        cls, value: Any, validated: ValidatorFunctionWrapHandler, info: ValidationInfo
    ) -> list[str] | str:
        try:
            seats: list[str] | str = validated(value)
        except ValidationError:
            raise ValueError("must be 'all' or a list of at most 16 seats") from None
        if seats and (info.data.get("seat") is not None or info.data.get("role") != "player"):
            raise ValueError("cannot be combined with 'seat' or the role 'spectator'")
        if isinstance(seats, list) and len(set(seats)) < len(seats):
            raise ValueError("must not name a seat twice")
        return seats


class Ready(Message):
    """Declare all of the client's seats ready, or not ready. No effect after the start."""

    type: Literal["ready"] = "ready"
    ready: bool = Field(default=True, description="False withdraws an earlier `ready`.")


class Leave(Message):
    """Leave the episode. All of the client's seats become free."""

    type: Literal["leave"] = "leave"
    ref: Ref = None


class Act(Message):
    """Submit an action for the next step."""

    type: Literal["act"] = "act"
    seq: Annotated[int, Field(ge=1, le=2**53)] = Field(
        description="Sequence number, higher than that of every earlier action of the seat. The "
        "same number again means the same action."
    )
    action: NamedAction | Annotated[str, Field(max_length=MAX_SENTENCE)] | Position | None = Field(
        description="A named action, a sentence, an index into the valid actions of step `basis`, "
        "or null to do nothing."
    )
    basis: Position | None = Field(
        default=None,
        description="The step on which the choice is based. Recorded; required with an index and "
        "with `max_age`.",
    )
    max_age: Position | None = Field(
        default=None,
        description="Most steps from `basis` to the state in which the action is tried. An older "
        "action gets `rejected` with `action/stale`.",
    )
    think_ms: Annotated[int, Field(ge=0, le=86_400_000)] = Field(
        default=0,
        description="Declared thinking time in milliseconds, if `thinking` is `declared`.",
    )
    reasoning: Annotated[str, Field(max_length=8000), PlainText] | None = Field(
        default=None, description="Free text for the recording. No participant sees it."
    )
    anticipates: bool = Field(
        default=False,
        description="True if another player's action in the same step will make this one valid.",
    )
    seat: Identifier | None = Field(
        default=None, description="The seat that acts; by default the client's first."
    )
    waits: bool = Field(
        default=False,
        description="With the action null: the player waits for a blocked station or another "
        "player, and is not idle.",
    )


class Say(Message):
    """Send a chat message to everybody in the episode."""

    type: Literal["say"] = "say"
    text: Annotated[str, Field(min_length=1, max_length=500), Line] = Field(
        description="The message, in one line."
    )


class Signal(Message):
    """Send a signal to everybody in the episode. The server writes its sentence."""

    type: Literal["signal"] = "signal"
    intent: ByValue[Intent] = Field(
        description="`need`: leave this station or hand over this item; `yours`: take care of "
        "this; `look`: look at this; `wait`; or `thanks`."
    )
    target: Identifier | None = Field(
        default=None,
        description="The station, item or player that it points at; required for `need` (not a "
        "player), `yours` and `look`.",
    )
    seat: Identifier | None = Field(
        default=None, description="The seat that signals; by default the client's first."
    )


class Note(Message):
    """Add text to the recording, such as a model's prompt and answer. People do not see it.

    A bot's note with the topic `team` that is the version of a planner, such as `planner 2`, is
    sent to all bots of the episode.
    """

    type: Literal["note"] = "note"
    topic: Annotated[Identifier, Line] = Field(
        description="The subject; `model-call` for calls of a model."
    )
    text: Annotated[str, Field(min_length=1, max_length=MAX_NOTE), PlainText] = Field(
        description="The text, or one piece of it."
    )
    more: bool = Field(default=False, description="True if the next note continues this one.")
    seat: Identifier | None = Field(
        default=None, description="The seat concerned; by default the client's first."
    )


class GetRendering(Message):
    """Request the rendering of the current episode's task."""

    type: Literal["get_rendering"] = "get_rendering"
    ref: Ref = None


class GetPicture(Message):
    """Request a picture that a `rendering` lists."""

    type: Literal["get_picture"] = "get_picture"
    ref: Ref = None
    digest: Identifier = Field(description="The picture's SHA-256 digest, from `rendering`.")


class Resync(Message):
    """Request a snapshot, after a missing step or a different state hash."""

    type: Literal["resync"] = "resync"


# Messages from server to client


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
    name: str = Field(default="", description="The participant's name in this episode.")
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
    spectator_names: list[str] = Field(
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
        default=[], description="New objects, to append to the snapshot's table."
    )
    atoms: list[list[int]] = Field(
        default=[], description="New atoms, to append to the snapshot's table."
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
    action: str = Field(description="The action's sentence, or the requested text.")
    reasons: list[str] = Field(description="The unmet preconditions in words, or another reason.")
    why: list[Why] = Field(
        default=[], description="The same reasons as data, in the same order; may be empty."
    )
    code: Known[ErrorCode] = Field(default=ErrorCode.ACTION_INVALID, description="An error code.")
    seat: str = Field(
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
    name: str = Field(description="The sender's name.")
    seat: str = Field(default="", description="The sender's seat; empty for a spectator.")
    text: str = Field(description="The message.")
    intent: str = Field(default="", description="The intent, if the message is a signal.")
    target: str = Field(default="", description="The object that the signal points at.")


class Told(FromServer):
    """A bot's note with the topic `team`. Only bots receive it, the sender included.

    If the sender's seat is shown as another kind, only the sender receives it.
    """

    type: Literal["told"] = "told"
    seat: str = Field(description="The sender's seat.")
    text: str = Field(description="The text.")


class Notice(FromServer):
    """A message from the server's operator to everybody in the episode."""

    type: Literal["notice"] = "notice"
    text: str = Field(description="The message.")


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
    spectator_names: list[str] = Field(
        default=[], description="Names of the first eight spectators, in order of arrival."
    )
    rematch: str = Field(
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
    reason: str = Field(default="", description="The reason; empty if the client sent `leave`.")


class Error(FromServer):
    """A message was refused. The connection stays open unless `bye` follows."""

    type: Literal["error"] = "error"
    ref: Ref = None
    code: Known[ErrorCode] = Field(description="A stable error code.")
    message: str = Field(description="Explanation for people. Its wording may change.")
    field: str = Field(
        default="", description="The invalid field, with its path if nested; empty if none."
    )


class Bye(FromServer):
    """The server closes the connection."""

    type: Literal["bye"] = "bye"
    reason: str = Field(description="The reason, for people.")
    code: Known[ErrorCode] = Field(default=ErrorCode.SERVER_BYE, description="A stable error code.")
    retry: bool = Field(
        default=False, description="True if the client may reconnect soon with the resume token."
    )


ClientMessage = Annotated[
    Hello
    | ListEpisodes
    | Create
    | Close
    | Join
    | Ready
    | Leave
    | Act
    | Say
    | Signal
    | Note
    | GetRendering
    | GetPicture
    | Resync,
    Field(discriminator="type"),
]
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

CLIENT_MESSAGES: tuple[type[Message], ...] = get_args(get_args(ClientMessage)[0])
SERVER_MESSAGES: tuple[type[FromServer], ...] = get_args(get_args(ServerMessage)[0])

client_messages: TypeAdapter[ClientMessage] = TypeAdapter(ClientMessage)
server_messages: TypeAdapter[ServerMessage] = TypeAdapter(ServerMessage)
