"""Publication of an episode's written events: messages, counters, rosters and substitutes."""

from __future__ import annotations

from collections.abc import Callable
from textwrap import shorten

from robotouille.episode import (
    TEAM_TOPIC,
    Absence,
    ActionRejected,
    AnnouncementMade,
    ChatPosted,
    CountdownChanged,
    Episode,
    EpisodeEnded,
    Event,
    Moderated,
    Noted,
    Paused,
    QuotaReached,
    ReadinessChanged,
    Reason,
    Restarted,
    Resumed,
    RoundTripMeasured,
    SeatChanged,
    Started,
    Stepped,
)
from robotouille.protocol.messages.values import MAX_NOTICE
from robotouille.world.grounding.actions import GroundAction
from robotouille_server.rooms.participants.session import Session
from robotouille_server.rooms.publishing.broadcaster import Broadcaster, LongWait
from robotouille_server.rooms.recording.write_ahead import CommitGate
from robotouille_server.rooms.substitutes.substitute import BotScheduler, SubstituteBot
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.timer_queue import TimerHandle, TimerQueue

WAITING_SECONDS = 2.0
"""Seconds after which a step's wait for a seat is announced. Shorter waits are not shown."""


class SlowSeats:
    """Announces the seats for which a step has waited long.

    It checks the episode every `WAITING_SECONDS`, not at each step: steps are frequent, long waits
    are rare.
    """

    __slots__ = ("_episode", "_now", "_publish", "_timer", "_timers", "_wait")

    def __init__(
        self,
        episode: Episode,
        wait: LongWait,
        timers: TimerQueue,
        publish: Callable[[], None],
    ) -> None:
        self._episode = episode
        self._wait = wait
        self._timers = timers
        self._now = timers.time
        self._publish = publish
        self._timer: TimerHandle | None = None

    def begin(self) -> None:
        """Start checking, because the episode runs (again)."""
        # Real-time steps wait for no player, so no player can be slow.
        if self._timer is None and not self._episode.rules.scheduled:
            self._check_at(self._now() + WAITING_SECONDS)

    def stop(self) -> None:
        """Stop checking."""
        if self._timer is not None:
            self._timers.cancel(self._timer)
            self._timer = None

    def follow_up(self) -> None:
        """Publish a roster if an announced wait has ended or is for other seats now."""
        if self._wait.players and self._wait.still != self._wait.players:
            self.publishing()
            self._publish()

    def publishing(self) -> None:
        """Update the announced seats, because a roster is about to be published."""
        if self._wait.players:
            self._wait.players = self._wait.still
            if not self._wait.players:
                self.begin()

    def _check_at(self, due: float) -> None:
        self._timer = self._timers.call_at(due, self._on_time)

    def _on_time(self, due: float) -> None:
        self._timer = None
        episode, now = self._episode, max(due, self._now())
        if not episode.running:
            return  # `begin` is called when the episode runs again.
        waits_for = episode.waits_for
        if not waits_for:
            self._check_at(now + WAITING_SECONDS)
        elif now < (long := episode.step_began + WAITING_SECONDS):
            self._check_at(long)
        else:
            self._wait.players, self._wait.since = waits_for, episode.step_began
            self._publish()


ROSTER_SECONDS = 0.25
"""Minimum time between two rosters that only spectators cause."""


class SpectatorRosters:
    """Limits the rosters that spectators cause by coming and going.

    A roster goes to everybody in the room, so two hundred spectators who arrive together would
    cause forty thousand messages. The first change is published in the next turn of the event
    loop, later ones at most every `ROSTER_SECONDS`, and none while the recording cannot be written.
    """

    __slots__ = ("_gate", "_publish", "_rested_at", "_timer", "_timers", "_wanted")

    def __init__(self, timers: TimerQueue, gate: CommitGate, publish: Callable[[], None]) -> None:
        self._timers = timers
        self._gate = gate
        self._publish = publish
        self._wanted = False
        self._rested_at = timers.time()
        self._timer: TimerHandle | None = None

    def changed(self) -> None:
        """Schedule a roster, because a spectator has come or gone."""
        self._wanted = True
        self._schedule()

    def _schedule(self) -> None:
        if self._timer is None:
            # A timer is used even if the roster is due now, so that all changes in one turn of the
            # event loop share a roster.
            due = max(self._timers.time(), self._rested_at)
            self._timer = self._timers.call_at(due, self._on_time)

    def _on_time(self, due: float) -> None:
        self._timer = None
        # Until everything is written, a roster would show unwritten changes.
        if self._gate.closed:
            self._gate.when_committed(self, self._schedule)
        elif self._wanted:
            self._wanted = False
            self._rested_at = max(due, self._timers.time()) + ROSTER_SECONDS
            # Another node may have the episode, if this process was suspended.
            self._gate.when_committed(self, self._publish)


ABANDONED = (
    "The game has ended: {}. Your actions have been recorded, and there is nothing more for you "
    "to do here. Tell the person who invited you, or join another game with another code."
)


def abandoned_text(detail: str) -> str:
    """Return the message to the participants who remain when others have left."""
    # The detail names everybody who has left, who may be many.
    return ABANDONED.format(shorten(detail, MAX_NOTICE // 2, placeholder=" …"))


class Publisher:
    """Sends events to the participants of a room, counts them, and shows them to substitutes.

    Args:
        episode: The episode.
        broadcaster: Sends the messages.
        metrics: Counts steps and actions.
        timers: The timers of all rooms.
        bot_scheduler: The queue of the server's substitutes.
        substitute: Submits the action of a substitute.
        vacated: Called with a session whose seat became free while it was away.
    """

    __slots__ = ("_broadcaster", "_metrics", "_slow_seats", "_substitutes", "_vacated")

    def __init__(
        self,
        episode: Episode,
        broadcaster: Broadcaster,
        *,
        metrics: Metrics,
        timers: TimerQueue,
        bot_scheduler: BotScheduler,
        substitute: Callable[[str, GroundAction | None], None],
        vacated: Callable[[Session], None],
    ) -> None:
        self._broadcaster = broadcaster
        self._metrics = metrics
        self._vacated = vacated
        self._slow_seats = SlowSeats(
            episode, broadcaster.long_wait, timers, broadcaster.publish_roster_when_owned
        )
        # Under other absence rules no bot observes the steps, so this costs nothing then.
        self._substitutes: list[SubstituteBot] = []
        if episode.rules.absence is Absence.BOT:
            self._substitutes = [
                SubstituteBot(episode, player, bot_scheduler, substitute)
                for player in episode.world.players
            ]

    def publish(self, event: Event) -> None:
        """Publish one event."""
        match event:
            case Stepped():
                self._publish_step(event)
            case ActionRejected():
                self._metrics.rejected += 1
                # Only the participant learns of its own rejection; others see it in the counts of
                # the next roster.
                self._broadcaster.publish_rejection(event)
            case QuotaReached():
                self._broadcaster.publish_quota(event)
            case ChatPosted():
                self._broadcaster.publish_said(event)
            case AnnouncementMade():
                self._broadcaster.publish_notice(event.text)
            case SeatChanged():
                self._publish_seat_change(event)
            case Started() | Paused() | Resumed() | Restarted():
                self._publish_roster()
                # A pause stops the timer for slow seats, so it is started again.
                self._slow_seats.begin()
                for substitute in self._substitutes:
                    substitute.warm()
            case ReadinessChanged() | CountdownChanged():
                self._publish_roster()
            case EpisodeEnded():
                self._metrics.outcomes.labels(event.outcome.reason.value).inc()
                if event.outcome.reason is Reason.ABANDONED:
                    self._broadcaster.publish_notice(abandoned_text(event.outcome.detail))
                self._broadcaster.publish_end(event.outcome)
            case Noted():
                # All other notes are only recorded.
                if event.topic == TEAM_TOPIC:
                    self._broadcaster.publish_told(event)
            case RoundTripMeasured():
                pass  # This is only recorded.
            case Moderated():
                pass  # The participant sees the consequences: `left`, or refused chat messages.

    def follow_up(self) -> None:
        """Announce slow seats and ask substitutes, after all events were published."""
        self._slow_seats.follow_up()
        for substitute in self._substitutes:
            substitute.consider()

    def stop(self) -> None:
        """Stop timers and substitutes, because the episode has ended or was handed over."""
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
        self._slow_seats.publishing()
        self._broadcaster.publish_roster()

    def _publish_seat_change(self, event: SeatChanged) -> None:
        self._publish_roster()
        holder = self._broadcaster.holder(event.player)
        if not event.taken and holder is not None and holder.peer is None:
            self._vacated(holder)
