"""Rules of an episode: clock, budgets and limits, as data."""

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

from robotouille.episode.lifecycle import Absence
from robotouille.world.sight import Sight

MOVE_BUDGET = 300.0
"""Default seconds for a move in an episode with several seats."""
MIN_MOVE_BUDGET = 0.01


def _check_budget(seconds: float) -> float:
    # A shorter budget would take steps faster than other episodes get their turn.
    if 0 < seconds < MIN_MOVE_BUDGET:
        words = "Input should be 0 (no limit), or at least {least} s"
        raise PydanticCustomError("too_short", words, {"least": MIN_MOVE_BUDGET})
    return seconds


# These limits hold for every client of a public server, so they bound its work: at most 60 steps a
# second for an episode, and at most 90 days open.
MIN_STEP_RATE = 0.01
StepRate = Annotated[float, Field(ge=MIN_STEP_RATE, le=60)]
MoveBudget = Annotated[float, Field(ge=0, le=86_400), AfterValidator(_check_budget)]
MaxSteps = Annotated[int, Field(ge=1, le=1_000_000)]
Grace = Annotated[float, Field(ge=0, le=86_400)]
Thinking = Literal["wall", "declared"]
Substitute = Literal["planner", "random"]
Countdown = Annotated[float, Field(ge=0, le=60)]
SightDistance = Annotated[int, Field(ge=1, le=1_000)]
OpenFor = Annotated[float, Field(ge=60, le=90 * 86_400)]
# All phrases are in `rules`, which every snapshot sends.
MAX_LABELS = 16
"""Labels of an episode."""
MAX_PHRASES = 32
MAX_DELAY_MS = 10_000
ShownKind = Literal["human", "bot", "model"]
PRINTABLE = r"^[^\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]*$"
"""Text without control characters, line ends and marks that change the writing direction."""
Phrase = Annotated[str, Field(min_length=1, max_length=200, pattern=PRINTABLE)]


class Clock(StrEnum):
    """Rule for when the next joint action is taken."""

    TURN = "turn"
    LOCKSTEP = "lockstep"
    REALTIME = "realtime"


class Chat(StrEnum):
    """Permitted chat: anything, signals only, the phrases in the rules, or nothing."""

    FREE = "free"
    SIGNALS = "signals"
    PHRASES = "phrases"
    OFF = "off"


# Treatments are not a part of `Rules`, because every participant receives the rules, and must not
# learn of a treatment (docs/decisions/0033).
class SeatTreatment(BaseModel):
    """A study's treatment of one seat."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    shown_as: ShownKind | None = Field(
        default=None, description="The kind of participant that others see in the seat."
    )
    delay_ms: Annotated[int, Field(ge=0, le=MAX_DELAY_MS)] = Field(
        default=0,
        description="Delay of each action in milliseconds. The server checks and applies the "
        "action as if it had arrived that much later.",
    )


NO_TREATMENT = SeatTreatment()


class Rules(BaseModel):
    """Rules of play.

    Attributes:
        clock: When steps are taken.
        step_rate: Steps per second in real time.
        move_budget: Seconds for a decision where steps wait for decisions; after that the seat
            does nothing. None or 0: no limit.
        max_steps: The step limit.
        thinking: Cost of thinking in real time. `wall`: the time that passes. `declared`: the
            milliseconds that a seat declares (`act.think_ms`) delay its action, and the game waits
            for every seat's answer, so a run is repeatable.
        grace: Seconds for which an absent participant's seat is kept. An episode that all
            participants have left is abandoned after that time.
        absence: Rule for absent participants. `wait`: the seat does nothing, and is
            free after the grace. `pause`: the game is paused, and abandoned after the grace.
            `bot`: a substitute plays until the participant returns. `end`: the seat does nothing,
            and the game is abandoned after the grace.
        substitute: The bot that plays as a substitute.
        open_for: Seconds for which the episode waits for its first participant. None: ten minutes,
            counted again after a restart.
        countdown: Seconds of countdown before the start, if steps follow the wall clock and a
            person plays.
        chat: The permitted chat messages.
        phrases: The permitted messages if `chat` is `phrases`.
        sight: Number of tiles that a player sees in each direction. None: no limit.
        sight_blocked: True if stations hide what is behind them.
    """

    # Frozen, because the clock copies values at the start, and the recording's header has them.
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    clock: Clock = Clock.LOCKSTEP
    step_rate: StepRate = 5.0
    move_budget: MoveBudget | None = None
    max_steps: MaxSteps = 500
    thinking: Thinking = "wall"
    grace: Grace = 30.0
    absence: Absence = Absence.WAIT
    substitute: Substitute = "planner"
    open_for: OpenFor | None = None
    countdown: Countdown = 0.0
    chat: Chat = Chat.FREE
    phrases: Annotated[tuple[Phrase, ...], Field(max_length=MAX_PHRASES)] = ()
    sight: SightDistance | None = None
    sight_blocked: bool = False

    @model_serializer(mode="wrap")
    def _write(self, written: SerializerFunctionWrapHandler) -> dict[str, Any]:
        # Most episodes leave these at their defaults. Without them the `rules` of every
        # recording and message are shorter.
        row: dict[str, Any] = written(self)
        for name in ("open_for", "countdown", "chat", "phrases", "sight", "sight_blocked"):
            if getattr(self, name) == type(self).model_fields[name].default:
                del row[name]
        return row

    @property
    def limited_sight(self) -> Sight | None:
        """Limits of the players' sight; None if they see the whole kitchen."""
        if self.sight is None and not self.sight_blocked:
            return None
        return Sight(self.sight, self.sight_blocked)

    @property
    def period(self) -> float:
        """Seconds between two steps in real time."""
        return 1.0 / self.step_rate

    @property
    def scheduled(self) -> bool:
        """True if steps follow the wall clock and do not wait for decisions."""
        return self.clock is Clock.REALTIME and self.thinking == "wall"

    def with_budget(self, asked: float | None, seats: int) -> Rules:
        """Return these rules with a move budget.

        Args:
            asked: Seconds; 0 is no limit. None is `MOVE_BUDGET` if several seats wait for each
                other, so that one silent participant cannot block the others forever.
        """
        # A single player may think for days: no other participant waits for the decision.
        if asked is None and seats > 1 and not self.scheduled:
            asked = MOVE_BUDGET
        return self.model_copy(update={"move_budget": asked or None})
