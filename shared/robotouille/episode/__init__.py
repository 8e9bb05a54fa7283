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
from robotouille.episode.pauses import PauseReason
from robotouille.episode.rules import Absence, Clock, Rules
from robotouille.episode.seats import ActionAnswer, Controller, Departure, Seat

__all__ = [
    "Absence",
    "ActionAnswer",
    "Announced",
    "Clock",
    "Controller",
    "Departure",
    "Ended",
    "Episode",
    "Event",
    "Moderated",
    "Move",
    "Outcome",
    "PauseReason",
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
