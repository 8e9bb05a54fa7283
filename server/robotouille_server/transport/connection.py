"""A WebSocket that hands each message over at once, and meters whatever else comes on it.

No queue, no task that wakes for a message. Frames are told apart here before the library's parser
sees any: a frame that is a whole message goes straight to its receiver, all others (control frames,
parts of messages) are charged first, and those beyond what a connection may send are dropped.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.frames import Frame
from websockets.protocol import State

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
from robotouille_server.runtime.token_bucket import TokenBucket
from robotouille_server.transport.admission import Admission

__all__ = ["Connection", "cut", "frame_of"]

MAX_OWN = 2 * MAX_CLIENT_BYTES
"""Bytes of the largest message."""
MAX_REQUEST = 16 * 1024
"""Bytes of the handshake's request, and of all that may come behind it before it is answered."""
REQUEST_COST = 4.0
"""Of a handshake, in frames."""
MAX_UNSENT = 128 * 1024
"""Bytes that wait for a client from which on it is sent less, and no pong at all."""
MAX_HELD = 1024 * 1024
"""Bytes that wait for a client at which it is cut off."""

MAX_PARTS = 1024
"""Of one message, however slowly they come."""
FRAMES_AT_A_TIME = 32
"""Frames of one connection that are dealt with before all others have their turn."""
FRAMES_A_SECOND = 50.0
"""Control frames and parts of messages; each KiB of a part counts as one more."""
FRAMES_BURST = 200.0
MAX_EXCESS = 200
"""Frames beyond that, in all, after which the connection is cut off."""

MESSAGES = (FIN | BINARY, FIN | TEXT)
"""First bytes of frames that are whole messages."""
DATA = (CONTINUATION, TEXT, BINARY)
GIVE_WAY = "others first"
END_OF_REQUEST = b"\r\n\r\n"


def cut(reason: str) -> str:
    """A reason that fits into a close frame (RFC 6455, 5.5: 123 bytes)."""
    return reason.encode()[:120].decode(errors="ignore")


def frame_of(payload: bytes | str) -> bytes:
    """A whole unmasked WebSocket frame (RFC 6455, 5.2), the same for every client."""
    if isinstance(payload, str):
        return pack_frame(FIN | TEXT, payload.encode())
    return pack_frame(FIN | BINARY, payload)


class Connection(ServerConnection):
    """The library's connection, with messages going straight to `receiver`."""

    def __init__(self, *arguments: Any, admission: Admission, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._admission = admission
        self._loop_budget = admission.loop_budget
        self._receiver: Callable[[bytes | str], None] | None = None
        self._parts: list[bytes] = []
        self._is_text = False
        self._leaving: asyncio.Task[None] | None = None
        self._reader = FrameReader(masked=True, max_size=MAX_OWN)
        self._request_size = 0
        self._request_end = b""
        self._requested = False
        self._frames = TokenBucket(FRAMES_A_SECOND, self.loop.time(), FRAMES_BURST)
        self._excess = 0
        self._paused: set[str] = set()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._admission.release()
        self._reader.clear()
        self._parts.clear()

    def listen(self, receiver: Callable[[bytes | str], None]) -> None:
        """Give all messages to `receiver` from now on, those that came before first."""
        self._receiver = receiver
        if self._reader.rest:
            self._take(b"")

    def say_goodbye(self, status: int, reason: str) -> None:
        """Close politely, without waiting for the client."""
        if self._leaving is None:
            self._leaving = asyncio.create_task(self.close(status, cut(reason)))

    def drop(self, reason: str) -> None:
        """Cut the connection off without waiting for the client."""
        if not self.transport.is_closing():
            self._admission.metrics.dropped.labels(reason).inc()
        self.transport.abort()

    def pause_reading(self, why: str) -> None:
        """Take nothing more from the client, until no such reason is left."""
        if not self._paused:
            self.transport.pause_reading()
        self._paused.add(why)

    def resume_reading(self, why: str) -> None:
        """This is no reason any more."""
        if why not in self._paused:
            return
        self._paused.discard(why)
        if not self._paused and not self.transport.is_closing():
            self.give_way()

    def give_way(self) -> None:
        """Go on with what has come already when all others have had their turn."""
        if GIVE_WAY not in self._paused:
            self.pause_reading(GIVE_WAY)
            self._loop_budget.wait(self._resume_after_others)

    def _resume_after_others(self) -> None:
        self._paused.discard(GIVE_WAY)
        if self._paused or self.transport.is_closing():
            return
        self._take(b"")
        if not self._paused:
            self.transport.resume_reading()

    # What comes

    def data_received(self, data: bytes) -> None:
        """Take the frames apart; the library's parser is given the request and whole frames."""
        if self._paused or self._loop_budget.free:
            self._take(data)
        else:
            self._reader.receive(data)
            self.give_way()

    def _take_request(self, data: bytes) -> bytes:
        """Give the HTTP request to the library; what is behind its end is frames."""
        seen = self._request_end + data
        end = seen.find(END_OF_REQUEST)
        self._requested = end >= 0
        if not self._requested:
            self._request_end = seen[-3:]
            self._request_size += len(data)
            if self._request_size > MAX_REQUEST:
                self.drop("early")
            else:
                super().data_received(data)
            return b""
        self._loop_budget.spend(REQUEST_COST)
        size = end + len(END_OF_REQUEST) - len(self._request_end)
        super().data_received(data[:size])
        return data[size:]

    def _take(self, data: bytes) -> None:
        if not self._paused and not self._requested:
            before = self._reader.rest
            self._reader.clear()
            data = self._take_request(before + data)
        self._reader.receive(data)
        if self._paused:
            return
        if self._receiver is not None:
            self._take_frames()
        elif len(self._reader.rest) > MAX_REQUEST:
            self._reader.clear()
            self.drop("early")

    def _take_frames(self) -> None:
        """Deal with all frames that are whole, or with some of them and the others later."""
        reader, left = self._reader, FRAMES_AT_A_TIME
        try:
            while not self._paused and reader.next_frame():
                self._loop_budget.spend(1 + reader.size / 1024)
                self._take_frame(reader)
                if self.transport.is_closing():
                    reader.clear()
                left -= 1
                if left == 0 or self._loop_budget.over:
                    self.give_way()
        except FrameError:
            super().data_received(reader.rest)  # It says what is wrong.
            reader.clear()

    def _take_frame(self, frame: FrameReader) -> None:
        first = frame.first
        if first in MESSAGES and self._between_messages:
            self._hand_over(frame.content, first == FIN | TEXT)
        elif first == FIN | CLOSE or self._charge(first, frame.size):
            super().data_received(frame.raw)

    def _charge(self, first: int, size: int) -> bool:
        """Take a frame that is no message off the budget; whether it may be looked at.

        The pong of a ping would only wait with what the client does not read.
        """
        if self.protocol.state is not State.OPEN:
            return False
        unread = first == FIN | PING and self.transport.get_write_buffer_size() > MAX_UNSENT
        if not unread and self._frames.take(self.loop.time(), 1 + size / 1024):
            return True
        self._excess += 1
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
            self.protocol.fail(1007, "text that is not UTF-8")
            self.send_data()
            return
        if self._receiver is not None:
            self._receiver(payload)
