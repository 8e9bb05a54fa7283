"""Connection as rooms see it: sending never waits, and unsent data is bounded."""

from __future__ import annotations

from collections.abc import Callable

from pydantic import BaseModel

from robotouille.protocol import messages
from robotouille.protocol.codec import Codec
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.timer_queue import LATE
from robotouille_server.transport.connection import MAX_HELD, MAX_UNSENT, Connection, frame_of

__all__ = ["MAX_HELD", "MAX_UNSENT", "Peer"]

CHECK_SECONDS = 0.05
"""Seconds between two checks whether a slow client has caught up."""


class Peer:
    """Connection that skips deltas while its client is slow.

    Above `MAX_UNSENT` unsent bytes, a client receives no deltas, and nothing is read from it. When
    it has caught up, it receives a snapshot instead of the missed deltas. After `stall_seconds`, or
    above `MAX_HELD` unsent bytes, it is disconnected.
    """

    __slots__ = (
        "_answered",
        "_behind_since",
        "_checks_at",
        "_closing",
        "_metrics",
        "_stall_seconds",
        "_transport",
        "_when_caught_up",
        "codec",
        "received",
        "received_bytes",
        "sent",
        "snapshot_due",
        "snapshot_sent",
        "socket",
    )

    def __init__(
        self, socket: Connection, codec: Codec, metrics: Metrics, stall_seconds: float
    ) -> None:
        self.socket = socket
        self._transport = socket.transport
        self.codec = codec
        self.sent = 0
        self.received = 0
        self.snapshot_sent = self.snapshot_due = False
        self._answered = 0
        self.received_bytes = 0
        self._metrics = metrics
        self._stall_seconds = stall_seconds
        self._closing = False
        self._behind_since: float | None = None
        self._checks_at = 0.0
        self._when_caught_up: dict[str, tuple[int, Callable[[], None]]] = {}

    @property
    def open(self) -> bool:
        return self.socket.open and not self._closing and not self._transport.is_closing()

    @property
    def unsent(self) -> int:
        """Bytes that the network has not accepted yet."""
        size: int = self._transport.get_write_buffer_size()
        return size

    @property
    def latency(self) -> float:
        """Round trip of the last ping in seconds; 0 before the first."""
        return self.socket.latency

    def send(self, message: BaseModel) -> None:
        """Send a message at once; drop it if the connection is closing."""
        # The check comes first, because encoding costs more.
        if self.open:
            self.send_frame(frame_of(self.codec.encode(message)))

    def send_frame(self, frame: bytes, count: int = 1) -> None:
        """Send an encoded frame, or several in one write."""
        transport = self._transport
        if self._closing or not self.socket.open or transport.is_closing():
            return
        # Chat and rosters are never skipped, so a reader that stops altogether is disconnected
        # (docs/decisions/0006).
        if transport.get_write_buffer_size() > MAX_HELD:
            self.drop("stalled")
            return
        self.sent += count
        metrics = self._metrics
        # These are plain attributes, because this runs for every message of every recipient, and a
        # Prometheus counter takes a lock.
        metrics.sent_messages += count
        metrics.sent_bytes += len(frame)
        transport.write(frame)

    def answer(self, message: BaseModel) -> None:
        """Send an answer whose size is charged to the client's message budget."""
        if self.open:
            self.answer_frame(frame_of(self.codec.encode(message)))

    def answer_frame(self, frame: bytes) -> None:
        """Send an encoded frame as `answer` does."""
        # Short requests can have long answers; charging only the request would let a client make
        # the server send a hundred times what it sends.
        self._answered += len(frame)
        self.send_frame(frame)

    def take_answered(self) -> int:
        """Return the bytes of answers since the last call."""
        answered, self._answered = self._answered, 0
        return answered

    @property
    def behind(self) -> bool:
        """True if there is unsent data, or was at the last check."""
        return bool(self._when_caught_up) or self.unsent > 0

    def keeps_up(self, catch_up: Callable[[], None]) -> bool:
        """Return whether the client may receive deltas.

        A client that has fallen behind may not until it has read everything; `catch_up` is called
        then.
        """
        # Deltas are not queued: when the client has read everything, one snapshot replaces the
        # missed ones.
        if "snapshot" not in self._when_caught_up and self.unsent > MAX_UNSENT:
            self._await("snapshot", 0, catch_up)
        return "snapshot" not in self._when_caught_up

    def throttle(self) -> None:
        """Stop reading from a client that does not read its answers."""
        if self.unsent > MAX_UNSENT and "reading" not in self._when_caught_up:
            # A client that sends requests and does not read the answers would otherwise fill its
            # buffer up to `MAX_HELD`.
            self.socket.pause_reading("unread")
            self._await("reading", MAX_UNSENT, self._read_on)

    def _read_on(self) -> None:
        if self.open:
            self.socket.resume_reading("unread")

    def _await(self, what: str, size: int, then: Callable[[], None]) -> None:
        loop = self.socket.loop
        if not self._when_caught_up:
            self._behind_since = loop.time()
            self._check_later()
        self._when_caught_up[what] = (size, then)

    def _check(self) -> None:
        if not self.open or self._behind_since is None:
            self._when_caught_up.clear()
            return
        unsent = self.unsent
        for what, (size, then) in list(self._when_caught_up.items()):
            # A snapshot waits for an empty buffer, so it is not sent after old data. Reading
            # continues earlier, at `MAX_UNSENT`.
            if unsent <= size:
                del self._when_caught_up[what]
                if what == "snapshot":
                    self._metrics.snapshots.inc()
                # `then` gets a turn of its own, because it may send a long snapshot, and other
                # peers are checked in this turn.
                self.socket.loop.call_soon(then)
        if not self._when_caught_up:
            self._behind_since = None
            return
        now = self.socket.loop.time()
        late = now - self._checks_at
        if late > LATE:  # The server was suspended, so the client could not catch up.
            self._behind_since += late
        if now > self._behind_since + self._stall_seconds:
            self.drop("stalled")
        else:
            self._check_later()

    def _check_later(self) -> None:
        loop = self.socket.loop
        self._checks_at = loop.time() + CHECK_SECONDS
        # The buffer is polled, because there are two thresholds and a time-out, and transports call
        # back for one threshold only.
        loop.call_at(self._checks_at, self._check)

    def close(self, code: str, reason: str, *, retry: bool = False, status: int = 1008) -> None:
        """Send `bye` and a close frame, without waiting for the client."""
        self.send(messages.Bye(code=code, reason=reason, retry=retry))
        # After `bye`, nothing else may be sent, although the socket is still open for a moment.
        self._closing = True
        self.socket.say_goodbye(status, reason)

    def drop(self, reason: str) -> None:
        """Abort the connection."""
        self.socket.drop(reason)
