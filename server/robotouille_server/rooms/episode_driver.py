"""Driver of one episode: applies changes and clock ticks, then records and publishes the events."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from robotouille.episode import Episode, Event, Phase, Stepped
from robotouille.errors import TooHardError
from robotouille.world.grounding.actions import GroundAction
from robotouille_server.rooms.membership import Membership
from robotouille_server.rooms.participants.seat_limits import RoundTrips
from robotouille_server.rooms.publishing.broadcaster import Broadcaster
from robotouille_server.rooms.publishing.publisher import Publisher
from robotouille_server.rooms.recording.journal import EpisodeJournal
from robotouille_server.rooms.recording.write_ahead import CommitGate, WriteAhead
from robotouille_server.rooms.substitutes.substitute import BotScheduler
from robotouille_server.runtime.budgets import STEP_COST
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.timer_queue import TimerHandle, TimerQueue
from robotouille_server.runtime.weak_calls import weakly
from robotouille_server.transport import LoopBudget

RETRY_SECONDS = 1.0
"""Seconds between two attempts to write a failing recording."""
TICKS_WHILE_WRITING = 2
"""Ticks of a real-time game between two writes that take time. Each may take `MAX_LATE_AT_ONCE`
late steps. With one tick, writes of 50 ms would slow a fast game down; with all of a backlog, the
game would delay the steps of others."""


@dataclass(frozen=True, slots=True)
class Machinery:
    """Parts of a server that all its rooms share."""

    metrics: Metrics
    timers: TimerQueue
    loop_budget: LoopBudget
    bot_scheduler: BotScheduler


@dataclass(frozen=True, slots=True)
class EpisodeParts:
    """Parts of one room that its driver connects."""

    episode: Episode
    journal: EpisodeJournal | None
    gate: CommitGate
    broadcaster: Broadcaster
    membership: Membership


class EpisodeDriver:
    """Applies changes to an episode, then writes and publishes what happened.

    Args:
        episode_id: The id of the episode, for the log.
        parts: The parts of the room.
        machinery: The parts of the server that all rooms share.
        published: Called with the events of each flush.
        ended: Called once, when the episode has ended.
    """

    __slots__ = (
        "__weakref__",
        "_broadcaster",
        "_ended",
        "_episode",
        "_gate",
        "_id",
        "_journal",
        "_loop",
        "_loop_budget",
        "_metrics",
        "_open",
        "_published",
        "_publisher",
        "_retry",
        "_round_trips",
        "_timer",
        "_timers",
        "_turn_awaited",
        "_write_ahead",
        "now",
    )

    def __init__(
        self,
        episode_id: str,
        parts: EpisodeParts,
        machinery: Machinery,
        *,
        published: Callable[[list[Event]], None],
        ended: Callable[[], None],
    ) -> None:
        self._id = episode_id
        self._episode = parts.episode
        self._journal = parts.journal
        self._gate = parts.gate
        self._broadcaster = parts.broadcaster
        self._metrics = machinery.metrics
        self._timers = machinery.timers
        self.now = machinery.timers.time
        self._published = published
        self._ended = ended
        self._loop = asyncio.get_running_loop()
        self._loop_budget = machinery.loop_budget
        self._timer: TimerHandle | None = None
        self._turn_awaited = False
        self._retry: asyncio.TimerHandle | None = None
        self._round_trips = RoundTrips()
        self._publisher = Publisher(
            parts.episode,
            parts.broadcaster,
            metrics=machinery.metrics,
            timers=machinery.timers,
            bot_scheduler=machinery.bot_scheduler,
            substitute=weakly(self._substitute),
            vacated=parts.membership.vacate,
        )
        self._write_ahead = WriteAhead(
            parts.episode,
            parts.journal,
            parts.gate,
            self._publisher.publish,
            weakly(self._failing_changed),
        )
        self._open = True
        if parts.journal is not None:
            parts.journal.listen(weakly(self._journal_changed))

    def apply(self, change: Callable[..., object], *arguments: Any, **options: Any) -> None:
        """Call `change(*arguments, now, **options)`, then write and publish what happened."""
        now = self.now()
        try:
            change(*arguments, now, **options)
        except TooHardError as error:
            self._give_up(error, now)
        self._flush(now)

    def _give_up(self, error: TooHardError, now: float) -> None:
        """End an episode whose goal cannot be checked, or that has created too many objects."""
        get_logger().error("the episode failed", episode=self._id, error=str(error))
        self._episode.abort(now, detail=str(error))

    def abort(self, reason: str) -> None:
        """End the episode."""
        self.apply(self._episode.abort, detail=reason)

    def _substitute(self, player: str, action: GroundAction | None) -> None:
        self.apply(self._episode.substitute, player, action)

    def measure_round_trips(self) -> bool:
        """Record the round trips that have changed; publish a roster if they changed much.

        Returns:
            True if anything was recorded or published.
        """
        # Round trips are events, and while writing fails, the unwritten events must not grow.
        if not self._episode.running or self._gate.failing:
            return False
        shown, recorded = self._round_trips.measure(self._broadcaster.members)
        if shown:
            self._broadcaster.publish_roster_when_owned()
        for player, seconds in recorded:
            self._episode.note_round_trip(player, seconds, self.now())
        if recorded:
            self.flush()
        return shown or bool(recorded)

    # Time

    def _schedule(self) -> None:
        due = self._episode.due()
        if self._timer is not None:
            # Most changes do not move the deadline, and cancelling a timer costs more than
            # comparing.
            if due == self._timer.due:
                return
            self._timers.cancel(self._timer)
            self._timer = None
        if due is None:
            return
        if self._episode.behind:
            self._await_turn()
        else:
            self._timer = self._timers.call_at(due, self._on_time)

    def _await_turn(self) -> None:
        """Take the next steps of a backlog when all connections have had their turn."""
        # Timers come before connections, so a long backlog would keep the server from reading.
        if not self._turn_awaited:
            self._turn_awaited = True
            self._loop_budget.wait(self._on_turn, self)

    def _on_turn(self) -> None:
        self._turn_awaited = False
        # An action or a pause may have come first; `_flush` has then set the timer.
        if not self._open or not self._episode.behind:
            return
        before, due = self._episode.step, self._episode.due()
        self._on_time(self.now() if due is None else due)
        self._loop_budget.spend((self._episode.step - before) * STEP_COST)

    def _on_time(self, due: float) -> None:
        self._timer = None
        # The step waits for the last one to be written; `_flush` then sets the timer again.
        if self._gate.closed:
            return
        now = self.now()
        # Only the lateness of real-time steps is measured: no player notices other late timers.
        if self._episode.rules.scheduled and self._episode.running:
            self._metrics.lateness.observe(max(0.0, now - due))
        try:
            # The maximum is needed, because a timer of the event loop may fire a little before
            # `due`.
            self._tick(max(now, due))
            self._flush(now)
        except Exception:
            self._fail()

    def _tick(self, now: float) -> None:
        try:
            for _ in range(TICKS_WHILE_WRITING if self._write_ahead.waited else 1):
                self._episode.tick_briefly(now)
                if not self._episode.behind:
                    break
        except TooHardError as error:
            self._give_up(error, now)

    def _fail(self) -> None:
        """End the episode after an internal error, so that all others continue."""
        get_logger().exception("the episode failed", episode=self._id)
        self.abort("internal error")

    # Publishing

    def flush(self, *, retry: bool = False) -> None:
        """Write and publish the new events, and set the timer of the next tick."""
        self._flush(self.now(), retry=retry)

    def _flush(self, begun: float, *, retry: bool = False) -> None:
        if not self._open:
            return
        events = self._write_ahead.flush(begun, retry=retry)
        if events:
            self._after_publishing(events, begun)
        if not self._open:
            return
        if self._gate.failing:
            # The episode needs no timer: it is paused while the recording cannot be written.
            self._retry_later()
            return
        if self._gate.closed:
            return
        self._schedule()
        self._publisher.follow_up()

    def _after_publishing(self, events: list[Event], begun: float) -> None:
        if isinstance(events[0], Stepped):
            self._metrics.age.observe(self.now() - begun)
        self._published(events)
        if self._episode.phase is Phase.ENDED:
            # The driver stops here. The lobby closes the recording, in a thread.
            self._close()
        # Readers refuse longer files, so the episode must end now, or all of it would be lost.
        elif self._journal is not None and self._journal.full:
            self.abort("the recording has reached its maximum size")

    def _retry_later(self) -> None:
        if self._retry is None:
            self._retry = self._loop.call_later(RETRY_SECONDS, self._write_again)

    def _write_again(self) -> None:
        self._retry = None
        self._journal_changed()

    def _journal_changed(self) -> None:
        try:
            self.flush(retry=True)
        except Exception:
            self._fail()

    def _failing_changed(self, failing: bool) -> None:
        if failing:
            # Participants learn of the failure at once. The roster shows the state published last,
            # because later events are not written yet.
            self._metrics.failing.inc()
            self._broadcaster.publish_unwritable()
        else:
            self._metrics.failing.dec()

    # The end

    def suspend(self) -> None:
        """Stop without ending the episode; another process continues the recording."""
        self._stop()
        if self._journal is not None:
            # Nothing is recorded any more, so nobody may receive an answer about a later state.
            self._gate.closed = True
            # Releasing the lock on the file tells the next process that it may continue.
            self._journal.release()

    def _stop(self) -> None:
        self._open = False
        if self._timer is not None:
            self._timers.cancel(self._timer)
        if self._retry is not None:
            self._retry.cancel()
        self._publisher.stop()

    def _close(self) -> None:
        self._stop()
        self._ended()
        outcome = self._episode.outcome
        get_logger().info(
            "episode ended",
            episode=self._id,
            task=self._episode.world.task.name,
            reason=outcome.reason.value if outcome else "",
            steps=self._episode.step,
        )
