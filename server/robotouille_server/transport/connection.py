"""WebSocket connections, before and after their first byte.

An accepted connection is a `PendingConnection`, which needs little memory, until its first byte
arrives. A `Connection` then answers the handshake, delivers messages at once and limits all other
frames.

There is no queue and no task, neither for a connection nor for a message: with a thousand messages
a second, waking tasks would take more time than the messages. The part of the library `websockets`
without I/O answers the handshake and all rare frames: closing, fragments and errors. Whole
messages, pings and pongs, which are nearly all frames, do not reach it (docs/decisions/0042).
"""

from __future__ import annotations

import asyncio
import secrets
import select
import ssl
from collections.abc import Callable, Sequence
from http import HTTPStatus
from typing import Any, Protocol, cast

from websockets.frames import Frame
from websockets.http11 import Request, Response
from websockets.protocol import State
from websockets.server import ServerProtocol
from websockets.typing import Subprotocol

from robotouille.protocol.codec import MAX_CLIENT_BYTES, SUBPROTOCOLS
from robotouille.protocol.frames import (
    BINARY,
    CLOSE,
    CONTINUATION,
    FIN,
    PING,
    PONG,
    TEXT,
    FrameError,
    FrameReader,
    pack_frame,
)
from robotouille_server.runtime.budgets import MAX_HELLO_BYTES, TokenBucket
from robotouille_server.runtime.logs import get_logger
from robotouille_server.runtime.process_limits import few_left
from robotouille_server.runtime.timer_queue import LATE
from robotouille_server.transport.admission import Admission
from robotouille_server.transport.loop_budget import TURN_SECONDS
from robotouille_server.transport.tls_records import METER, ClientHello

MAX_OWN = 2 * MAX_CLIENT_BYTES
"""Maximum size of a frame; larger messages are answered by an error."""
MAX_GREETING = 2 * MAX_HELLO_BYTES
"""Maximum size of a frame before `welcome`. Strangers may have many connections, and the server
buffers a frame until it is complete."""
MAX_HEAD = 14
"""Bytes of a frame before its payload, with the longest length and a mask."""
MAX_REQUEST = 16 * 1024
"""Maximum size of the HTTP request, and of data that arrives during a TLS handshake."""
REQUEST_COST = 4.0
"""Cost of a handshake, in frames."""
MAX_UNSENT = 128 * 1024
"""Unsent bytes above which a client receives no deltas and no pongs."""
MAX_HELD = 1024 * 1024
"""Unsent bytes above which a client is disconnected."""
PING_SECONDS = 20.0
"""Seconds between two pings, and for each answer. Pings find dead connections within 40 seconds and
measure the latency that rosters show."""
CLOSE_SECONDS = 2.0
"""Seconds that a client has to answer a close frame."""

MAX_PARTS = 1024
"""Maximum number of fragments of a message."""
MAX_CONTROL = 6 + 125
"""Maximum size of a control frame with its head (RFC 6455, section 5.5)."""
FRAMES_AT_A_TIME, SECONDS_AT_A_TIME = 8, TURN_SECONDS / 20
"""Frames of one connection, and time for them, after which all others get a turn."""
FRAMES_A_SECOND = 50.0
"""Control frames and fragments per second. Each KiB of a fragment counts as one more."""
FRAMES_BURST = 200.0
MAX_EXCESS = 200
"""Frames above that rate after which a client is disconnected."""

MESSAGES = (FIN | BINARY, FIN | TEXT)
"""First bytes of frames that contain a whole message."""
DATA = (CONTINUATION, TEXT, BINARY)
HANG_UP = getattr(select, "POLLRDHUP", 0)
"""Event of a closed connection in `select.poll`; 0 on systems without it."""
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


class Handler(Protocol):
    """Receives the requests of new connections, and learns when they open and end."""

    def answer(self, connection: Connection, request: Request) -> Response | None:
        """Answer an HTTP request; return None to go on with the WebSocket handshake."""

    def opened(self, connection: Connection, request: Request) -> None:
        """Serve a connection after its handshake."""

    def lost(self, connection: Connection) -> None:
        """Forget a connection, which may not have been opened."""


READ_BUFFER = memoryview(bytearray(64 * 1024))
"""Buffer that all connections of a process read into, one after the other."""


class BufferedReader(asyncio.BufferedProtocol):
    """Protocol whose data is read into `READ_BUFFER`.

    With `asyncio.Protocol`, each read allocates 256 KiB, which takes as long as reading a message.
    """

    __slots__ = ()

    def get_buffer(self, sizehint: int) -> memoryview:
        return READ_BUFFER

    def buffer_updated(self, nbytes: int) -> None:
        self.data_received(bytes(READ_BUFFER[:nbytes]))

    def data_received(self, data: bytes) -> None:
        """Take the data that has arrived."""
        raise NotImplementedError


class Connection(BufferedReader):
    """Connection that passes messages straight to a receiver.

    Attributes:
        transport: The transport of the socket.
        open: True after the handshake and until one side begins to close.
        latency: The round trip of the last ping in seconds; 0 before the first.
        group: The clients with which this one shares its turns; None if it has its own.
        subprotocol: The subprotocol that both sides have chosen.
        receiver: Receives each message; set when the connection opens.
    """

    __slots__ = (
        "_admission",
        "_ending",
        "_excess",
        "_frames",
        "_handler",
        "_is_text",
        "_kept_library",
        "_parts",
        "_paused",
        "_ping",
        "_ping_at",
        "_reader",
        "_request_end",
        "_request_size",
        "_requested",
        "_timer",
        "group",
        "latency",
        "loop",
        "open",
        "receiver",
        "subprotocol",
        "transport",
    )

    def __init__(self, handler: Handler, admission: Admission) -> None:
        self.transport: asyncio.Transport
        self.loop = asyncio.get_running_loop()
        self.open = self._ending = False
        self.latency = 0.0
        self.group: str | None = None
        self.subprotocol: str | None = None
        self.receiver: Callable[[bytes | str], None] | None = None
        self._handler = handler
        self._admission = admission
        # The library's part is made for the handshake and for rare frames, and is dropped
        # afterwards: it takes several kilobytes.
        self._kept_library: ServerProtocol | None = ServerProtocol(
            subprotocols=[Subprotocol(name) for name in SUBPROTOCOLS],
            select_subprotocol=_select_subprotocol,
            max_size=MAX_OWN,
        )
        self._parts: list[bytes] = []
        self._is_text = False
        # The server reads frames itself, because it must charge for them before the library
        # processes them. With this reader, a server with 600 episodes used 0.63 of a core instead
        # of 0.70 (docs/decisions/0025).
        self._reader = FrameReader(masked=True, max_size=MAX_GREETING)
        self._request_size = 0
        self._request_end = b""
        self._requested = False
        self._frames = TokenBucket(FRAMES_A_SECOND, self.loop.time(), FRAMES_BURST)
        self._excess = 0
        self._paused: set[str] = set()
        # One timer at a time: until the handshake, for the next ping, or until the end.
        self._timer: asyncio.TimerHandle | None = None
        self._ping, self._ping_at = b"", 0.0

    @property
    def remote_address(self) -> Any:
        """Address of the other side, as its socket reports it."""
        return self.transport.get_extra_info("peername")

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.Transport", transport)
        self._admission.enter(self, self.remote_address, heard=True)
        self._set_timer(self._admission.opening_seconds, self.abort)

    def connection_lost(self, exc: Exception | None) -> None:
        self.open = False
        self._admission.newcomers.leave(self)
        if self._timer is not None:
            self._timer.cancel()
        self._reader.clear()
        self._parts.clear()
        try:
            self._handler.lost(self)
        finally:
            # Without its references, the connection is freed at once. Otherwise clients that come
            # and go would leave garbage whose collection delays steps.
            self.receiver = None
            self._drop_library()
            # Each `admit` needs exactly one `release`. Otherwise, the server would refuse clients
            # after some time.
            self._admission.release()

    def abort(self) -> None:
        """Close the connection at once."""
        self.transport.abort()

    def drop(self, reason: str) -> None:
        """Abort the connection, and count the reason."""
        if not self.transport.is_closing():
            self._admission.metrics.dropped.labels(reason).inc()
        # Send no close frame: this client is hostile or does not read.
        self.abort()

    def _set_timer(self, seconds: float, callback: Callable[[], None]) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_later(seconds, callback)

    # Closing

    def say_goodbye(self, status: int, reason: str) -> None:
        """Send a close frame, without waiting for the client."""
        if self.open:
            self._library.send_close(status, cut(reason))
            self._send_from_library()

    def _send_from_library(self) -> None:
        """Send what the library has to send, and end the connection if it has closed it."""
        library = self._library
        for data in library.data_to_send():
            if data:
                self.transport.write(data)
            # The library asks for the end of the stream. Encrypted streams have no half end.
            elif self.transport.can_write_eof():
                self._end_stream()
            else:
                self.transport.close()
        if library.state is not State.OPEN:
            self._begin_to_close()

    def _end_stream(self) -> None:
        try:
            self.transport.write_eof()
        except OSError:  # The client has reset the connection.
            self.abort()

    def _begin_to_close(self) -> None:
        self.open = False
        if not self._ending:
            self._ending = True
            # The close handshake may take seconds; a client that does not answer is cut off.
            self._set_timer(CLOSE_SECONDS, self.abort)

    # Pings

    def _send_ping(self) -> None:
        now = self.loop.time()
        late = now - self._ping_at - PING_SECONDS
        # After a suspension of the server, a pong may have arrived but was not read yet.
        if self._ping and late < LATE:
            self._library.fail(1011, "a ping was not answered")
            self._send_from_library()
            return
        self._ping, self._ping_at = secrets.token_bytes(4), now
        self.transport.write(pack_frame(FIN | PING, self._ping))
        self._set_timer(PING_SECONDS, self._send_ping)

    def _take_pong(self, payload: bytes) -> None:
        if self._ping and payload == self._ping:
            self.latency = self.loop.time() - self._ping_at
            self._ping = b""

    # Order among connections

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
            self._admission.loop_budget.wait(self._resume_after_others, self.group)

    def accept_long_messages(self) -> None:
        """Read messages of any permitted size from now on, because `hello` was accepted."""
        self._reader.max_size = MAX_OWN

    def share_turns(self, group: str | None) -> None:
        """Share the turns of a group from now on, for frames and for TLS records."""
        self.group = group
        meter = self.transport.get_extra_info(METER)
        if meter is not None:
            meter.group = group

    def _resume_after_others(self) -> None:
        self._paused.discard(GIVE_WAY)
        if self._paused or self.transport.is_closing():
            return
        # In a storm of short connections, most have gone when their turn comes. Answering them
        # would keep those waiting that have not.
        if not self._requested and _has_hung_up(self.transport):
            self.drop("early")
            return
        try:
            self._take(b"")
        except Exception:
            get_logger().exception("a connection failed")
            self.abort()
        if not self._paused:
            self.transport.resume_reading()

    # The handshake

    def _take_request(self, data: bytes) -> bytes:
        """Pass the HTTP request to the library; return the frames that follow it."""
        seen = self._request_end + data
        end = seen.find(END_OF_REQUEST)
        self._requested = end >= 0
        size = end + len(END_OF_REQUEST) - len(self._request_end) if end >= 0 else len(data)
        self._request_size += size
        # The limit is lower than the library's (128 lines of 8 KiB), because there may be many slow
        # handshakes.
        if self._request_size > MAX_REQUEST:
            self.drop("early")
            return b""
        if not self._requested:
            # The end mark has four bytes and may be split over two packets.
            self._request_end = seen[-3:]
            library = self._library
            library.receive_data(data)
            if library.handshake_exc is not None:
                self._send_from_library()
            return b""
        # A handshake computes a hash and builds objects, so many at once would delay steps.
        self._admission.loop_budget.spend(REQUEST_COST)
        self._library.receive_data(data[:size])
        self._answer_request()
        return data[size:]

    def _answer_request(self) -> None:
        library = self._library
        # Without an event, this was no HTTP request, and the library ends the stream.
        for request in library.events_received():
            if isinstance(request, Request):
                library.send_response(self._answer_to(request))
                if library.state is State.OPEN:
                    self._open(library, request)
                    return
        self._send_from_library()

    def _answer_to(self, request: Request) -> Response:
        try:
            answer = self._handler.answer(self, request) or self._library.accept(request)
        except Exception:
            get_logger().exception("a request failed")
            answer = self._library.reject(500, "the server failed to handle this\n")
        if answer.status_code != HTTPStatus.SWITCHING_PROTOCOLS:
            # Refusals repeat parts of the request.
            answer.headers.setdefault("X-Content-Type-Options", "nosniff")
        return answer

    def _open(self, library: ServerProtocol, request: Request) -> None:
        self.subprotocol = library.subprotocol
        self._send_from_library()
        self._drop_library()
        self._admission.newcomers.leave(self)
        self.open = True
        self._set_timer(PING_SECONDS, self._send_ping)
        self._handler.opened(self, request)

    def respond(self, status: int, text: str) -> Response:
        """Return a plain answer to the request."""
        return self._library.reject(status, text)

    def charge(self, cost: float) -> None:
        """Charge the event loop's budget for an answer; the unit is that of a frame."""
        self._admission.loop_budget.spend(cost)

    # Receiving

    def data_received(self, data: bytes) -> None:
        """Split data into frames; the library gets the request and rare frames."""
        # Usually the data is processed at once. While other connections wait for their turn, it
        # queues behind theirs.
        budget = self._admission.loop_budget
        if self._paused or budget.start():
            self._take(data)
            budget.done()
        else:
            self._reader.receive(data)
            self.give_way()

    def _take(self, data: bytes) -> None:
        if not self._paused and not self._requested:
            # Add the bytes that arrived before the request was complete.
            before = self._reader.rest
            self._reader.clear()
            data = self._take_request(before + data)
        self._reader.receive(data)
        if not self._paused and self._requested:
            self._take_frames()

    def _take_frames(self) -> None:
        """Process the whole frames, up to the limits of this turn."""
        reader, budget = self._reader, self._admission.loop_budget
        left, now = FRAMES_AT_A_TIME, self.loop.time
        until = now() + SECONDS_AT_A_TIME
        try:
            # The loop checks this for every frame, because a handler may pause reading, for example
            # for `PACED` messages.
            while not self._paused and reader.next_frame():
                budget.spend(1 + reader.size / 1024)
                self._take_frame(reader)
                # The remaining frames of a client that was just disconnected must not be processed.
                if self.transport.is_closing():
                    reader.clear()
                left -= 1
                if reader.more and (left == 0 or budget.over or now() >= until):
                    self.give_way()
        except FrameError:
            # Errors are left to the library, which sends the status that RFC 6455 requires for each
            # of them. All are found in the head of the frame.
            self._pass_to_library(reader.rest[:MAX_HEAD])
            reader.clear()

    def _take_frame(self, frame: FrameReader) -> None:
        first = frame.first
        # Whole messages are charged by `MessageBudget`; control frames and fragments have no such
        # budget and are charged here.
        if first in MESSAGES and self.open and not self._parts:
            self._hand_over(frame.content, first == FIN | TEXT)
        elif first == FIN | CLOSE:
            self._pass_to_library(frame.raw)
        elif not self._charge(first, frame.size):
            return
        elif first == FIN | PING and frame.size <= MAX_CONTROL:
            self.transport.write(pack_frame(FIN | PONG, frame.content))
        elif first == FIN | PONG and frame.size <= MAX_CONTROL:
            self._take_pong(frame.content)
        else:
            self._pass_to_library(frame.raw)

    def _charge(self, first: int, size: int) -> bool:
        """Charge for a control frame or fragment; return whether it may be processed.

        A client that does not read gets no pongs, which would only add to its unsent data.
        """
        if not self.open:
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

    # Rare frames

    @property
    def _library(self) -> ServerProtocol:
        """The library's part, which is made again if it was dropped."""
        if self._kept_library is None:
            limit = self._reader.max_size
            self._kept_library = ServerProtocol(state=State.OPEN, max_size=limit)
        return self._kept_library

    def _pass_to_library(self, data: bytes) -> None:
        library = self._library
        library.receive_data(data)
        for event in library.events_received():
            if isinstance(event, Frame) and event.opcode in DATA:
                self._take_part(event)
        self._send_from_library()
        if self.open and not self._parts:
            self._drop_library()

    def _drop_library(self) -> None:
        """Forget the library's part, which may contain all bytes that were passed to it."""
        library, self._kept_library = self._kept_library, None
        if library is not None:
            # Its parser and methods refer to it, so only a garbage collection would free it.
            vars(library).clear()

    # Messages

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
            self._library.fail(1007, "text that is not UTF-8")
            self._send_from_library()
            return
        if self.receiver is not None:
            self.receiver(payload)


def _select_subprotocol(
    library: ServerProtocol, offered: Sequence[Subprotocol]
) -> Subprotocol | None:
    """Return the first known subprotocol; None means JSON, for simple clients."""
    return next((name for name in offered if name in SUBPROTOCOLS), None)


def _has_hung_up(transport: asyncio.Transport) -> bool:
    """Return whether the client has closed its side, even if data before that is unread.

    The event loop finds that out only when it reads. Only Linux tells earlier.
    """
    # The transport of the simulation has no socket.
    sock = transport.get_extra_info("socket")
    if not HANG_UP or sock is None or sock.fileno() < 0:
        return False
    poll = select.poll()
    poll.register(sock.fileno(), HANG_UP)
    return bool(poll.poll(0))


class PendingConnection(BufferedReader):
    """Protocol that becomes a `Connection` with the first byte."""

    __slots__ = (
        "_admission", "_admitted", "_early", "_encrypting", "_handler", "_timer", "_tls",
        "_transport",
    )  # fmt: skip

    def __init__(self, handler: Handler, admission: Admission) -> None:
        self._handler = handler
        self._admission = admission
        self._admitted = False
        self._transport: asyncio.Transport | None = None
        self._tls: ssl.SSLContext | None = None
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
        self._transport = raw
        self._tls = admission.tls.context if admission.tls is not None else None
        admission.enter(self, raw.get_extra_info("peername"), heard=False)
        self._wait(raw)

    def get_buffer(self, sizehint: int) -> memoryview:
        # One byte shows that the client has begun its handshake. The rest stays in the kernel's
        # buffers, because the client may wait for its turn.
        return READ_BUFFER if self._tls is None else READ_BUFFER[:1]

    def _begin_tls(self, raw: asyncio.Transport, tls: ssl.SSLContext, first: bytes) -> None:
        # Silent connections take no turn of a handshake, so they do not delay others.
        self._tls = None
        self._stop_timer()
        raw.pause_reading()
        self._admission.enter(self, raw.get_extra_info("peername"), heard=True)
        loop = asyncio.get_running_loop()
        self._encrypting = loop.create_task(self._encrypt(raw, tls, first))

    async def _encrypt(self, raw: asyncio.Transport, tls: ssl.SSLContext, first: bytes) -> None:
        encrypted, admission = None, self._admission
        group = admission.turn_group_of(raw.get_extra_info("peername"))
        try:
            encrypted = await admission.handshakes.make(
                ClientHello(raw, first, group), self, tls, admission.opening_seconds
            )
        finally:
            self._encrypting = None
            if encrypted is None:
                raw.abort()
                self._end()
        if encrypted is not None:
            try:
                self._wait(encrypted)
            except Exception:
                get_logger().exception("a connection failed")
                encrypted.abort()

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
        if self._tls is not None:
            if self._transport is not None:
                self._begin_tls(self._transport, self._tls, data)
        elif self._encrypting is None:
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
        self._forget()
        connection = Connection(self._handler, self._admission)
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
        self._admission.newcomers.leave(self)
        self._transport = None
        self._stop_timer()

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
