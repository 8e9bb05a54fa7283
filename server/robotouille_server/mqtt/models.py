"""What is published, and what may be asked for: the shapes of the JSON."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from robotouille.protocol import messages
from robotouille.protocol.message_parts import Identifier, Labels, Position, Token

__all__ = [
    "COMMANDS",
    "MAX_OPENED",
    "MAX_WATCH_SECONDS",
    "Announce",
    "Answer",
    "AnswerError",
    "Close",
    "Command",
    "EpisodeLife",
    "EpisodeSteps",
    "List",
    "MoveRow",
    "Open",
    "OpenedEpisode",
    "Pause",
    "Presence",
    "Resume",
    "StepRow",
    "Unwatch",
    "Watch",
    "commands",
]

MAX_OPENED = 100
"""Episodes that one command opens."""
MAX_WATCH_SECONDS = 86_400.0


class Published(BaseModel):
    """What the server publishes. Fields at their defaults are left out."""

    model_config = ConfigDict(frozen=True)


class Presence(Published):
    """Whether a server is there; the broker itself publishes `gone` once it is not heard of."""

    state: Literal["online", "stopped", "gone"]
    url: str = Field("", description="Where clients connect to.")
    version: str = Field("", description="The server's version.")
    since_utc_ms: int | None = Field(None, description="Milliseconds since 1970 of its start.")
    worker: int = Field(0, description="Which of several processes it is, from 0.")
    workers: int = Field(1, description="How many there are.")


class EpisodeLife(Published):
    """Something in an episode's life. It may come twice, then with the same `number`."""

    number: int = Field(description="Counts a server's messages of this kind; a gap is a loss.")
    event: Literal["opened", "started", "paused", "resumed", "restarted", "ended", "closed"] = (
        Field(description="`closed`: it is over, and nobody ever came.")
    )
    episode: str = Field(description="The episode's id.")
    utc_ms: int = Field(description="When that was written, in milliseconds since 1970.")
    task: str = Field(description="The task's name.")
    clock: str = Field(description="`turn`, `lockstep` or `realtime`.")
    step: int = Field(description="The steps that were taken by then.")
    labels: dict[str, str] = Field({}, description="What the episode belongs to.")
    reasons: list[str] = Field([], description="Why time stands still, with `paused`.")
    outcome: dict[str, Any] = Field(
        {}, description="How it ended, with `ended` and `closed`: as in the recording's last frame."
    )


class MoveRow(Published):
    """One seat's action in a step."""

    player: str
    action: list[str] = Field(description="Its name and arguments.")
    applied: bool = Field(description="False: it was not valid any more.")
    ms: int = Field(description="Milliseconds that the seat took for it, as recorded.")


class StepRow(Published):
    """One step, as recorded."""

    step: int
    t: int = Field(description="Milliseconds since the game's start.")
    utc_ms: int = Field(description="When it was written, in milliseconds since 1970.")
    moves: list[MoveRow] = Field(description="In the order in which they applied.")


class EpisodeSteps(Published):
    """Steps of an episode, in order."""

    episode: str
    steps: list[StepRow]
    dropped: int = Field(0, description="Steps before these that were dropped.")


class OpenedEpisode(Published):
    """An episode that was opened."""

    episode: str = Field(description="Its id.")
    code: str = Field(description="What one joins with.")
    tokens: dict[str, str] = Field({}, description="A role token for each seat, if asked for.")


class AnswerError(Published):
    """Why a command was not carried out."""

    code: str = Field(description="A stable code; those of the protocol and of the operator's API.")
    message: str = Field(description="The same for people; its words may change.")
    field: str = Field("", description="The field at fault.")


class Answer(Published):
    """What became of a command."""

    ref: str = Field("", description="The command's; empty where it could not be read.")
    ok: bool
    done: str = Field("", description="What happened, in words.")
    opened: list[OpenedEpisode] = Field([], description="With `open`; with an error, those before.")
    episodes: list[messages.EpisodeInfo] = Field([], description="With `list`: 500 at most.")
    total: int = Field(0, description="With `list`: how many there are.")
    error: AnswerError | None = None


class Command(messages.Message):
    """What a laboratory asks for, with a role token in it. `ref` is of the asker's choice, another
    for each command: one that comes twice is carried out once."""

    ref: Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[!-~]+$")]
    token: Token


class Watch(Command):
    """Publish the steps of an episode, or of all with these labels, for so many seconds. Without
    either, of all."""

    type: Literal["watch"]
    episode: Identifier | None = None
    labels: Labels = {}
    seconds: Annotated[float, Field(gt=0, le=MAX_WATCH_SECONDS)] = 3600.0


class Unwatch(Command):
    """End the watch of the same episode or labels; without either, all of this token's subject."""

    type: Literal["unwatch"]
    episode: Identifier | None = None
    labels: Labels = {}


class List(Command):
    """Tell the episodes that have these labels, from number `skip` on."""

    type: Literal["list"]
    labels: Labels = {}
    skip: Position = 0


class Open(Command):
    """Open so many episodes, alike but for their codes."""

    type: Literal["open"]
    count: Annotated[int, Field(ge=1, le=MAX_OPENED)] = 1
    create: messages.Create = messages.Create()


class Close(Command):
    """Close an episode. Who is in it is told the `reason`."""

    type: Literal["close"]
    episode: Identifier
    reason: Annotated[str, Field(min_length=1, max_length=200)] | None = None


class Announce(Command):
    """Say something to everybody in an episode; without one, in all."""

    type: Literal["announce"]
    episode: Identifier | None = None
    text: Annotated[str, Field(min_length=1, max_length=500)]


class Pause(Command):
    """Let an episode's time stand still."""

    type: Literal["pause"]
    episode: Identifier


class Resume(Command):
    """Let it run again."""

    type: Literal["resume"]
    episode: Identifier


COMMANDS: tuple[type[Command], ...] = (
    Watch,
    Unwatch,
    List,
    Open,
    Close,
    Announce,
    Pause,
    Resume,
)
AnyCommand = Annotated[
    Watch | Unwatch | List | Open | Close | Announce | Pause | Resume,
    Field(discriminator="type"),
]
commands: TypeAdapter[Command] = TypeAdapter(AnyCommand)
