"""A cheap WebSocket connection: one process can hold thousands.

The `websockets` library does the handshake. Afterwards this module parses the frames, without a
task or a queue for each connection: it passes messages on in the event loop's read callback.
"""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Callable
from random import getrandbits

import msgpack
from websockets.client import ClientProtocol
from websockets.exceptions import WebSocketException
from websockets.http11 import Response
from websockets.protocol import State
from websockets.typing import Subprotocol
from websockets.uri import WebSocketURI

from robotouille.errors import RobotouilleError
from robotouille.protocol.codec import MAX_SERVER_BYTES, MSGPACK
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
from robotouille_client.sockets import MAX_UNSENT_BYTES

READ_SIZE = 64 * 1024
"""Number of bytes to read at a time. The event loop's default of 256 KiB is allocated from the
system and released for each message, which takes longer than reading the message."""
MAX_FRAGMENTS = 1024
"""Maximum number of fragments of a message."""
MAX_HEAD_BYTES = 64 * 1024
"""Maximum size of the head of a server's answer to the handshake."""


class UnreachableError(RobotouilleError):
    """No server answers at the address."""


class HandshakeRefusedError(RobotouilleError):
    """The server refuses the connection."""


class Traffic:
    """Bytes and messages of many connections, including WebSocket framing."""

    def __init__(self) -> None:
        self.bytes_in = 0
        self.bytes_out = 0
        self.messages_in = 0
        self.messages_out = 0


class LightConnection(asyncio.Protocol):
    """One connection. It calls `receive` with each payload, and `lost` once at its end."""

    def __init__(self, uri: WebSocketURI, traffic: Traffic) -> None:
        self.receive: Callable[[bytes], None] = _ignore
        self.lost: Callable[[], None] = _nothing
        self.ponged: Callable[[], None] = _nothing
        self.opened: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.opened.add_done_callback(_retrieved)
        self._handshake = ClientProtocol(uri, subprotocols=[Subprotocol(MSGPACK.name)])
        self._traffic = traffic
        self._transport: asyncio.Transport | None = None
        self._head = b""
        self._reader = FrameReader(masked=False, max_size=MAX_SERVER_BYTES)
        self._parts: list[bytes] = []
        self._parts_size = 0

    # Callbacks of the event loop

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport  # type: ignore[assignment]
        transport.max_size = READ_SIZE  # type: ignore[attr-defined]
        self._handshake.send_request(self._handshake.connect())
        data = b"".join(self._handshake.data_to_send())
        self._traffic.bytes_out += len(data)
        transport.write(data)  # type: ignore[attr-defined]

    def data_received(self, data: bytes) -> None:
        self._traffic.bytes_in += len(data)
        if not self.opened.done():
            head, separator, data = (self._head + data).partition(b"\r\n\r\n")
            if len(head) > MAX_HEAD_BYTES:
                self._refuse(f"it sends more than {MAX_HEAD_BYTES:,} bytes of headers")
                return
            if not separator:
                self._head = head
                return
            self._answered(head + separator, data)
        if not self.opened.exception():
            self._reader.receive(data)
            self._take_frames()

    def connection_lost(self, error: Exception | None) -> None:
        self._transport = None
        if not self.opened.done():
            reason = "the server closed the connection instead of a handshake"
            self.opened.set_exception(UnreachableError(reason))
        self.lost()

    # Handshake

    def _answered(self, head: bytes, body: bytes) -> None:
        refusal = head.startswith(b"HTTP/1.1 ") and not head.startswith(b"HTTP/1.1 101")
        self._handshake.receive_data(head + body if refusal else head)
        if refusal:
            self._handshake.receive_eof()
        for event in self._handshake.events_received():
            if isinstance(event, Response) and self._handshake.state is not State.OPEN:
                self._refuse(_refusal(event))
        if self.opened.done():
            return
        if self._handshake.state is not State.OPEN:
            line = head.partition(b"\r\n")[0].decode(errors="replace")
            self._refuse(f"it answers {line[:80]!r}, which is not a WebSocket handshake")
        elif self._handshake.subprotocol is None:
            self._refuse(f"it does not speak {MSGPACK.name}")
        else:
            self.opened.set_result(None)

    def _refuse(self, reason: str) -> None:
        self.opened.set_exception(HandshakeRefusedError(reason))
        self.abort()

    # Frames

    def _take_frames(self) -> None:
        try:
            while self._reader.next_frame():
                self._take_frame(self._reader.first, self._reader.content)
        except FrameError:
            self._parts.clear()
            self.abort()

    def _take_frame(self, first: int, payload: bytes) -> None:
        code = first & 0x0F
        if first in (FIN | BINARY, FIN | TEXT):
            self._traffic.messages_in += 1
            self.receive(payload)
        elif code == PING:
            self._write(FIN | PONG, payload)
        elif code == PONG:
            self.ponged()
        elif code == CLOSE:
            self._write(FIN | CLOSE, payload[:2])
            self.close()
        elif code in (CONTINUATION, BINARY, TEXT):
            self._take_part(payload, last=bool(first & FIN))

    def _take_part(self, payload: bytes, *, last: bool) -> None:
        self._parts.append(payload)
        self._parts_size += len(payload)
        if self._parts_size > MAX_SERVER_BYTES or len(self._parts) > MAX_FRAGMENTS:
            raise FrameError("a message with too many bytes or fragments")
        if last:
            whole, self._parts, self._parts_size = b"".join(self._parts), [], 0
            self._traffic.messages_in += 1
            self.receive(whole)

    def _write(self, first: int, payload: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() > MAX_UNSENT_BYTES:
            self.abort()
            return
        frame = pack_frame(first, payload, getrandbits(32).to_bytes(4))
        self._traffic.bytes_out += len(frame)
        self._transport.write(frame)

    # Sending and closing

    def send(self, message: dict[str, object]) -> None:
        """Send a message. It is dropped silently if the connection is closed."""
        self._traffic.messages_out += 1
        self._write(FIN | BINARY, msgpack.packb(message))

    def ping(self) -> None:
        """Send a ping. `ponged` is called when its answer arrives."""
        self._write(FIN | PING, b"load")

    def stop_reading(self) -> None:
        """Stop reading for good, with a receive buffer as small as possible."""
        if self._transport is not None:
            self._transport.get_extra_info("socket").setsockopt(
                socket.SOL_SOCKET, socket.SO_RCVBUF, 1
            )
            self._transport.pause_reading()

    def close(self) -> None:
        """Close after sending all pending data."""
        if self._transport is not None:
            self._transport.close()

    def abort(self) -> None:
        """Cut the connection, as a network failure does."""
        if self._transport is not None:
            self._transport.abort()


async def open_connection(uri: WebSocketURI, traffic: Traffic, seconds: float) -> LightConnection:
    """Open a connection and wait for its handshake.

    Raises:
        UnreachableError: No server answers in time.
        HandshakeRefusedError: The server refuses the connection.
    """
    loop = asyncio.get_running_loop()
    context = ssl.create_default_context() if uri.secure else None
    where = f"{uri.host}:{uri.port}"
    connection: LightConnection | None = None
    try:
        async with asyncio.timeout(seconds):
            _, connection = await loop.create_connection(
                lambda: LightConnection(uri, traffic), uri.host, uri.port, ssl=context
            )
            await connection.opened
    except TimeoutError:
        if connection is not None:
            connection.abort()
        raise UnreachableError(f"{where} did not answer in {seconds:g} s") from None
    except OSError as error:
        raise UnreachableError(f"no server at {where}: {error.strerror or error}") from None
    except WebSocketException as error:
        raise HandshakeRefusedError(f"{where}: {error}") from None
    except RobotouilleError as error:
        raise type(error)(f"{where}: {error}") from None
    return connection


def _refusal(response: Response) -> str:
    body = (response.body or b"").decode(errors="replace").strip()
    status = f"HTTP status {response.status_code} ({response.reason_phrase})"
    return f"{status}: {body.splitlines()[0]}" if body else status


def _ignore(payload: bytes) -> None:
    del payload


def _nothing() -> None:
    pass


def _retrieved(future: asyncio.Future[None]) -> None:
    # asyncio logs exceptions of futures that were never retrieved.
    if not future.cancelled():
        future.exception()
