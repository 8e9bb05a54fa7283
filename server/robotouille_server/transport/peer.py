"""One connection as the rooms see it: send without waiting, never queue without bound."""

from __future__ import annotations

from collections.abc import Callable

from pydantic import BaseModel
from websockets.protocol import State as Connected

from robotouille.protocol import messages
from robotouille.protocol.codec import Codec
from robotouille_server.runtime.metrics import Metrics
from robotouille_server.runtime.timer_queue import LATE
from robotouille_server.transport.connection import MAX_HELD, MAX_UNSENT, Connection, frame_of

__all__ = ["MAX_HELD", "MAX_UNSENT", "Peer"]

LOOK_AGAIN = 0.05


class Peer:
    """A connection and how far it is behind.

    A client that does not read fills its write buffer; from `MAX_UNSENT` bytes on it gets no more
    deltas, and a snapshot instead once it has caught up, and nothing it says is read. After
    `stall_seconds`, or with more than `MAX_HELD` bytes of anything waiting, it is dropped.
    """

    __slots__ = (
        "_answered",
        "_behind_since",
        "_closing",
        "_looks_at",
        "_metrics",
        "_protocol",
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
        self._transport, self._protocol = socket.transport, socket.protocol
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
        self._looks_at = 0.0
        self._when_caught_up: dict[str, tuple[int, Callable[[], None]]] = {}

    @property
    def open(self) -> bool:
        if self._closing:
            return False
        return self._protocol.state is Connected.OPEN and not self._transport.is_closing()

    @property
    def unsent(self) -> int:
        """Bytes that wait to be taken by the network."""
        size: int = self._transport.get_write_buffer_size()
        return size

    @property
    def latency(self) -> float:
        """Seconds to the client and back, as the last ping took; 0 before the first."""
        return self.socket.latency

    def send(self, message: BaseModel) -> None:
        """Send a message now; dropped silently once the connection is closing."""
        if self.open:
            self.send_frame(frame_of(self.codec.encode(message)))

    def send_frame(self, frame: bytes) -> None:
        """Send a frame that is made already."""
        transport = self._transport
        if self._protocol.state is not Connected.OPEN or transport.is_closing():
            return
        if transport.get_write_buffer_size() > MAX_HELD:
            self.drop("stalled")
            return
        self.sent += 1
        metrics = self._metrics
        metrics.sent_messages += 1
        metrics.sent_bytes += len(frame)
        transport.write(frame)

    def answer(self, message: BaseModel) -> None:
        """Send what was asked for, and is paid for by its size."""
        if self.open:
            self.answer_frame(frame_of(self.codec.encode(message)))

    def answer_frame(self, frame: bytes) -> None:
        """The same with a frame that is made already."""
        self._answered += len(frame)
        self.send_frame(frame)

    def take_answered(self) -> int:
        """Bytes of answers since the last call."""
        answered, self._answered = self._answered, 0
        return answered

    @property
    def behind(self) -> bool:
        """Whether anything waits to be taken by the network, or did a moment ago."""
        return bool(self._when_caught_up) or self.unsent > 0

    def keeps_up(self, catch_up: Callable[[], None]) -> bool:
        """Whether the client may be sent deltas.

        Once it has fallen behind it is not, until it has read what it had; `catch_up` is called
        then. One that does not read in time is cut off.
        """
        if "snapshot" not in self._when_caught_up and self.unsent > MAX_UNSENT:
            self._await("snapshot", 0, catch_up)
        return "snapshot" not in self._when_caught_up

    def throttle(self) -> None:
        """Read no more from a client that does not read what it is answered."""
        if self.unsent > MAX_UNSENT and "reading" not in self._when_caught_up:
            self.socket.pause_reading("unread")
            self._await("reading", MAX_UNSENT, self._read_on)

    def _read_on(self) -> None:
        if self.open:
            self.socket.resume_reading("unread")

    def _await(self, what: str, size: int, then: Callable[[], None]) -> None:
        loop = self.socket.loop
        if not self._when_caught_up:
            self._behind_since = loop.time()
            self._look_later()
        self._when_caught_up[what] = (size, then)

    def _look(self) -> None:
        """Has the client read in the meantime?"""
        if not self.open or self._behind_since is None:
            self._when_caught_up.clear()
            return
        unsent = self.unsent
        for what, (size, then) in list(self._when_caught_up.items()):
            if unsent <= size:
                del self._when_caught_up[what]
                if what == "snapshot":
                    self._metrics.snapshots.inc()
                self.socket.loop.call_soon(then)
        if not self._when_caught_up:
            self._behind_since = None
            return
        now = self.socket.loop.time()
        late = now - self._looks_at
        if late > LATE:  # The server stood still: the client could not be read on.
            self._behind_since += late
        if now > self._behind_since + self._stall_seconds:
            self.drop("stalled")
        else:
            self._look_later()

    def _look_later(self) -> None:
        loop = self.socket.loop
        self._looks_at = loop.time() + LOOK_AGAIN
        loop.call_at(self._looks_at, self._look)

    def close(self, code: str, reason: str, *, retry: bool = False, status: int = 1008) -> None:
        """Send `bye` and close the connection politely, without waiting for the client."""
        self.send(messages.Bye(code=code, reason=reason, retry=retry))
        self._closing = True
        self.socket.say_goodbye(status, reason)

    def drop(self, reason: str) -> None:
        """Cut the connection off without waiting for the client."""
        self.socket.drop(reason)
