"""What follows from each event of an episode, once it is written."""

from __future__ import annotations

from collections.abc import Callable

from robotouille.episode import (
    Absence,
    Announced,
    CountdownChanged,
    Ended,
    Episode,
    Event,
    Moderated,
    Noted,
    Paused,
    QuotaReached,
    ReadinessChanged,
    Reason,
    Rejected,
    Restarted,
    Resumed,
    RosterChanged,
    RoundTripMeasured,
    Said,
    Started,
    Stepped,
)
from robotouille.world.grounding.actions import GroundAction
from robotouille_server.rooms.broadcast.broadcaster import Broadcaster
from robotouille_server.rooms.seats.slow_seats import SlowSeats
from robotouille_server.rooms.session import Session
from robotouille_server.rooms.substitutes.bot_scheduler import BotScheduler
from robotouille_server.rooms.substitutes.substitute_bot import SubstituteBot
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.timer_queue import TimerQueue

__all__ = ["Publisher"]

ABANDONED = (
    "The game is over: {}. What you have done is kept, and there is nothing more for you to do "
    "here. Tell whoever invited you, or join another game with another code."
)
"""What the partner of somebody who has left is told."""


class Publisher:
    """Sends events to everybody in a room, counts them, and lets substitute bots see them.

    `substitute` submits what a substitute bot does; `away` is called with a session whose seat has
    become free while it was away.
    """

    __slots__ = ("_away", "_broadcaster", "_metrics", "_slow_seats", "_substitutes")

    def __init__(
        self,
        episode: Episode,
        broadcaster: Broadcaster,
        *,
        metrics: Metrics,
        timers: TimerQueue,
        bot_scheduler: BotScheduler,
        substitute: Callable[[str, GroundAction | None], None],
        away: Callable[[Session], None],
    ) -> None:
        self._broadcaster = broadcaster
        self._metrics = metrics
        self._away = away
        self._slow_seats = SlowSeats(episode, timers, broadcaster.publish_roster)
        self._substitutes: list[SubstituteBot] = []
        broadcaster.waits_for = lambda: self._slow_seats.still
        if episode.rules.absence is Absence.BOT:
            self._substitutes = [
                SubstituteBot(episode, player, bot_scheduler, substitute)
                for player in episode.world.players
            ]

    def publish(self, event: Event) -> None:
        """Send one event to those whom it concerns."""
        match event:
            case Stepped():
                self._publish_step(event)
            case Rejected():
                self._metrics.rejected += 1
                self._broadcaster.publish_rejection(event)
            case QuotaReached():
                self._broadcaster.publish_quota(event)
            case Said():
                self._broadcaster.publish_said(event)
            case Announced():
                self._broadcaster.publish_notice(event.text)
            case RosterChanged():
                self._publish_roster_change(event)
            case Started() | Paused() | Resumed() | Restarted():
                self._publish_roster()
                self._slow_seats.begin()
                for substitute in self._substitutes:
                    substitute.warm()
            case ReadinessChanged() | CountdownChanged():
                self._publish_roster()
            case Ended():
                self._metrics.outcomes.labels(event.outcome.reason.value).inc()
                if event.outcome.reason is Reason.ABANDONED:
                    self._broadcaster.publish_notice(ABANDONED.format(event.outcome.detail))
                self._broadcaster.publish_end(event.outcome)
            case Noted() | RoundTripMeasured():
                pass  # It is for the recording.
            case Moderated():
                pass  # Whom it concerns is told by what follows from it.

    def follow_up(self) -> None:
        """All is published: whom the step waits for now, and which bots have to decide."""
        if self._slow_seats.waits_for:
            self._slow_seats.check()
        for substitute in self._substitutes:
            substitute.consider()

    def stop(self) -> None:
        """Nothing more happens in the episode, or not here."""
        self._slow_seats.stop()
        for substitute in self._substitutes:
            substitute.stop()

    def _publish_step(self, event: Stepped) -> None:
        metrics = self._metrics
        metrics.steps += 1
        for attempt in event.attempts:
            if attempt.applied:
                metrics.applied += 1
            else:
                metrics.rejected += 1
        self._broadcaster.publish_step(event)
        for substitute in self._substitutes:
            substitute.observe(event)

    def _publish_roster(self) -> None:
        self._slow_seats.published()
        self._broadcaster.publish_roster()

    def _publish_roster_change(self, event: RosterChanged) -> None:
        self._publish_roster()
        holder = self._broadcaster.holder(event.player)
        if not event.taken and holder is not None and holder.peer is None:
            self._away(holder)
