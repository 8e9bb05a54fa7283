"""Seats, turn order, clocks as data and the outcome: a state machine without I/O."""

from robotouille.episode.episode import Episode, Phase
from robotouille.episode.events import (
    Announced,
    Ended,
    Event,
    Moderated,
    Move,
    Outcome,
    Paused,
    QuotaReached,
    Reason,
    Rejected,
    Restarted,
    Resumed,
    RosterChanged,
    Said,
    SeatTally,
    Started,
    Stepped,
)
from robotouille.episode.pauses import Hold
from robotouille.episode.rules import Absence, Clock, Rules
from robotouille.episode.seats import Answer, Controller, Departure, Seat

__all__ = [
    "Absence",
    "Announced",
    "Answer",
    "Clock",
    "Controller",
    "Departure",
    "Ended",
    "Episode",
    "Event",
    "Hold",
    "Moderated",
    "Move",
    "Outcome",
    "Paused",
    "Phase",
    "QuotaReached",
    "Reason",
    "Rejected",
    "Restarted",
    "Resumed",
    "RosterChanged",
    "Rules",
    "Said",
    "Seat",
    "SeatTally",
    "Started",
    "Stepped",
]
