"""The life cycles of an episode and of a seat: two literal tables, and the steps along them; who
moves a seat.

What stands in no row cannot happen: `next_phase` and `next_seat_state` raise, and whoever asked
stays where it was.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum, StrEnum, auto

from robotouille.errors import IllegalEventError

__all__ = [
    "PHASES",
    "SEAT_STATES",
    "Controller",
    "Phase",
    "PhaseEvent",
    "SeatEvent",
    "SeatState",
    "next_phase",
    "next_seat_state",
]


class Phase(StrEnum):
    """The life of an episode; the values are those on the wire."""

    WAITING = "waiting"
    RUNNING = "running"
    PAUSED = "paused"
    ENDED = "over"


class PhaseEvent(Enum):
    """What moves an episode from one phase to another.

    START: everybody is there and ready. PAUSE: there is a reason to stand still, or another than
    before. RESUME: there is none any more. END: it has an outcome.
    """

    START = auto()
    PAUSE = auto()
    RESUME = auto()
    END = auto()


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
        PhaseEvent.RESUME: Phase.RUNNING,
        PhaseEvent.END: Phase.ENDED,
    },
    Phase.ENDED: {},
}


class SeatState(Enum):
    """Whose a seat is: nobody's, or somebody's who is here or away."""

    FREE = auto()
    PRESENT = auto()
    ABSENT = auto()


class Controller(StrEnum):
    """Who moves a seat: its participant (by kind), nobody, or a bot in an absent one's place."""

    FREE = ""
    HUMAN = "human"
    BOT = "bot"
    MODEL = "model"
    ABSENT = "absent"
    STAND_IN = "stand-in"


class SeatEvent(Enum):
    """What changes a seat.

    TAKE: somebody sits down. LOSE: the connection is lost. RETURN: it is back, or another takes
    its place. VACATE: the seat is given up for good.
    """

    TAKE = auto()
    LOSE = auto()
    RETURN = auto()
    VACATE = auto()


SEAT_STATES: Mapping[SeatState, Mapping[SeatEvent, SeatState]] = {
    SeatState.FREE: {
        SeatEvent.TAKE: SeatState.PRESENT,
    },
    SeatState.PRESENT: {
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
    """The phase after an event; IllegalEventError where it cannot happen."""
    try:
        return PHASES[phase][event]
    except KeyError:
        raise IllegalEventError("an episode", phase.name, event.name) from None


def next_seat_state(state: SeatState, event: SeatEvent) -> SeatState:
    """The state of a seat after an event; IllegalEventError where it cannot happen."""
    try:
        return SEAT_STATES[state][event]
    except KeyError:
        raise IllegalEventError("a seat", state.name, event.name) from None
