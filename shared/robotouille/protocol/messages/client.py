"""Messages that clients send. Enumerations in them are read strictly."""

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
from robotouille.episode.lifecycle import Absence
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
from robotouille.protocol.messages.values import (
    ByValue,
    Identifier,
    Kind,
    Labels,
    Line,
    Message,
    NamedAction,
    PlainText,
    Position,
    Ref,
    Seen,
    Token,
    View,
)
from robotouille.world.presentation.signals import Intent
from robotouille.world.text import MAX_SENTENCE


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
    phrases: Annotated[list[Annotated[Phrase, Line]], Field(max_length=MAX_PHRASES)] = Field(
        default=[], description="The permitted chat messages, if `chat` is `phrases`."
    )
    sight: SightDistance | None = Field(
        default=None,
        description="Number of tiles that players see in each direction. Their clients receive "
        "nothing else; see [Sight](protocol.md#sight).",
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
        "`state` and `both` in episodes with limited [sight](protocol.md#sight).",
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

CLIENT_MESSAGES: tuple[type[Message], ...] = get_args(get_args(ClientMessage)[0])
client_messages: TypeAdapter[ClientMessage] = TypeAdapter(ClientMessage)
