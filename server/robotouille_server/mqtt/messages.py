"""Topics and JSON payloads of MQTT."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import Field, TypeAdapter, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from robotouille.protocol import messages
from robotouille.protocol.codec import MAX_CLIENT_BYTES
from robotouille.protocol.messages import Identifier, Labels, Line, PlainText, Position, Token
from robotouille_server.auth import Role
from robotouille_server.operator.models import (
    MAX_OPENED,
    OpenedEpisode,
    Problem,
    ResponseModel,
)

ROOT = "robotouille/v1"
"""First levels of all topics; the number is the version of the payloads."""
MAX_TOPIC = 200
MAX_WATCH_SECONDS = 86_400.0
MAX_PACKET_BYTES = MAX_CLIENT_BYTES + 16 * 1024
"""Largest packet that the broker may deliver: a command, its topic and its properties."""
MAX_PROPERTY_BYTES = 2 * 1024
"""Longest properties of a command."""


class Topics:
    """Topics of one server. They contain episode ids, never codes: anyone can join with a code."""

    def __init__(self, server: str) -> None:
        self.server = server
        self._base = f"{ROOT}/{server}"
        self.presence = f"{self._base}/presence"
        self.commands = f"{self._base}/commands"
        self.answers = f"{self._base}/answers"

    def life(self, episode: str) -> str:
        return f"{self._base}/episodes/{episode}/life"

    def steps(self, episode: str) -> str:
        return f"{self._base}/episodes/{episode}/steps"

    def reply_topic(self, requested: str) -> str:
        """Return the topic for a reply: the requested one if it is below `answers`.

        The server may publish where the client may not, so any other topic would let a client
        forge messages.
        """
        below = requested.removeprefix(f"{self.answers}/")
        valid = requested.isprintable() and not set(requested) & set("+#")
        if below != requested and below and valid and len(requested) <= MAX_TOPIC:
            return requested
        return self.answers


class Presence(ResponseModel):
    """State of a server. The broker publishes `gone` when the connection is lost."""

    state: Literal["online", "stopped", "gone"]
    url: str = Field("", description="URL for clients.")
    version: str = Field("", description="Version of the server.")
    since_utc_ms: int | None = Field(None, description="Start time, in milliseconds since 1970.")
    worker: int = Field(0, description="Index of the worker process, from 0.")
    workers: int = Field(1, description="Number of worker processes.")


class LifecycleEvent(ResponseModel):
    """Change of an episode's state. A repeated message has the same `number`."""

    number: int = Field(description="Number of the message, from 1. A gap means a lost message.")
    event: Literal["opened", "started", "paused", "resumed", "restarted", "ended", "closed"] = (
        Field(description="`closed`: the episode ended without ever having had a participant.")
    )
    episode: str = Field(description="Id of the episode.")
    utc_ms: int = Field(description="Time of recording, in milliseconds since 1970.")
    task: str = Field(description="Name of the task.")
    clock: str = Field(description="`turn`, `lockstep` or `realtime`.")
    step: int = Field(description="Number of steps so far.")
    labels: dict[str, str] = Field({}, description="Labels that the study attached.")
    reasons: list[str] = Field([], description="With `paused`: the reasons for the pause.")
    outcome: dict[str, Any] = Field(
        {}, description="With `ended` and `closed`: the outcome, as in the recording's last frame."
    )


class MoveRow(ResponseModel):
    """Action of one player in a step."""

    player: str
    action: list[str] = Field(description="Name and arguments of the action.")
    applied: bool = Field(description="False if the action was rejected.")
    ms: int = Field(description="Milliseconds that the participant took, as recorded.")


class StepRow(ResponseModel):
    """One step, as recorded."""

    step: int
    t: int = Field(description="Milliseconds since the episode's start.")
    utc_ms: int = Field(description="Time of recording, in milliseconds since 1970.")
    moves: list[MoveRow] = Field(description="Moves in the order in which they applied.")


class EpisodeSteps(ResponseModel):
    """Consecutive steps of one episode."""

    episode: str
    steps: list[StepRow]
    dropped: int = Field(0, description="Number of dropped steps before these.")


class CommandReply(ResponseModel):
    """Reply to a command."""

    ref: str = Field("", description="The command's `ref`; empty if it was not read.")
    subject: str = Field(
        "",
        description="Subject of the command's token. Empty if the command was refused before its "
        "token was accepted.",
    )
    ok: bool
    done: str = Field("", description="Action that the server took, for people.")
    opened: list[OpenedEpisode] = Field(
        [], description="With `open`: the new episodes. After an error, those opened before it."
    )
    episodes: list[messages.EpisodeInfo] = Field([], description="With `list`: up to 500 episodes.")
    total: int = Field(0, description="With `list`: the number of matching episodes.")
    error: Problem | None = None


class Command(messages.Message):
    """Command of laboratory software, authorized by a role token.

    Attributes:
        least_role: The least role that may send the command.
    """

    least_role: ClassVar[Role] = Role.HOST
    type: str
    ref: Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[!-~]+$")]
    token: Token


class EpisodesCommand(Command):
    """Command about one episode, the episodes with some labels, or all episodes."""

    episode: Identifier | None = None
    labels: Labels = Field({})

    @field_validator("labels")
    @classmethod
    def _one_of_both(cls, labels: dict[str, str], info: ValidationInfo) -> dict[str, str]:
        if labels and info.data.get("episode") is not None:
            raise PydanticCustomError("conflict", "name an episode or labels, not both")
        return labels


class WatchCommand(EpisodesCommand):
    """Publish the steps of these episodes, and of later matching ones, for some time."""

    type: Literal["watch"]
    seconds: Annotated[float, Field(gt=0, le=MAX_WATCH_SECONDS)] = 3600.0


class UnwatchCommand(EpisodesCommand):
    """End the watch of the same episode or labels, or all watches of the token's subject."""

    type: Literal["unwatch"]


class ListCommand(Command):
    """List the episodes with these labels, starting at index `skip`."""

    type: Literal["list"]
    labels: Labels = Field({})
    skip: Position = 0


class OpenCommand(Command):
    """Open `count` episodes with the same options."""

    type: Literal["open"]
    count: Annotated[int, Field(ge=1, le=MAX_OPENED)] = 1
    create: messages.Create = messages.Create()


class CloseCommand(Command):
    """End an episode. Its participants receive the reason."""

    type: Literal["close"]
    episode: Identifier
    reason: Annotated[str, Field(min_length=1, max_length=200), Line] | None = None


class AnnounceCommand(Command):
    """Send a text to all participants of an episode, or of all episodes."""

    least_role = Role.OPERATOR
    type: Literal["announce"]
    episode: Identifier | None = None
    text: Annotated[str, Field(min_length=1, max_length=500), PlainText, Field(min_length=1)]


class PauseCommand(Command):
    """Pause an episode."""

    least_role = Role.OPERATOR
    type: Literal["pause"]
    episode: Identifier


class ResumeCommand(Command):
    """Resume an episode that an operator paused."""

    least_role = Role.OPERATOR
    type: Literal["resume"]
    episode: Identifier


AnyCommand = (
    WatchCommand
    | UnwatchCommand
    | ListCommand
    | OpenCommand
    | CloseCommand
    | AnnounceCommand
    | PauseCommand
    | ResumeCommand
)
COMMANDS: tuple[type[Command], ...] = get_args(AnyCommand)
command_adapter: TypeAdapter[Command] = TypeAdapter(
    Annotated[AnyCommand, Field(discriminator="type")]
)
