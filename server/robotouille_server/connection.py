"""A WebSocket that hands each message over at once: no queue, no task that wakes for it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from websockets.asyncio.server import ServerConnection
from websockets.frames import Frame, Opcode
from websockets.protocol import State

from robotouille.protocol.codec import MAX_CLIENT_BYTES

try:
    from websockets.speedups import apply_mask
except ImportError:
    from websockets.utils import apply_mask

__all__ = ["Connection", "cut", "frame_of"]

MAX_EARLY = 16
"""Messages that may come before the handshake's end is dealt with."""

MAX_PARTS = 1024
"""Frames of one message: those without content would count for nothing else."""

WHOLE_BINARY, MASKED = 0x82, 0x80
MAX_OWN = 2 * MAX_CLIENT_BYTES
"""Bytes of the largest message that is not the library's business."""

DATA = (Opcode.TEXT, Opcode.BINARY, Opcode.CONT)


def cut(reason: str) -> str:
    """A reason that fits into a close frame (RFC 6455, 5.5: 123 bytes)."""
    return reason.encode()[:120].decode(errors="ignore")


def frame_of(payload: bytes | str) -> bytes:
    """A whole unmasked WebSocket frame (RFC 6455, 5.2), the same for every client."""
    text = isinstance(payload, str)
    content = payload.encode() if isinstance(payload, str) else payload
    first = b"\x81" if text else b"\x82"
    size = len(content)
    if size < 126:
        return first + size.to_bytes(1, "big") + content
    if size < 65536:
        return first + b"\x7e" + size.to_bytes(2, "big") + content
    return first + b"\x7f" + size.to_bytes(8, "big") + content


class Connection(ServerConnection):
    """The library's connection, with messages going straight to `receiver`."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._receiver: Callable[[bytes | str], None] | None = None
        self._early: list[bytes | str] = []
        self._parts: list[bytes] = []
        self._is_text = False
        self._leaving: asyncio.Task[None] | None = None
        self._rest = b""
        self._by_frames = self._at_frame = False

    def listen(self, receiver: Callable[[bytes | str], None]) -> None:
        """Give all messages to `receiver` from now on, those that came before first."""
        self._receiver = receiver
        early, self._early = self._early, []
        for payload in early:
            receiver(payload)

    def say_goodbye(self, status: int, reason: str) -> None:
        """Close politely, without waiting for the client."""
        if self._leaving is None:
            self._leaving = asyncio.create_task(self.close(status, cut(reason)))

    def data_received(self, data: bytes) -> None:
        """Take whole binary messages apart here, give everything else to the library.

        The library is given whole frames only, so that its parser always stands at the beginning
        of a frame when one goes past it.
        """
        if not self._by_frames:
            self._by_frames = self._receiver is not None and self._at_frame
            if not self._by_frames:
                self._at_frame = data.endswith(b"\r\n\r\n")
                super().data_received(data)
                return
        if self._rest:
            data = self._rest + data
        at = self._take_frames(data)
        self._rest = data[at:]

    def _take_frames(self, data: bytes) -> int:
        """Where the first frame begins that is not whole yet."""
        at, size = 0, len(data)
        while size - at >= 2:
            if data[at + 1] < MASKED:
                return self._leave_to_library(data, at)
            length, start = data[at + 1] & 0x7F, at + 6
            if length >= 126:
                start += 2 if length == 126 else 8
                if size < start:
                    break
                length = int.from_bytes(data[at + 2 : start - 4], "big")
            end = start + length
            if length > MAX_OWN:  # The library says what is wrong with it.
                return self._leave_to_library(data, at)
            if end > size:
                break
            if data[at] == WHOLE_BINARY and self._between_messages:
                self._receiver(apply_mask(data[start:end], data[start - 4 : start]))  # type: ignore[misc]
            else:
                super().data_received(data[at:end])
            at = end
        return at

    def _leave_to_library(self, data: bytes, at: int) -> int:
        """Let the library's parser have all that comes from here on."""
        self._by_frames = self._at_frame = False
        super().data_received(data[at:])
        return len(data)

    @property
    def _between_messages(self) -> bool:
        return self.protocol.state is State.OPEN and not self._parts

    def process_event(self, event: Any) -> None:
        if isinstance(event, Frame) and event.opcode in DATA:
            self._take(event)
        else:
            super().process_event(event)

    def _take(self, frame: Frame) -> None:
        if frame.opcode is not Opcode.CONT:
            self._is_text = frame.opcode is Opcode.TEXT
        self._parts.append(bytes(frame.data))
        if len(self._parts) > MAX_PARTS:
            self._parts.clear()
            self.protocol.fail(1008, "a message in too many parts")
            self.send_data()
        if not frame.fin or not self._parts:
            return
        content = self._parts[0] if len(self._parts) == 1 else b"".join(self._parts)
        self._parts.clear()
        try:
            payload = content.decode() if self._is_text else content
        except UnicodeDecodeError:
            self.protocol.fail(1007, "text that is not UTF-8")
            self.send_data()
            return
        if self._receiver is not None:
            self._receiver(payload)
        elif len(self._early) < MAX_EARLY:
            self._early.append(payload)
        else:
            self.transport.abort()
