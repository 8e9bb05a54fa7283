"""The rules of an episode: its clock, budgets and limits, as data."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
)
from pydantic_core import PydanticCustomError

from robotouille.absence import Absence

__all__ = [
    "MAX_DELAY_MS",
    "MAX_PHRASES",
    "MOVE_BUDGET",
    "NO_TREATMENT",
    "PRINTABLE",
    "Absence",
    "Chat",
    "Clock",
    "Countdown",
    "Grace",
    "MaxSteps",
    "MoveBudget",
    "OpenFor",
    "Phrase",
    "Rules",
    "SeatTreatment",
    "ShownKind",
    "StandIn",
    "StepRate",
    "Thinking",
]


MOVE_BUDGET = 300.0
"""Seconds for a move in an episode of several seats for which nobody has said anything else."""
MIN_MOVE_BUDGET = 0.01


def _check_budget(seconds: float) -> float:
    """No budget at all, or one in which other episodes have their turn."""
    if 0 < seconds < MIN_MOVE_BUDGET:
        words = "Input should be 0 (no limit), or at least {least} s"
        raise PydanticCustomError("too_short", words, {"least": MIN_MOVE_BUDGET})
    return seconds


StepRate = Annotated[float, Field(ge=0.01, le=60)]
MoveBudget = Annotated[float, Field(ge=0, le=86_400), AfterValidator(_check_budget)]
MaxSteps = Annotated[int, Field(ge=1, le=1_000_000)]
Grace = Annotated[float, Field(ge=0, le=86_400)]
Thinking = Literal["wall", "declared"]
StandIn = Literal["planner", "random"]
Countdown = Annotated[float, Field(ge=0, le=60)]
OpenFor = Annotated[float, Field(ge=60, le=90 * 86_400)]
MAX_PHRASES = 32
MAX_DELAY_MS = 10_000
ShownKind = Literal["human", "bot", "model"]
PRINTABLE = r"^[^\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]*$"
"""Text without control characters, line ends and marks that turn its direction."""
Phrase = Annotated[str, Field(min_length=1, max_length=200, pattern=PRINTABLE)]


class Clock(StrEnum):
    """When the next joint action is taken; never what it does."""

    TURN = "turn"
    LOCKSTEP = "lockstep"
    REALTIME = "realtime"


class Chat(StrEnum):
    """What may be said in an episode: anything, one of its phrases, or nothing."""

    FREE = "free"
    PHRASES = "phrases"
    OFF = "off"


class SeatTreatment(BaseModel):
    """What a study does to a seat.

    Others see a participant of the kind `shown_as`, whatever plays. Each action of the seat is
    held back by `delay_ms` milliseconds before it counts, as if it had come so much later: it is
    checked only then.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    shown_as: ShownKind | None = None
    delay_ms: Annotated[int, Field(ge=0, le=MAX_DELAY_MS)] = 0


NO_TREATMENT = SeatTreatment()


class Rules(BaseModel):
    """How an episode is played.

    `step_rate`: steps a second (real time). `move_budget`: seconds a seat may take for a move where
    steps wait for decisions; after that it does nothing (None or 0: no limit). `max_steps`: the
    step limit.
    `thinking`: in real time, what a move costs: `wall` is the time that really passes; with
    `declared` a seat says how many milliseconds it thought (`act.think_ms`), its action takes
    effect that much later in the game's own time, and the game waits for everybody's answer, so
    that a run can be repeated.

    `grace`: seconds for which an absent participant's seat is kept; an episode that everybody has
    left is abandoned after them. `absence`: until then, and after it, with `wait` the seat does
    nothing, then is free for others; with `pause` the game stands still, then is abandoned; with
    `bot` the bot `stand_in` plays it until its participant returns, however late; with `end` the
    seat does nothing, then the game is abandoned.

    `countdown`: seconds from when everybody is there until the game begins, where steps follow the
    wall clock and a person plays; none where only bots and models do.

    `open_for`: seconds from its opening for which an episode waits for the first participant (None:
    ten minutes, and again after a restart). `chat`: what may be said; `phrases` are all there is to
    say where that is `phrases`. What nobody has set of these is not written.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    clock: Clock = Clock.LOCKSTEP
    step_rate: StepRate = 5.0
    move_budget: MoveBudget | None = None
    max_steps: MaxSteps = 500
    thinking: Thinking = "wall"
    grace: Grace = 30.0
    absence: Absence = Absence.WAIT
    stand_in: StandIn = "planner"
    open_for: OpenFor | None = None
    countdown: Countdown = 0.0
    chat: Chat = Chat.FREE
    phrases: Annotated[tuple[Phrase, ...], Field(max_length=MAX_PHRASES)] = ()

    @model_serializer(mode="wrap")
    def _write(self, written: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """The rules as before there were these fields, where they say nothing new."""
        row: dict[str, Any] = written(self)
        for name in ("open_for", "countdown", "chat", "phrases"):
            if getattr(self, name) == type(self).model_fields[name].default:
                del row[name]
        return row

    @property
    def period(self) -> float:
        """Seconds between two steps in real time."""
        return 1.0 / self.step_rate

    @property
    def scheduled(self) -> bool:
        """Whether steps follow the wall clock, whoever has acted."""
        return self.clock is Clock.REALTIME and self.thinking == "wall"

    def with_budget(self, asked: float | None, seats: int) -> Rules:
        """These rules with the move budget that was asked for.

        Args:
            asked: Seconds; 0 is no limit. Where nothing was said (None), one silent participant
                cannot hold all others for ever: it is `MOVE_BUDGET` with several seats.
        """
        if asked is None and seats > 1 and not self.scheduled:
            asked = MOVE_BUDGET
        return self.model_copy(update={"move_budget": asked or None})
