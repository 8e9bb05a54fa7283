"""Recording of an episode as a journal that all nodes share.

Each write names the journal's last message that its writer knows, and NATS refuses it if there is a
later one. So a node that was stopped, and continues after another one has taken its episode over,
cannot write; and because events are published after they are written, it cannot send anything
either. One write is under way at a time: later events go into the next one.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from itertools import count
from math import inf
from typing import Protocol

from robotouille.episode import Event
from robotouille.replay.recorder import Recorder
from robotouille_server.cluster.bus import (
    Append,
    Bus,
    BusError,
    ConflictError,
    Stored,
    UnavailableError,
)
from robotouille_server.cluster.members import LEASE_SECONDS
from robotouille_server.rooms.recording.journal import is_full
from robotouille_server.runtime.logs import get_logger

MAX_PIECE = 512 * 1024
"""Bytes in one message. NATS refuses messages above 1 MiB, unless it is configured otherwise."""
MAX_TAIL = 256 * 1024
"""Largest number of bytes that `tail` returns."""
LATE_SECONDS = 0.5
"""Seconds without a quorum after which the episode is paused."""
BUSY_SECONDS = 0.25
"""Seconds between two calls of `look` above which this process was too busy to read answers."""
SETTLE_SECONDS = 3.0
"""Seconds to wait for a quorum before an episode is opened or handed over."""
RETRY_SECONDS = 0.5
"""Seconds between two attempts of a write that has failed."""

_numbers = count(1)


class JournalKeeper(Protocol):
    """Node, as its journals see it; see `ClusterNode`."""

    @property
    def bus(self) -> Bus: ...

    @property
    def name(self) -> str:
        """Name of the node."""

    @property
    def lease_certain(self) -> bool:
        """True if no other node can take over this node's episodes now."""

    @property
    def certain_since(self) -> float:
        """Time since which this was so, if it is so now.

        A node that was suspended renews its lease before it learns which episodes it has lost.
        """

    def begun(self, journal: ReplicatedJournal) -> None:
        """Watch a journal: call its `look` from time to time."""

    def written(self, journal: ReplicatedJournal, seconds: float) -> None:
        """Count a write that has taken `seconds`."""

    def fenced(self, journal: ReplicatedJournal) -> None:
        """Give an episode up that another node has taken over."""

    def finish(self, journal: ReplicatedJournal, *, kept: bool) -> asyncio.Future[str]:
        """Turn a complete journal into a file, or delete it."""

    def released(self, journal: ReplicatedJournal) -> None:
        """Stop watching a journal."""


@dataclass(frozen=True, slots=True)
class JournalEnd:
    """End of a journal.

    Attributes:
        sequence: The sequence number of its last message.
        size: The number of bytes that are valid.
        cut: True if it has more bytes than that.
    """

    sequence: int = 0
    size: int = 0
    cut: bool = False


@dataclass(frozen=True, slots=True)
class Tail:
    """Last bytes of a journal.

    Attributes:
        sequence: The sequence number of the journal's last message.
        start: The number of bytes before them.
        data: The bytes.
    """

    sequence: int
    start: int
    data: bytes


@dataclass(slots=True)
class _Write:
    """A write under way.

    Attributes:
        busy: The seconds in which this process could read no answer.
        refusal: The reason that NATS has given for refusing the last attempt.
    """

    message: Append
    begun: float
    busy: float = 0.0
    sent: float = 0.0
    retry_at: float = 0.0
    refusal: str = ""
    asking: bool = field(default=False)


class ReplicatedJournal:
    """`EpisodeJournal` that a quorum of NATS servers stores.

    Args:
        keeper: The node that writes it.
        episode: The episode's id, which is the journal's subject.
        name: The file name of the recording.
        recorder: Encodes events.
        begin: The first bytes of a new journal, or bytes that an existing one lacks.
        end: The end of an existing journal.
    """

    def __init__(
        self,
        keeper: JournalKeeper,
        episode: str,
        name: str,
        recorder: Recorder,
        *,
        begin: bytes = b"",
        end: JournalEnd | None = None,
    ) -> None:
        end = end or JournalEnd()
        self.episode = episode
        self.name = name
        self.recorder = recorder
        self.size = end.size
        self.problem = ""
        self._keeper = keeper
        self._loop = asyncio.get_running_loop()
        self._pending = begin
        self._sequence = end.sequence
        self._last_id = ""
        self._keep = end.size if end.cut else None
        self._write: _Write | None = None
        self._checking = False
        self._released = False
        self._looked = self._loop.time()
        self._owned_at = -inf
        self._quiet_until = 0.0
        self._changed: Callable[[], None] = _nothing
        self._settling: list[asyncio.Future[None]] = []
        self._tail_start, self._tail = 0, bytearray()
        self._keeps_tail = False
        keeper.begun(self)

    @property
    def full(self) -> bool:
        """True if the recording has reached its maximum size."""
        return is_full(self.size, self.recorder.totals)

    @property
    def waiting(self) -> int:
        """Bytes that no quorum has yet."""
        return len(self._pending) + (len(self._write.message.data) if self._write else 0)

    @property
    def settled(self) -> bool:
        """True if a quorum has everything."""
        return self._write is None and not self._pending

    async def stored(self, seconds: float = SETTLE_SECONDS) -> None:
        """Wait until a quorum has everything; raise UnavailableError after `seconds`."""
        if self.settled:
            return
        done: asyncio.Future[None] = self._loop.create_future()
        self._settling.append(done)
        try:
            async with asyncio.timeout(seconds):
                await done
        except TimeoutError:
            raise UnavailableError(self.problem or "NATS has no quorum") from None

    def keep_tail(self) -> None:
        """Keep what is written from now on, for `tail`."""
        self._tail_start, self._tail, self._keeps_tail = self.size, bytearray(), True

    @property
    def tail(self) -> Tail | None:
        """Bytes written since `keep_tail`; None if there are many, or if a quorum lacks some."""
        if not self._keeps_tail or not self.settled or len(self._tail) > MAX_TAIL:
            return None
        return Tail(self._sequence, self._tail_start, bytes(self._tail))

    def listen(self, changed: Callable[[], None]) -> None:
        """Call `changed` when everything is written, and when writing takes too long."""
        self._changed = changed

    def add(self, events: Iterable[Event]) -> None:
        """Encode events for the next `write`."""
        self._pending += self.recorder.record(events)

    def write(self) -> bool:
        """Begin to write everything, unless a write is under way; return whether all is written."""
        if self._released:
            return False
        if self._write is None and (self._pending or self._checking):
            self._begin_write()
        return self._write is None

    def _begin_write(self) -> None:
        data, self._pending = self._pending[:MAX_PIECE], self._pending[MAX_PIECE:]
        # The name of the node is new in every process, so no two writes ever have one id. A node
        # can take an episode back, and NATS stores no second message with an id, but confirms it.
        name = f"{self.episode}.{self._keeper.name}.{next(_numbers)}"
        message = Append(self.episode, data, self._sequence, name, self._keep)
        self._write = _Write(message, self._loop.time())
        self._send(self._write)

    def _send(self, write: _Write) -> None:
        write.retry_at = inf
        write.sent = self._loop.time()
        self._keeper.bus.append(write.message, lambda result: self._answered(write, result))

    def check_ownership(self) -> bool:
        """Return whether this node certainly owns the episode; if not, write to find out."""
        if self._released:
            # The episode has ended. No other node continues it, and nothing is written any more.
            return True
        if self._checking:
            return False
        if self._keeper.lease_certain and self._owned_at >= self._keeper.certain_since:
            return True
        # An empty message is refused like any other if another node has the episode.
        self._checking = True
        self.write()
        return False

    # Answers

    def _answered(self, write: _Write, result: int | BusError) -> None:
        # The episode may have been given up, and an earlier attempt may have been answered.
        if self._released or self._write is not write:
            return
        if isinstance(result, int):
            self._written(write, result)
        elif isinstance(result, ConflictError):
            if not write.asking:
                write.asking = True
                self._loop.create_task(self._ask(write))
        else:
            now = self._loop.time()
            write.retry_at = now + RETRY_SECONDS
            if now - write.sent >= LEASE_SECONDS:
                self._quiet_until = now + LEASE_SECONDS
            write.refusal = str(result)
            self._fails(write.refusal)

    def _written(self, write: _Write, sequence: int) -> None:
        self._write = None
        self._checking = False
        self._owned_at = write.sent
        self._sequence, self._last_id = sequence, write.message.id
        self._keep = None
        self.size += len(write.message.data)
        if self._keeps_tail:
            self._tail += write.message.data
        self._keeper.written(self, self._loop.time() - write.begun)
        # If this process was suspended, the answer is old, and another node may have the episode.
        old = self._loop.time() - write.sent >= LEASE_SECONDS
        if self._pending or old:
            self._begin_write()
            return
        if self.problem:
            get_logger().info("recording works again", file=self.name)
        self.problem = ""
        self._changed()
        if self.settled:
            self._wake()

    def _wake(self) -> None:
        settling, self._settling = self._settling, []
        for done in settling:
            if not done.done():
                done.set_result(None)

    async def _ask(self, write: _Write) -> None:
        """Find out whether a refused write was stored by an earlier attempt, or is too late."""
        write.sent = self._loop.time()
        try:
            last = await self._keeper.bus.last(self.episode)
        except BusError as error:
            write.asking = False
            self._answered(write, error)
            return
        write.asking = False
        if self._released or self._write is not write:
            return
        if last is not None and last.id == write.message.id:
            self._written(write, last.sequence)
        elif last is not None and last.id == self._last_id and last.sequence > self._sequence:
            # An earlier attempt of the last write was stored, too.
            self._sequence = last.sequence
            write.message = replace(write.message, expected=last.sequence)
            self._send(write)
        elif last is not None and last.sequence <= write.message.expected:
            # The answer comes from a server that is behind the others.
            write.retry_at = self._loop.time() + RETRY_SECONDS
        else:
            if last is None:
                get_logger().error("the journal was deleted in NATS", file=self.name)
            self._keeper.fenced(self)

    def look(self, now: float) -> None:
        """Notice that a write takes too long, and try again if it has failed."""
        passed, self._looked = now - self._looked, now
        if passed >= LEASE_SECONDS:
            self._quiet_until = now + LEASE_SECONDS
        write = self._write
        if write is None or self._released:
            return
        if passed >= BUSY_SECONDS:
            write.busy += passed
        if now >= write.retry_at:
            self._send(write)
        if now >= write.begun + write.busy + LATE_SECONDS:
            self._fails(write.refusal or "NATS has no quorum, or cannot be reached")

    def _fails(self, why: str) -> None:
        # After a suspension of this process, another node may have the episode. Until the answers
        # of NATS are read, participants must receive nothing.
        if self._loop.time() < self._quiet_until:
            return
        problem = f"the recording cannot be written: {why}"
        if not self.problem:
            get_logger().error("recording failed", file=self.name, error=problem)
        first, self.problem = not self.problem, problem
        if first:
            self._changed()

    # The end

    def repair_if_changed(self) -> bool:
        """Return False: no other program writes to the journal."""
        return False

    def finish(self, *, kept: bool) -> asyncio.Future[str]:
        """Store the recording as a file and return its name, or delete it if it is not `kept`.

        The end of the episode is written, so this node had it until then, and no other continues
        it.
        """
        self.release()
        return self._keeper.finish(self, kept=kept)

    def release(self) -> None:
        """Write nothing more, so that another node can continue the journal."""
        if not self._released:
            self._released = True
            self._keeper.released(self)
            self._wake()


def _nothing() -> None:
    pass


def assembled(messages: Iterable[Stored]) -> bytes:
    """Return the bytes of a journal."""
    content, known = bytearray(), set[str]()
    for message in messages:
        # NATS may store an attempt and its repetition if its leader changes in between.
        if message.id and message.id in known:
            continue
        known.add(message.id)
        # A node that takes over cuts off what its predecessor has not written completely.
        if message.keep is not None:
            del content[message.keep :]
        content += message.data
    return bytes(content)
