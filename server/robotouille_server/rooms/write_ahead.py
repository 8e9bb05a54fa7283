"""Write-ahead rule: events are published only after they have been written to the recording.

Without this rule, a restarted server could continue from an earlier state than the one that
participants have seen. While the recording cannot be written, the episode is paused, and answers
that would show an unwritten state are held back. Time is an argument: the caller decides when to
retry.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import Protocol

from robotouille.episode import Episode, Event, PauseReason, Phase
from robotouille.errors import ProtocolError

MAX_DEFERRED = 4
"""Maximum number of answers deferred per recipient. Clients repeat requests without an answer."""
MAX_UNWRITTEN = 64 * 1024
"""Unwritten bytes above which participants cannot come back. Each return adds to them."""


class EventLog(Protocol):
    """Log that events are written to; see `Journal`."""

    @property
    def waiting(self) -> int:
        """Bytes that are not written yet."""

    @property
    def problem(self) -> str:
        """Reason why writing fails, or an empty string."""

    def add(self, events: Iterable[Event]) -> None:
        """Add events for the next `write`."""

    def write(self) -> bool:
        """Write everything; return False if that failed and can be retried."""


class CommitGate:
    """Holds back answers that would show an unwritten state, while writing fails."""

    __slots__ = ("_deferred", "_log", "failing")

    def __init__(self, log: EventLog | None) -> None:
        self.failing = False
        self._log = log
        self._deferred: dict[Hashable, list[Callable[[], None]]] = {}

    def when_committed(self, recipient: Hashable, send: Callable[[], None]) -> None:
        """Call `send` now or, while writing fails, when everything is written."""
        if not self.failing:
            send()
        # Further answers are dropped, not queued: a client that asks in a loop must not use up the
        # memory while the disk is full. Clients repeat requests that were not answered.
        elif len(waiting := self._deferred.setdefault(recipient, [])) < MAX_DEFERRED:
            waiting.append(send)

    def forget(self, recipient: Hashable) -> None:
        """Drop the deferred answers to a recipient."""
        self._deferred.pop(recipient, None)

    def release(self) -> None:
        """Send all deferred answers."""
        # The dictionary is replaced first, because an answer may defer another one.
        deferred, self._deferred = self._deferred, {}
        for waiting in deferred.values():
            for send in waiting:
                send()

    def check(self) -> None:
        """Raise ProtocolError `server/recording` while writing fails."""
        if self.failing:
            problem = self._log.problem if self._log is not None else ""
            raise ProtocolError("server/recording", f"{problem}; try again later")

    def check_space(self) -> None:
        """Raise ProtocolError `server/recording` if too many bytes are unwritten."""
        # Every return adds events. A client that reconnects in a loop could otherwise make the
        # unwritten part grow for as long as the disk is full.
        if self._log is not None and self._log.waiting > MAX_UNWRITTEN:
            self.check()


class WriteAhead:
    """Publishes the events of an episode after they are written; at once without a `log`.

    Args:
        episode: The episode.
        log: The recording of the episode, if it has one.
        gate: Is closed while writing fails.
        publish: Called with each event, in order.
        failing_changed: Called when writing starts to fail and when it works again. Until then,
            call `flush` with `retry` from time to time.
    """

    __slots__ = ("_episode", "_failing_changed", "_gate", "_log", "_publish", "_uncommitted")

    def __init__(
        self,
        episode: Episode,
        log: EventLog | None,
        gate: CommitGate,
        publish: Callable[[Event], None],
        failing_changed: Callable[[bool], None],
    ) -> None:
        self._episode = episode
        self._log = log
        self._gate = gate
        self._publish = publish
        self._failing_changed = failing_changed
        self._uncommitted: list[Event] = []

    def flush(self, now: float, *, retry: bool = False) -> list[Event]:
        """Collect, write and publish events; return the published ones."""
        self._collect()
        # The log tries again once per `RETRY_SECONDS`, not at each event, because a failing disk is
        # often slow, too.
        if not self._uncommitted or (self._gate.failing and not retry) or not self._commit(now):
            return []
        # Answers deferred earlier are about states before these events.
        self._gate.release()
        events, self._uncommitted = self._uncommitted, []
        for event in events:
            self._publish(event)
        return events

    def _collect(self) -> None:
        events = self._episode.events()
        if events:
            # The events are encoded at once: the log needs them in the order in which they
            # happened, and encoding them again at each retry would take time from other episodes.
            self._uncommitted += events
            if self._log is not None:
                self._log.add(events)

    def _commit(self, now: float) -> bool:
        if self._log is None or self._log.write():
            return self._committed(now)
        begins = not self._gate.failing
        self._gate.failing = True
        episode = self._episode
        # The pause is an event like any other (docs/decisions/0015): it is recorded once writing
        # works, so the recording explains the gap.
        if PauseReason.STORAGE not in episode.pauses and episode.phase is not Phase.ENDED:
            episode.pause(PauseReason.STORAGE, now)
            self._collect()
        if begins:
            self._failing_changed(True)
        return False

    def _committed(self, now: float) -> bool:
        if self._gate.failing:
            self._gate.failing = False
            self._failing_changed(False)
        if PauseReason.STORAGE not in self._episode.pauses:
            return True
        self._episode.resume(PauseReason.STORAGE, now)
        self._collect()
        # The end of the pause is an event, too. Writing it may fail again.
        return self._commit(now)
