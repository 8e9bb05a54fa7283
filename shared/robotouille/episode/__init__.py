"""Episodes: seats, clocks, rules and outcomes, as a state machine without I/O."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille.episode.episode import Episode
    from robotouille.episode.events import (
        TEAM_TOPIC,
        ActionRejected,
        AnnouncementMade,
        ChatPosted,
        CountdownChanged,
        Departure,
        EpisodeEnded,
        Event,
        Moderated,
        Moderation,
        Noted,
        Outcome,
        Paused,
        PlayedMove,
        QuotaReached,
        ReadinessChanged,
        Reason,
        RejectionKind,
        Restarted,
        Resumed,
        RoundTripMeasured,
        SeatChanged,
        Started,
        Stepped,
    )
    from robotouille.episode.lifecycle import Absence, Controller, PauseReason, Phase
    from robotouille.episode.record import EpisodeRecord, RandomReversal
    from robotouille.episode.rules import Chat, Clock, Rules, SeatTreatment
    from robotouille.episode.seats import ActionAnswer, ActionRequest, Seat
    from robotouille.episode.tallies import Activity, SeatTally
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille.episode.rules",
        "robotouille.episode.lifecycle",
        "robotouille.episode.tallies",
        "robotouille.episode.events",
        "robotouille.episode.seats",
        "robotouille.episode.episode",
        "robotouille.episode.record",
    )

__all__ = [
    "TEAM_TOPIC",
    "Absence",
    "ActionAnswer",
    "ActionRejected",
    "ActionRequest",
    "Activity",
    "AnnouncementMade",
    "Chat",
    "ChatPosted",
    "Clock",
    "Controller",
    "CountdownChanged",
    "Departure",
    "Episode",
    "EpisodeEnded",
    "EpisodeRecord",
    "Event",
    "Moderated",
    "Moderation",
    "Noted",
    "Outcome",
    "PauseReason",
    "Paused",
    "Phase",
    "PlayedMove",
    "QuotaReached",
    "RandomReversal",
    "ReadinessChanged",
    "Reason",
    "RejectionKind",
    "Restarted",
    "Resumed",
    "RoundTripMeasured",
    "Rules",
    "Seat",
    "SeatChanged",
    "SeatTally",
    "SeatTreatment",
    "Started",
    "Stepped",
]
