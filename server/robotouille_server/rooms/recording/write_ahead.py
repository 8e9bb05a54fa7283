"""Write-ahead rule: events are published only after they have been written to the recording.

Without this rule, a restarted server could continue from an earlier state than the one that
participants have seen. A file is written at once; a replicated recording (`robotouille_server.
cluster`) is written when a quorum has it. Until then, answers that would show an unwritten state
are held back, and no more is read from the participants. While the recording cannot be written, the
episode is paused. Time is an argument: the caller decides when to retry.
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


WRITING = "writing"
"""Reason for which a connection is not read; see `Connection.pause_reading`."""


class EventLog(Protocol):
    """Log that events are written to; see `EpisodeJournal`."""

    @property
    def waiting(self) -> int:
        """Bytes that are not written yet."""

    @property
    def problem(self) -> str:
        """Reason why writing fails, or an empty string."""

    def add(self, events: Iterable[Event]) -> None:
        """Add events for the next `write`."""

    def write(self) -> bool:
        """Write everything; return False if that failed (see `problem`) or takes longer."""

    def check_ownership(self) -> bool:
        """Return whether this process certainly still owns the episode; if not, find out.

        The log then reports a change, as after a write.
        """


class Readable(Protocol):
    """Connection that can stop reading; see `Connection`."""

    def pause_reading(self, why: str) -> None: ...

    def resume_reading(self, why: str) -> None: ...


class CommitGate:
    """Holds back answers that would show an unwritten state.

    Attributes:
        closed: True while events are not written.
        failing: True while they cannot be written.
    """

    __slots__ = ("_deferred", "_held", "_log", "closed", "failing")

    def __init__(self, log: EventLog | None) -> None:
        self.closed = self.failing = False
        self._log = log
        self._deferred: dict[Hashable, list[Callable[[], object]]] = {}
        self._held: list[Readable] = []

    @property
    def writing(self) -> bool:
        """True while a write takes longer, but has not failed."""
        return self.closed and not self.failing

    def hold(self, connection: Readable) -> None:
        """Read no more from a connection until everything is written.

        Otherwise, participants who send all the time could keep the gate closed for the others.
        """
        connection.pause_reading(WRITING)
        self._held.append(connection)

    def let_go(self) -> None:
        """Read from all connections again."""
        held, self._held = self._held, []
        for connection in held:
            connection.resume_reading(WRITING)

    def when_committed(self, recipient: Hashable, send: Callable[[], object]) -> None:
        """Call `send` now or, while events are not written, when everything is written."""
        if not self.closed and self._log is not None and not self._log.check_ownership():
            self.closed = True
        if not self.closed:
            send()
        # Further answers are dropped, not queued: a client that asks in a loop must not use up the
        # memory while the disk is full. Clients repeat requests that were not answered.
        elif len(waiting := self._deferred.setdefault(recipient, [])) < MAX_DEFERRED:
            waiting.append(send)

    def forget(self, recipient: Hashable) -> None:
        """Drop the deferred answers to a recipient."""
        self._deferred.pop(recipient, None)

    def release(self) -> None:
        """Open the gate, send all deferred answers, and read from all connections again."""
        self.closed = False
        # The dictionary is replaced first, because an answer may defer another one.
        deferred, self._deferred = self._deferred, {}
        for waiting in deferred.values():
            for send in waiting:
                send()
        self.let_go()

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

    Attributes:
        waited: True if the last events were not written at once.
    """

    __slots__ = (
        "_episode", "_failing_changed", "_gate", "_log", "_publish", "_uncommitted", "waited",
    )  # fmt: skip

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
        self.waited = False

    def flush(self, now: float, *, retry: bool = False) -> list[Event]:
        """Collect, write and publish events; return the published ones."""
        self._collect()
        gate = self._gate
        # The log tries again once per `RETRY_SECONDS`, not at each event, because a failing disk is
        # often slow, too.
        if not (self._uncommitted or gate.closed) or (gate.failing and not retry):
            return []
        if not self._commit(now):
            gate.closed = self.waited = True
            return []
        # Answers deferred earlier are about states before these events.
        if gate.closed:
            gate.release()
        else:
            self.waited = False
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
        """Write all events; return False if some are not written yet."""
        if self._log is None or self._log.write():
            return self._committed(now)
        if self._log.problem:
            self._fail(now)
        return False

    def _fail(self, now: float) -> None:
        begins = not self._gate.failing
        self._gate.failing = True
        # The participants are answered that nothing can be recorded.
        self._gate.let_go()
        episode = self._episode
        # The pause is an event like any other (docs/decisions/0015): it is recorded once writing
        # works, so the recording explains the gap.
        if PauseReason.STORAGE not in episode.pauses and episode.phase is not Phase.ENDED:
            episode.pause(PauseReason.STORAGE, now)
            self._collect()
        if begins:
            self._failing_changed(True)

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
