"""State machines of an episode and of a seat, as tables, and the values that name a seat's state.

A transition that is not in a table cannot happen: `next_phase` and `next_seat_state` raise, and the
caller's state does not change.

This module imports no models, so that command lines can use its values without a slow start.
"""

from __future__ import annotations

from collections.abc import Mapping
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
