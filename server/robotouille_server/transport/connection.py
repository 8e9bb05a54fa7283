"""WebSocket connections, before and after their first byte.

An accepted connection is a `PendingConnection`, which needs little memory, until its first byte
arrives. A `Connection` then delivers messages at once and limits all other frames.

There is no queue and no task per message: with a thousand messages a second, waking tasks would
take more time than the messages. Frames are examined before the library's parser sees them. Whole
messages go straight to the receiver. All other frames (control frames and fragments) are limited.
"""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable
from typing import Any, cast

from websockets.asyncio.server import Server, ServerConnection
from websockets.frames import Frame
from websockets.protocol import State
from websockets.server import ServerProtocol

from robotouille.protocol.codec import MAX_CLIENT_BYTES
from robotouille.protocol.frames import (
    BINARY,
    CLOSE,
    CONTINUATION,
    FIN,
    PING,
    TEXT,
    FrameError,
    FrameReader,
    pack_frame,
)
from robotouille_server.runtime.budgets import TokenBucket
from robotouille_server.runtime.process_limits import few_left
from robotouille_server.transport.admission import TURN_SECONDS, Admission

MAX_OWN = 2 * MAX_CLIENT_BYTES
"""Maximum size of a frame; larger messages are answered by an error."""
MAX_REQUEST = 16 * 1024
"""Maximum size of the HTTP request, and of the data that follows before it is answered."""
REQUEST_COST = 4.0
"""Cost of a handshake, in frames."""
MAX_UNSENT = 128 * 1024
"""Unsent bytes above which a client receives no deltas and no pongs."""
MAX_HELD = 1024 * 1024
"""Unsent bytes above which a client is disconnected."""

MAX_PARTS = 1024
"""Maximum number of fragments of a message."""
FRAMES_AT_A_TIME, SECONDS_AT_A_TIME = 32, TURN_SECONDS / 4
"""Frames of one connection, and time for them, after which all others get a turn."""
FRAMES_A_SECOND = 50.0
"""Control frames and fragments per second. Each KiB of a fragment counts as one more."""
FRAMES_BURST = 200.0
MAX_EXCESS = 200
"""Frames above that rate after which a client is disconnected."""

MESSAGES = (FIN | BINARY, FIN | TEXT)
"""First bytes of frames that contain a whole message."""
DATA = (CONTINUATION, TEXT, BINARY)
GIVE_WAY = "others first"
END_OF_REQUEST = b"\r\n\r\n"


def cut(reason: str) -> str:
    """Shorten a reason for a close frame (RFC 6455, section 5.5: 123 bytes)."""
    return reason.encode()[:120].decode(errors="ignore")


def frame_of(payload: bytes | str) -> bytes:
    """Return an unmasked WebSocket frame (RFC 6455, section 5.2), the same for every client."""
    if isinstance(payload, str):
        return pack_frame(FIN | TEXT, payload.encode())
    return pack_frame(FIN | BINARY, payload)


class Connection(ServerConnection):
    """Connection of the library `websockets` that passes messages straight to a receiver."""

    def __init__(self, *arguments: Any, admission: Admission, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._admission = admission
        self._loop_budget = admission.loop_budget
        self._receiver: Callable[[bytes | str], None] | None = None
        self._parts: list[bytes] = []
        self._is_text = False
        self._leaving: asyncio.Task[None] | None = None
        # The server reads frames itself, because it must charge for them before the library
        # processes them. With this reader, a server with 600 episodes used 0.63 of a core instead
        # of 0.70 (docs/decisions/0025).
        self._reader = FrameReader(masked=True, max_size=MAX_OWN)
        self._request_size = 0
        self._request_end = b""
        self._requested = False
        self._frames = TokenBucket(FRAMES_A_SECOND, self.loop.time(), FRAMES_BURST)
        self._excess = 0
        self._paused: set[str] = set()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        # Each `admit` needs exactly one `release`. Otherwise, the server would refuse clients after
        # some time.
        self._admission.release()
        self._reader.clear()
        self._parts.clear()

    def listen(self, receiver: Callable[[bytes | str], None]) -> None:
        """Pass all messages to `receiver`, including those that have arrived already."""
        self._receiver = receiver
        # A client may send `hello` together with the handshake.
        if self._reader.rest:
            self._take(b"")

    def say_goodbye(self, status: int, reason: str) -> None:
        """Send a close frame, without waiting for the client."""
        # The close handshake may take seconds; a client that does not read must not delay the
        # caller.
        if self._leaving is None:
            self._leaving = asyncio.create_task(self.close(status, cut(reason)))

    def drop(self, reason: str) -> None:
        """Abort the connection."""
        if not self.transport.is_closing():
            self._admission.metrics.dropped.labels(reason).inc()
        # Send no close frame: this client is hostile or does not read.
        self.transport.abort()

    def pause_reading(self, why: str) -> None:
        """Stop reading from the client until every reason for it is gone."""
        if not self._paused:
            self.transport.pause_reading()
        # Several reasons may overlap, for example unread answers and an exhausted budget.
        self._paused.add(why)

    def resume_reading(self, why: str) -> None:
        """Remove a reason for not reading."""
        if why not in self._paused:
            return
        self._paused.discard(why)
        if not self._paused and not self.transport.is_closing():
            self.give_way()

    def give_way(self) -> None:
        """Let all other connections have a turn before the data that has arrived is processed."""
        if GIVE_WAY not in self._paused:
            self.pause_reading(GIVE_WAY)
            # Reading stops, so a flood stays in the kernel's buffers and TCP slows down its sender.
            self._loop_budget.wait(self._resume_after_others)

    def _resume_after_others(self) -> None:
        self._paused.discard(GIVE_WAY)
        if self._paused or self.transport.is_closing():
            return
        self._take(b"")
        if not self._paused:
            self.transport.resume_reading()

    # Receiving

    def data_received(self, data: bytes) -> None:
        """Split data into frames; the library's parser gets the request and whole frames."""
        # Usually the data is processed at once. While other connections wait for their turn, it
        # queues behind theirs.
        if self._paused or self._loop_budget.free:
            self._take(data)
        else:
            self._reader.receive(data)
            self.give_way()

    def _take_request(self, data: bytes) -> bytes:
        """Pass the HTTP request to the library; return the frames that follow it."""
        seen = self._request_end + data
        end = seen.find(END_OF_REQUEST)
        self._requested = end >= 0
        if not self._requested:
            # The end mark has four bytes and may be split over two packets.
            self._request_end = seen[-3:]
            self._request_size += len(data)
            # The limit is lower than the library's (128 lines of 8 KiB), because there may be many
            # slow handshakes.
            if self._request_size > MAX_REQUEST:
                self.drop("early")
            else:
                super().data_received(data)
            return b""
        # A handshake computes a hash and builds objects, so many at once would delay steps.
        self._loop_budget.spend(REQUEST_COST)
        size = end + len(END_OF_REQUEST) - len(self._request_end)
        super().data_received(data[:size])
        return data[size:]

    def _take(self, data: bytes) -> None:
        if not self._paused and not self._requested:
            # Add the bytes that arrived before the request was complete.
            before = self._reader.rest
            self._reader.clear()
            data = self._take_request(before + data)
        self._reader.receive(data)
        if self._paused:
            return
        if self._receiver is not None:
            self._take_frames()
        # Until the handshake is answered, a client has nothing to send but `hello`.
        elif len(self._reader.rest) > MAX_REQUEST:
            self._reader.clear()
            self.drop("early")

    def _take_frames(self) -> None:
        """Process the whole frames, up to the limits of this turn."""
        reader, left, now = self._reader, FRAMES_AT_A_TIME, self.loop.time
        until = now() + SECONDS_AT_A_TIME
        try:
            # The loop checks this for every frame, because a handler may pause reading, for example
            # for `PACED` messages.
            while not self._paused and reader.next_frame():
                self._loop_budget.spend(1 + reader.size / 1024)
                self._take_frame(reader)
                # The remaining frames of a client that was just disconnected must not be processed.
                if self.transport.is_closing():
                    reader.clear()
                left -= 1
                if left == 0 or self._loop_budget.over or now() >= until:
                    self.give_way()
        except FrameError:
            # Errors are left to the library, which sends the status that RFC 6455 requires for each
            # of them.
            super().data_received(reader.rest)
            reader.clear()

    def _take_frame(self, frame: FrameReader) -> None:
        first = frame.first
        # Whole messages are charged by `MessageBudget`; control frames and fragments have no such
        # budget and are charged here.
        if first in MESSAGES and self._between_messages:
            self._hand_over(frame.content, first == FIN | TEXT)
        elif first == FIN | CLOSE or self._charge(first, frame.size):
            super().data_received(frame.raw)

    def _charge(self, first: int, size: int) -> bool:
        """Charge for a control frame or fragment; return whether it may be processed.

        A client that does not read gets no pongs, which would only add to its unsent data.
        """
        if self.protocol.state is not State.OPEN:
            return False
        unread = first == FIN | PING and self.transport.get_write_buffer_size() > MAX_UNSENT
        if not unread and self._frames.take(self.loop.time(), 1 + size / 1024):
            return True
        self._excess += 1
        # A dropped fragment would corrupt the message, so there is no way to continue. Dropped
        # pings only go unanswered.
        if self._excess > MAX_EXCESS or first & 0x0F in DATA:
            self.drop("flood")
        return False

    @property
    def _between_messages(self) -> bool:
        return self.protocol.state is State.OPEN and not self._parts

    # Messages

    def process_event(self, event: Any) -> None:
        if isinstance(event, Frame) and event.opcode in DATA:
            self._take_part(event)
        else:
            super().process_event(event)

    def _take_part(self, frame: Frame) -> None:
        if frame.opcode != CONTINUATION:
            self._is_text = frame.opcode == TEXT
        self._parts.append(bytes(frame.data))
        # Empty fragments would use memory without counting towards the size of the message.
        if len(self._parts) > MAX_PARTS:
            self.drop("flood")
        elif frame.fin:
            content = b"".join(self._parts)
            self._parts.clear()
            self._hand_over(content, self._is_text)

    def _hand_over(self, content: bytes, is_text: bool) -> None:
        try:
            payload = content.decode() if is_text else content
        except UnicodeDecodeError:
            # Status 1007 is for data that does not match the type of the message (RFC 6455, section
            # 7.4.1).
            self.protocol.fail(1007, "text that is not UTF-8")
            self.send_data()
            return
        if self._receiver is not None:
            self._receiver(payload)


class PendingConnection(asyncio.Protocol):
    """Protocol that becomes a `Connection` with the first byte."""

    __slots__ = (
        "_admission", "_admitted", "_early", "_encrypting", "_options", "_server", "_timer",
        "_transport", "protocol",
    )  # fmt: skip

    def __init__(
        self, protocol: ServerProtocol, server: Server, *, admission: Admission, **options: Any
    ) -> None:
        self.protocol = protocol
        """Attribute by which the library identifies the connection during the handshake."""
        self._server = server
        self._options = options
        self._admission = admission
        self._admitted = False
        self._transport: asyncio.Transport | None = None
        self._early = b""
        self._encrypting: asyncio.Task[None] | None = None
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        raw, admission = cast("asyncio.Transport", transport), self._admission
        # The last descriptors are reserved for recordings: an episode must not fail because
        # strangers open connections.
        few = few_left(raw.get_extra_info("socket"))
        self._admitted = not few and admission.admit()
        if not self._admitted:
            count = admission.metrics.dropped
            (count.labels("descriptors") if few else count.labels("full")).inc()
            # Send no answer: even a TLS alert or an HTTP 503 would cost a handshake.
            raw.abort()
            return
        admission.pending.add(self)
        if admission.tls is None:
            self._wait(raw)
        else:
            self._transport = raw
            raw.pause_reading()  # `start_tls` must receive the first byte of the handshake.
            loop = asyncio.get_running_loop()
            self._encrypting = loop.create_task(self._encrypt(raw, admission.tls))

    async def _encrypt(self, raw: asyncio.Transport, tls: ssl.SSLContext) -> None:
        encrypted, admission = None, self._admission
        try:
            encrypted = await admission.handshakes.make(raw, self, tls, admission.opening_seconds)
        finally:
            self._encrypting = None
            if encrypted is None:
                raw.abort()
                self._end()
        if encrypted is not None:
            self._wait(encrypted)

    def _wait(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        if self._early:
            self._go_on(self._early)
            return
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(self._admission.opening_seconds, transport.abort)

    def abort(self) -> None:
        """Close the connection at once."""
        if self._transport is not None:
            self._transport.abort()

    def data_received(self, data: bytes) -> None:
        if self._encrypting is None:
            self._go_on(data)
        # The buffer is limited, because a client may send anything until the handshake is reported.
        elif len(self._early) + len(data) <= MAX_REQUEST:
            self._early += data  # It arrived before `start_tls` reported the end of the handshake.
        else:
            self.abort()

    def _go_on(self, data: bytes) -> None:
        transport = self._transport
        if transport is None:
            return
        # From here on, the library's own timeout for the request applies.
        self._forget()
        connection = Connection(
            self.protocol, self._server, admission=self._admission, **self._options
        )
        transport.set_protocol(connection)
        connection.connection_made(transport)
        connection.data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._encrypting is not None:
            self._encrypting.cancel()
        self._end()

    def _end(self) -> None:
        self._forget()
        if self._admitted:
            self._admitted = False
            self._admission.release()

    def _forget(self) -> None:
        self._admission.pending.discard(self)
        self._transport = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
