"""Every message of the wire protocol, version 1, as a discriminated union.

Clients send `ClientMessage`s, the server sends `ServerMessage`s; `type` tells which. Requests may
carry `ref`, a number that the answer repeats. docs/protocol.md is generated from these models.

What the server says by an enumeration is read leniently (`Known`): a value that this version does
not know, from a newer server, stays the text it is. What clients say is read strictly.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
)

from robotouille.domain.task import Timing
from robotouille.episode.lifecycle import Phase
from robotouille.episode.quota import MAX_NOTE
from robotouille.episode.rules import (
    MAX_PHRASES,
    Absence,
    Chat,
    Clock,
    Grace,
    MaxSteps,
    MoveBudget,
    OpenFor,
    Phrase,
    SeatTreatment,
    StandIn,
    StepRate,
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
    Message,
    NamedAction,
    OutcomeRow,
    Pause,
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
)
from robotouille.world.sentences import MAX_SENTENCE

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
    "Snapshot",
    "TallyRow",
    "View",
    "Welcome",
    "Why",
    "client_messages",
    "server_messages",
]

PROTOCOL_VERSION = 1

# From client to server


class Hello(Message):
    """The first message: who is there.

    `token` is the signed token of a role, where the server asks for one. `resume` is the token of
    a connection that was lost, and `seen` what its client has: only the rest is sent. `view` is
    that of its `join`, in case the answer to that was lost.
    """

    type: Literal["hello"] = "hello"
    ref: Ref | None = None
    protocol: Annotated[int, Field(ge=0, le=2**31 - 1)]
    name: Annotated[str, Field(min_length=1, max_length=40)]
    kind: Kind = "human"
    token: Token | None = None
    resume: Token | None = None
    seen: Seen | None = None
    view: View | None = None


class ListEpisodes(Message):
    """Ask for the episodes that can be joined or watched: those that have all of some `labels`,
    from number `skip` on. With `closed`, for those instead that were closed because nobody came.
    """

    type: Literal["list"] = "list"
    ref: Ref | None = None
    labels: Labels = {}
    skip: Position = 0
    closed: bool = False


class Create(Message):
    """Open an episode. What is left out is as the server's operator has set it.

    A `move_budget` of 0 is no limit. `absence` says what happens while a participant is away for
    up to `grace` seconds, and `stand_in` which bot plays for it where that is `bot`.

    An episode that nobody has come to is closed after `open_for` seconds, across restarts. `labels`
    are recorded, and shown to hosts and operators. `chat` says what may be said: with `phrases`,
    only one of these. `treatments` are what a study does to seats, by player: others see the kind
    `shown_as` there, and each action is held back by `delay_ms`. With `tokens` the answer has a
    role token for each seat; `participants` says who is to have them, by player.

    With `rematch`, the id or code of a game that is over and in which one had a seat, it is the
    same again: its task, rules and seats. All who ask for that game get the same episode. The other
    fields are left out.
    """

    type: Literal["create"] = "create"
    ref: Ref | None = None
    task: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    seats: Annotated[int, Field(ge=1, le=16)] | None = None
    clock: ByValue[Clock] | None = None
    timing: ByValue[Timing] | None = None
    step_rate: StepRate | None = None
    move_budget: MoveBudget | None = None
    max_steps: MaxSteps | None = None
    thinking: Thinking | None = None
    seed: Annotated[int, Field(ge=0, le=2**53)] | None = None
    absence: ByValue[Absence] | None = None
    stand_in: StandIn | None = None
    grace: Grace | None = None
    open_for: OpenFor | None = None
    labels: Labels = {}
    chat: ByValue[Chat] | None = None
    phrases: Annotated[list[Phrase], Field(max_length=MAX_PHRASES)] = []
    treatments: Annotated[dict[Identifier, SeatTreatment], Field(max_length=16)] = {}
    participants: Annotated[dict[Identifier, Identifier], Field(max_length=16)] = {}
    tokens: bool = False
    rematch: Identifier | None = None


class Close(Message):
    """Close an episode that one has opened, or, as an operator, any. Who is in it is told the
    `reason`."""

    type: Literal["close"] = "close"
    ref: Ref | None = None
    episode: Identifier
    reason: Annotated[str, Field(min_length=1, max_length=200)] | None = None


class Join(Message):
    """Enter an episode by its id or short code: play a seat, or several, or watch.

    `seats` are several to play over this one connection: by name, or `all` that are free now. It
    is all of them or none. `known` lists digests of tasks the client has already, so that they
    need not be sent. Who joins with `ready: false` says `ready` when the game may begin; send it
    only where `welcome` said `readiness`.
    """

    type: Literal["join"] = "join"
    ref: Ref | None = None
    episode: Identifier
    role: Literal["player", "spectator"] = "player"
    seat: Identifier | None = None
    view: View = "state"
    known: Annotated[list[Identifier], Field(max_length=64)] = []
    seats: Annotated[list[Identifier], Field(max_length=16)] | Literal["all"] = []
    ready: bool = True

    @field_validator("seats", mode="wrap")
    @classmethod
    def _check_seats(
        cls, value: Any, validated: ValidatorFunctionWrapHandler, info: ValidationInfo
    ) -> list[str] | str:
        try:
            seats: list[str] | str = validated(value)
        except ValidationError:
            raise ValueError("expected 'all', or the names of at most 16 seats") from None
        if seats and (info.data.get("seat") is not None or info.data.get("role") != "player"):
            raise ValueError("several seats are for players, and not together with 'seat'")
        if isinstance(seats, list) and len(set(seats)) < len(seats):
            raise ValueError("a seat is named twice")
        return seats


class Ready(Message):
    """The game may begin, as far as all of one's seats go; or, with `ready: false`, not any more.
    Once it has begun this means nothing."""

    type: Literal["ready"] = "ready"
    ready: bool = True


class Leave(Message):
    """Leave the episode; all of one's seats become free."""

    type: Literal["leave"] = "leave"
    ref: Ref | None = None


class Act(Message):
    """An action for the next step: named, as a sentence, by its place in the list of valid
    actions of the step `basis`, or null to do nothing.

    `seq` rises by at least one with each new action; the same again is the same action. `basis`
    is the step the choice was made on, `think_ms` the declared thinking time. `basis` and
    `reasoning` are recorded, and shown to nobody. An action that `anticipates` need not be valid
    yet: another's action in the same step is to make it so. Who does nothing because of a place or
    somebody that is not free yet `waits`, and is not counted as idle. `seat` is the one of one's
    seats that acts; the first if nothing is said.
    """

    type: Literal["act"] = "act"
    seq: Annotated[int, Field(ge=1, le=2**53)]
    action: NamedAction | Annotated[str, Field(max_length=MAX_SENTENCE)] | Position | None
    basis: Position | None = None
    think_ms: Annotated[int, Field(ge=0, le=86_400_000)] = 0
    reasoning: Annotated[str, Field(max_length=8000)] | None = None
    anticipates: bool = False
    seat: Identifier | None = None
    waits: bool = False


class Say(Message):
    """A chat message to everybody in the episode; that of the first of several seats."""

    type: Literal["say"] = "say"
    text: Annotated[str, Field(min_length=1, max_length=500)]


class Note(Message):
    """A text for the recording, which nobody is told: what a model was sent and has answered, or
    whatever else belongs to a seat's play.

    `topic` says what it is about. One that is longer than a message comes in pieces, of which all
    but the last have `more`.
    """

    type: Literal["note"] = "note"
    topic: Identifier
    text: Annotated[str, Field(min_length=1, max_length=MAX_NOTE)]
    more: bool = False
    seat: Identifier | None = None


class GetRendering(Message):
    """Ask what the task of the episode that one is in looks like."""

    type: Literal["get_rendering"] = "get_rendering"
    ref: Ref | None = None


class GetPicture(Message):
    """Ask for a picture of `rendering`, by its digest."""

    type: Literal["get_picture"] = "get_picture"
    ref: Ref | None = None
    digest: Identifier


class Resync(Message):
    """Ask for a snapshot, after a gap or a state hash that differs."""

    type: Literal["resync"] = "resync"


# From server to client


class Welcome(FromServer):
    """The answer to `hello`. `role` is what one may do: operator, host, player or spectator.

    `resume` brings a lost connection back; it is another with each welcome, and once it has been
    used those before it are worth nothing. `grace` are the seconds for which a seat is kept.
    `readiness` says that the server knows `ready`, as a message and in `join`.
    """

    type: Literal["welcome"] = "welcome"
    ref: Ref | None = None
    protocol: int
    server: str
    session: Identifier
    resume: Token
    resumed: bool = False
    role: str
    grace: float
    readiness: bool = False


class Episodes(FromServer):
    """The answer to `list`. Of all that there are, `total`, these are at most 500."""

    type: Literal["episodes"] = "episodes"
    ref: Ref | None = None
    episodes: list[EpisodeInfo]
    total: int = 0


class Created(FromServer):
    """The answer to `create`: the episode's id and the code to pass on, and, if that was asked
    for, a role token for each seat."""

    type: Literal["created"] = "created"
    ref: Ref | None = None
    episode: Identifier
    code: Identifier
    tokens: dict[str, str] = {}


class Rendering(FromServer):
    """The answer to `get_rendering`: all null for a shipped task, else its rendering and input
    file, and the digests of the pictures that are not shipped, by their names in the rendering."""

    type: Literal["rendering"] = "rendering"
    ref: Ref | None = None
    rendering: dict[str, Any] | None = None
    bindings: dict[str, Any] | None = None
    pictures: dict[str, str] = {}


class Picture(FromServer):
    """The answer to `get_picture`: a PNG or SVG file, as its name says, in Base64."""

    type: Literal["picture"] = "picture"
    ref: Ref | None = None
    digest: Identifier
    data: str


class Closed(FromServer):
    """The answer to `close`."""

    type: Literal["closed"] = "closed"
    ref: Ref | None = None
    episode: Identifier


class Joined(FromServer):
    """The answer to `join`; a `snapshot` (or `observation`) follows, or, in a connection that was
    resumed, what was missed up to `step` and a `roster`.

    `name` is what one is called in the episode: the name of `hello` or of the role token, without
    what cannot be seen, and with a number where somebody else has it. `seq` is the seat's last
    sequence number: the next action's is higher. `said` is the number of chat messages so far.
    `resume` takes the place of that of `welcome`: it brings one back into this seat even if the
    server is started anew meanwhile. `anticipates` and `waits` say that the server knows these
    fields of `act`.
    `seats` are one's own where there are several: `seat` is the first of them, and `seq` the
    highest number of any.
    """

    type: Literal["joined"] = "joined"
    ref: Ref | None = None
    episode: Identifier
    code: Identifier
    role: str
    seat: str | None = None
    name: str = ""
    seq: int = 0
    step: int = 0
    said: int = 0
    resume: Token | None = None
    anticipates: bool = False
    seats: list[str] = []
    waits: bool = False


class Moved(FromServer):
    """The answer to `join` or `hello` where the episode is with another process of the server:
    connect to `url`, or to this `port` of the same host, and join there."""

    type: Literal["moved"] = "moved"
    ref: Ref | None = None
    episode: Identifier
    port: int
    url: str = ""


class Snapshot(FromServer):
    """The whole state at a step.

    `atoms[i]` is atom *i* as `[predicate, object, …]`, indices into `predicates` and `objects`;
    `facts` lists the atoms that are true. `timers` are the active effects in order of creation,
    each with its counters; `busy` the steps for which players cannot act. `task` is absent where
    the client said it knows it. `clock` are the rules, `left` the seconds until the next step or
    the end of the move's budget, `starts_in` those until the game begins, while that is
    counted down, `said` the number of chat messages so far. `last_seq` is the
    seat's last action whose fate is decided: taken in step `last_step`, or rejected for
    `last_reasons`. Where one has several seats, that is the first's; `answers` tell the same of the
    others, and `seq` is the highest number of any.
    """

    type: Literal["snapshot"] = "snapshot"
    episode: Identifier
    step: int
    phase: Known[Phase]
    digest: str
    task: dict[str, Any] | None = None
    predicates: list[str]
    objects: list[list[str]]
    atoms: list[list[int]]
    facts: list[int]
    timers: list[list[str | list[int]]]
    busy: dict[str, int]
    hash: str
    seat: str | None = None
    seq: int = 0
    last_seq: int = 0
    last_step: int = 0
    last_reasons: list[str] = []
    answers: list[SeatAnswer] = []
    turn: str | None = None
    clock: RulesRow
    left: float | None = None
    starts_in: float | None = None
    pause: Pause | None = None
    said: int = 0
    seats: list[SeatInfo]
    spectators: int = 0
    spectator_names: list[str] = []
    outcome: OutcomeRow | None = None


class Delta(FromServer):
    """What one step changed; step numbers have no gaps.

    `add` and `remove` are atoms; `timers` gives the new counters of effects (null: gone; an effect
    not known before comes last). `did` is the joint action in the order it applied:
    `[seat number, action, arguments …]`, with the unmet preconditions in `unmet` and `why` under
    its position if it was rejected. `seq` are the sequence numbers of `did`. `waits` are the seats
    that did nothing and said that they wait. `objects` and `atoms` extend the tables of the
    snapshot. `hash` is the digest of the state, now and then.
    """

    type: Literal["delta"] = "delta"
    step: int
    add: list[int] = []
    remove: list[int] = []
    timers: dict[str, list[int] | None] = {}
    busy: dict[str, int] | None = None
    did: list[list[int | str]] = []
    seq: list[int] = []
    waits: list[int] = []
    unmet: dict[str, list[str]] = {}
    why: dict[str, list[Why]] = {}
    turn: str | None = None
    objects: list[list[str]] = []
    atoms: list[list[int]] = []
    hash: str | None = None


class Observation(FromServer):
    """The state in words for one seat, with its valid actions as sentences (text view).

    `seq` is the seat's last action whose fate is decided; if it was rejected, `reasons` say why,
    and `rejected` came before.
    """

    type: Literal["observation"] = "observation"
    episode: Identifier
    step: int
    phase: Known[Phase] = Phase.RUNNING
    seat: str | None = None
    text: str
    actions: list[str]
    turn: str | None = None
    seq: int = 0
    reasons: list[str] = []


class Rejected(FromServer):
    """An action that was not taken into a step: why (`code`, `reasons`, `why`), and at which
    step. `seat` says whose it was where one has several."""

    type: Literal["rejected"] = "rejected"
    seq: int
    step: int
    action: str
    reasons: list[str]
    why: list[Why] = []
    code: Known[ErrorCode] = ErrorCode.ACTION_INVALID
    seat: str = ""


class Said(FromServer):
    """A chat message, the `number`th of the episode; `seat` is empty for a spectator."""

    type: Literal["said"] = "said"
    step: int
    number: int = 0
    name: str
    seat: str = ""
    text: str


class Notice(FromServer):
    """Something the server's operator says to everybody in the episode."""

    type: Literal["notice"] = "notice"
    text: str


class Roster(FromServer):
    """Who plays and who watches, whose turn it is, and why the game stands still if it does; sent
    when it changes.

    `waits_for` are the players whose decision a step has waited for, for two seconds at least.
    While everybody is there and ready and the game has not begun, it does so in `starts_in`
    seconds. `spectator_names` are the first few who watch, in the order in which they came.
    `rematch` is the code of the game in which they play again, once the game is over and somebody
    has asked for one.
    """

    type: Literal["roster"] = "roster"
    phase: Known[Phase]
    turn: str | None = None
    pause: Pause | None = None
    seats: list[SeatInfo]
    waits_for: list[Identifier] = []
    starts_in: float | None = None
    spectators: int = 0
    spectator_names: list[str] = []
    rematch: str = ""


class Ended(FromServer):
    """The episode is over."""

    type: Literal["ended"] = "ended"
    step: int
    outcome: OutcomeRow
    hash: str


class Left(FromServer):
    """The client is no longer in the episode."""

    type: Literal["left"] = "left"
    ref: Ref | None = None
    episode: Identifier
    reason: str = ""


class Error(FromServer):
    """A message could not be honoured; the connection lives on unless it closes."""

    type: Literal["error"] = "error"
    ref: Ref | None = None
    code: Known[ErrorCode]
    message: str
    field: str = ""


class Bye(FromServer):
    """The server closes the connection, and why. With `retry` it can be resumed in a moment."""

    type: Literal["bye"] = "bye"
    reason: str
    code: Known[ErrorCode] = ErrorCode.SERVER_BYE
    retry: bool = False


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
    | Notice
    | Roster
    | Ended
    | Left
    | Error
    | Bye,
    Field(discriminator="type"),
]

CLIENT_MESSAGES = (
    Hello,
    ListEpisodes,
    Create,
    Close,
    Join,
    Ready,
    Leave,
    Act,
    Say,
    Note,
    GetRendering,
    GetPicture,
    Resync,
)
SERVER_MESSAGES = (
    Welcome, Episodes, Created, Closed, Rendering, Picture, Joined, Moved, Snapshot, Delta,
    Observation, Rejected, Said, Notice, Roster, Ended, Left, Error, Bye,
)  # fmt: skip

client_messages: TypeAdapter[ClientMessage] = TypeAdapter(ClientMessage)
server_messages: TypeAdapter[ServerMessage] = TypeAdapter(ServerMessage)
