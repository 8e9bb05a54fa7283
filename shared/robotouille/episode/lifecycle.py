"""State machines of an episode and of a seat, the reasons for pauses, and the time without pauses.

A transition that is not in a table cannot happen: `next_phase` and `next_seat_state` raise, and the
caller's state does not change.

This module imports no models, so that command lines can use its values without a slow start.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, StrEnum, auto

from robotouille.errors import IllegalEventError


class Phase(StrEnum):
    """Phase of an episode. The values are those on the wire."""

    WAITING = "waiting"
    RUNNING = "running"
    PAUSED = "paused"
    ENDED = "ended"


class PhaseEvent(Enum):
    """Event that changes the phase of an episode."""

    START = auto()
    """All seats are taken and all participants are ready."""
    PAUSE = auto()
    """There is a reason to pause, or the reasons changed."""
    RESUME = auto()
    """No reason to pause is left."""
    END = auto()
    """The episode has an outcome."""


# Tables instead of conditions in the methods: tests walk through all combinations of them, and an
# illegal event is found where it happens and not where its effect shows.
PHASES: Mapping[Phase, Mapping[PhaseEvent, Phase]] = {
    Phase.WAITING: {
        PhaseEvent.START: Phase.RUNNING,
        PhaseEvent.END: Phase.ENDED,
    },
    Phase.RUNNING: {
        PhaseEvent.PAUSE: Phase.PAUSED,
        PhaseEvent.END: Phase.ENDED,
    },
    Phase.PAUSED: {
        PhaseEvent.PAUSE: Phase.PAUSED,
        # PAUSE is legal here, because a second reason may be added and the event reports all of
        # them.
        PhaseEvent.RESUME: Phase.RUNNING,
        PhaseEvent.END: Phase.ENDED,
    },
    Phase.ENDED: {},
}


class Absence(StrEnum):
    """Rule for what happens while a participant is absent; see `Rules`."""

    WAIT = "wait"
    PAUSE = "pause"
    BOT = "bot"
    END = "end"


class SeatState(Enum):
    """State of a seat: free, or with a participant who is present or absent."""

    FREE = auto()
    PRESENT = auto()
    ABSENT = auto()


class Controller(StrEnum):
    """Controller of a seat: its participant (by kind), nobody, or a substitute."""

    FREE = ""
    HUMAN = "human"
    BOT = "bot"
    MODEL = "model"
    ABSENT = "absent"
    SUBSTITUTE = "substitute"


class SeatEvent(Enum):
    """Event that changes the state of a seat."""

    TAKE = auto()
    """A participant takes the seat."""
    LOSE = auto()
    """The participant's connection is lost."""
    RETURN = auto()
    """The connection is back, or another connection replaces it."""
    VACATE = auto()
    """The seat becomes free."""


SEAT_STATES: Mapping[SeatState, Mapping[SeatEvent, SeatState]] = {
    SeatState.FREE: {
        SeatEvent.TAKE: SeatState.PRESENT,
    },
    SeatState.PRESENT: {
        # RETURN while present: the participant came back on a second connection before the server
        # noticed the loss of the first (docs/decisions/0014).
        SeatEvent.LOSE: SeatState.ABSENT,
        SeatEvent.RETURN: SeatState.PRESENT,
        SeatEvent.VACATE: SeatState.FREE,
    },
    SeatState.ABSENT: {
        SeatEvent.RETURN: SeatState.PRESENT,
        SeatEvent.VACATE: SeatState.FREE,
    },
}


def next_phase(phase: Phase, event: PhaseEvent) -> Phase:
    """Return the phase after an event, or raise IllegalEventError."""
    try:
        return PHASES[phase][event]
    except KeyError:
        raise IllegalEventError("an episode", phase.name, event.name) from None


def next_seat_state(state: SeatState, event: SeatEvent) -> SeatState:
    """Return the state of a seat after an event, or raise IllegalEventError."""
    try:
        return SEAT_STATES[state][event]
    except KeyError:
        raise IllegalEventError("a seat", state.name, event.name) from None


# A new reason needs a member here and two calls, `Episode.pause` and `resume`; add it to `OUTER` if
# it is not about absent participants (docs/decisions/0015).
class PauseReason(StrEnum):
    """Reason for a pause, in the order in which reasons are shown."""

    OPERATOR = "operator"
    PLAYER = "player"
    """A player in a window of their own opened a card or the help."""
    STORAGE = "storage"
    RESTART = "restart"
    ABSENCE = "absence"
    DESERTED = "deserted"


OUTER = (PauseReason.OPERATOR, PauseReason.PLAYER, PauseReason.STORAGE, PauseReason.RESTART)
"""Reasons other than an absence. While one applies, the time of an absence does not count."""


@dataclass(slots=True)
class PauseReasons:
    """The reasons that apply now, with the times at which they end (None: open)."""

    until: dict[PauseReason, float | None] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.until)

    def __contains__(self, why: PauseReason) -> bool:
        return why in self.until

    @property
    def outer(self) -> bool:
        """True if a reason other than an absence applies."""
        return any(why in self.until for why in OUTER)

    @property
    def shown(self) -> tuple[PauseReason, float | None] | None:
        """The reason to show to participants, and when it ends."""
        for why in PauseReason:
            if why in self.until:
                return why, self.until[why]
        return None

    def due(self) -> float | None:
        """Return when the next reason ends by itself."""
        # An absence behind an outer reason must not wake the server either, or it would tick
        # without effect.
        ends = [end for why, end in self.until.items() if end is not None and self._counts(why)]
        return min(ends, default=None)

    def expired(self, now: float) -> list[PauseReason]:
        """Return the reasons that have come to their end."""
        return [
            why
            for why, end in self.until.items()
            if end is not None and end <= now and self._counts(why)
        ]

    def _counts(self, why: PauseReason) -> bool:
        return why in OUTER or not self.outer


class Stopwatch:
    """Running time of a game, without pauses. All times are in seconds since the start."""

    __slots__ = ("_lost", "_stopped")

    def __init__(self) -> None:
        self._stopped: float | None = None
        self._lost = 0.0

    def stop(self, time: float) -> None:
        """Stop, unless already stopped."""
        if self._stopped is None:
            self._stopped = time

    def go_on(self, time: float) -> None:
        """Run again."""
        if self._stopped is not None:
            # The result must not be negative: recovery reads these times from a file, which may
            # have them in any order.
            self._lost += max(0.0, time - self._stopped)
            self._stopped = None

    def read(self, time: float) -> float:
        """Return the seconds for which the game has run."""
        return (time if self._stopped is None else self._stopped) - self._lost
