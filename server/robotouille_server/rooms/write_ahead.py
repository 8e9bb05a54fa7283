"""The write-ahead rule: nothing is published before it is written.

What an episode has to report is collected, committed to its recording, and only then published.
While the recording fails, the episode is paused; its events wait, and so does whatever would show
somebody a state that is not written. No clock and no timer is kept here: the caller says what time
it is, and when to try again.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import Protocol

from robotouille.episode import Episode, Event, PauseReason, Phase
from robotouille.errors import ProtocolError

__all__ = ["MAX_DEFERRED", "MAX_UNWRITTEN", "EventLog", "WriteAhead"]

MAX_DEFERRED = 4
"""Answers to one recipient that wait for the recording; more are asked for again."""
MAX_UNWRITTEN = 64 * 1024
"""Bytes of a failing recording that may wait; until they are written nobody can come back."""


class EventLog(Protocol):
    """Where events are written: see `Journal`."""

    @property
    def waiting(self) -> int:
        """Bytes that are not written yet."""

    @property
    def problem(self) -> str:
        """Why they are not; empty while all is well."""

    def add(self, events: Iterable[Event]) -> None:
        """Take events, for the next `write`."""

    def write(self) -> bool:
        """Write all that waits; False if that failed, and it may be tried again."""


class WriteAhead:
    """Publishes the events of an episode once they are written; at once where there is no `log`.

    `publish` is called for each event, in order; `failing_changed` when writing begins to fail and
    when it works again. While `failing` is true, `flush` has to be called with `retry` from time to
    time.
    """

    __slots__ = (
        "_deferred",
        "_episode",
        "_failing_changed",
        "_log",
        "_publish",
        "_uncommitted",
        "failing",
    )

    def __init__(
        self,
        episode: Episode,
        log: EventLog | None,
        publish: Callable[[Event], None],
        failing_changed: Callable[[bool], None],
    ) -> None:
        self.failing = False
        self._episode = episode
        self._log = log
        self._publish = publish
        self._failing_changed = failing_changed
        self._uncommitted: list[Event] = []
        self._deferred: dict[Hashable, list[Callable[[], None]]] = {}

    def flush(self, now: float, *, retry: bool = False) -> list[Event]:
        """Collect, commit, publish; the events that were published, none while writing fails."""
        self.collect()
        if not self._uncommitted or (self.failing and not retry) or not self.commit(now):
            return []
        self._send_deferred()
        events, self._uncommitted = self._uncommitted, []
        for event in events:
            self._publish(event)
        return events

    def collect(self) -> None:
        """Take what has happened in the episode."""
        events = self._episode.events()
        if events:
            self._uncommitted += events
            if self._log is not None:
                self._log.add(events)

    def commit(self, now: float) -> bool:
        """Write what was collected; where that fails, the episode is paused until it works."""
        if self._log is None or self._log.write():
            return self._committed(now)
        begins = not self.failing
        self.failing = True
        episode = self._episode
        if PauseReason.STORAGE not in episode.pauses and episode.phase is not Phase.ENDED:
            episode.pause(PauseReason.STORAGE, now)
            self.collect()
        if begins:
            self._failing_changed(True)
        return False

    def _committed(self, now: float) -> bool:
        if self.failing:
            self.failing = False
            self._failing_changed(False)
        if PauseReason.STORAGE not in self._episode.pauses:
            return True
        self._episode.resume(PauseReason.STORAGE, now)
        self.collect()
        return self.commit(now)  # The end of the pause is recorded, too.

    # What shows somebody the state

    def when_committed(self, recipient: Hashable, send: Callable[[], None]) -> None:
        """Call `send` now or, while writing fails, when all is written."""
        if not self.failing:
            send()
        elif len(waiting := self._deferred.setdefault(recipient, [])) < MAX_DEFERRED:
            waiting.append(send)

    def forget(self, recipient: Hashable) -> None:
        """Somebody waits for nothing any more."""
        self._deferred.pop(recipient, None)

    def _send_deferred(self) -> None:
        deferred, self._deferred = self._deferred, {}
        for waiting in deferred.values():
            for send in waiting:
                send()

    # What cannot be had while writing fails

    def check(self) -> None:
        """ProtocolError `server/recording` while writing fails."""
        if self.failing:
            problem = self._log.problem if self._log is not None else ""
            raise ProtocolError("server/recording", f"{problem}; try again later")

    def check_space(self) -> None:
        """The same, once so much waits that no coming and going can be recorded any more."""
        if self._log is not None and self._log.waiting > MAX_UNWRITTEN:
            self.check()
