"""Seats, turn order, clocks as data and the outcome: a state machine without I/O."""

from robotouille.episode.episode import Answer, Episode, Phase, Seat
from robotouille.episode.events import (
    Ended,
    Event,
    Move,
    Outcome,
    Reason,
    Rejected,
    RosterChanged,
    Said,
    SeatTally,
    Started,
    Stepped,
)
from robotouille.episode.rules import Clock, Rules

__all__ = [
    "Answer",
    "Clock",
    "Ended",
    "Episode",
    "Event",
    "Move",
    "Outcome",
    "Phase",
    "Reason",
    "Rejected",
    "RosterChanged",
    "Rules",
    "Said",
    "Seat",
    "SeatTally",
    "Started",
    "Stepped",
]
