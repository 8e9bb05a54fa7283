"""Seats, turn order, clocks as data and the outcome: a state machine without I/O.

The time that an episode is told (`now`) is in seconds, on any clock that never goes back. The
`time` of an event is in seconds since the game began, pauses included.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.episode.episode import Episode
    from robotouille.episode.events import (
        Announced,
        CountdownChanged,
        Departure,
        Ended,
        Event,
        Moderated,
        Moderation,
        Move,
        Noted,
        Outcome,
        Paused,
        QuotaReached,
        ReadinessChanged,
        Reason,
        Rejected,
        RejectionKind,
        Restarted,
        Resumed,
        RosterChanged,
        RoundTripMeasured,
        Said,
        Started,
        Stepped,
    )
    from robotouille.episode.lifecycle import Controller, Phase
    from robotouille.episode.pauses import PauseReason
    from robotouille.episode.recovered_episode import RecoveredEpisode
    from robotouille.episode.rules import Absence, Chat, Clock, Rules, SeatTreatment
    from robotouille.episode.seats import ActionAnswer, Seat
    from robotouille.episode.tallies import Activity, SeatTally
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.episode.rules",
        "robotouille.episode.lifecycle",
        "robotouille.episode.pauses",
        "robotouille.episode.tallies",
        "robotouille.episode.events",
        "robotouille.episode.seats",
        "robotouille.episode.episode",
        "robotouille.episode.recovered_episode",
    )

__all__ = [
    "Absence",
    "ActionAnswer",
    "Activity",
    "Announced",
    "Chat",
    "Clock",
    "Controller",
    "CountdownChanged",
    "Departure",
    "Ended",
    "Episode",
    "Event",
    "Moderated",
    "Moderation",
    "Move",
    "Noted",
    "Outcome",
    "PauseReason",
    "Paused",
    "Phase",
    "QuotaReached",
    "ReadinessChanged",
    "Reason",
    "RecoveredEpisode",
    "Rejected",
    "RejectionKind",
    "Restarted",
    "Resumed",
    "RosterChanged",
    "RoundTripMeasured",
    "Rules",
    "Said",
    "Seat",
    "SeatTally",
    "SeatTreatment",
    "Started",
    "Stepped",
]
