"""WebSocket frames (RFC 6455, section 5), told apart and made: bytes in, frames out, no I/O.

reader = FrameReader(masked=True, max_size=65536)
reader.receive(data)
while (frame := reader.next_frame()) is not None:
    ...  # frame.first, frame.content

The server and the load tester use it for what is met a hundred thousand times a second; handshakes,
closing and everything rare is the business of the `websockets` library.
"""

from __future__ import annotations

from typing import NamedTuple

try:
    from websockets.speedups import apply_mask
except ImportError:
    from websockets.utils import apply_mask

__all__ = [
    "BINARY",
    "CLOSE",
    "CONTINUATION",
    "FIN",
    "PING",
    "PONG",
    "TEXT",
    "FrameError",
    "FrameReader",
    "RawFrame",
    "pack_frame",
]

FIN = 0x80
"""In a frame's first byte: the last part of its message, or all of it."""
CONTINUATION, TEXT, BINARY, CLOSE, PING, PONG = 0x0, 0x1, 0x2, 0x8, 0x9, 0xA
"""Opcodes: the other half of the first byte."""

_MASKED = 0x80
_TWO_BYTES, _EIGHT_BYTES = 126, 127


class FrameError(ValueError):
    """A frame that may not be: masked where none is, or not where all are, or too large."""


class RawFrame(NamedTuple):
    """One frame as it came. `first` is its first byte: FIN, reserved bits and opcode; `payload` is
    still masked with `mask`, which is empty in frames of servers."""

    first: int
    raw: bytes
    payload: bytes
    mask: bytes

    @property
    def content(self) -> bytes:
        """The payload, unmasked."""
        return apply_mask(self.payload, self.mask) if self.mask else self.payload


class FrameReader:
    """The frames of one direction of a connection. `masked` are those of clients; a payload of more
    than `max_size` bytes is an error as soon as its length is there."""

    __slots__ = ("_at", "_data", "_masked", "_max_size")

    def __init__(self, *, masked: bool, max_size: int) -> None:
        self._masked = masked
        self._max_size = max_size
        self._data = b""
        self._at = 0

    def receive(self, data: bytes) -> None:
        """More bytes are here."""
        at = self._at
        if at == len(self._data):
            self._data = data
        else:
            self._data = self._data[at:] + data
        self._at = 0

    @property
    def rest(self) -> bytes:
        """What has come and is in no frame that was given."""
        return self._data[self._at :]

    def clear(self) -> None:
        """Forget the rest."""
        self._data, self._at = b"", 0

    def next_frame(self) -> RawFrame | None:
        """The next whole frame; None until more has come. FrameError is raised again and again:
        nothing behind such a frame can be read."""
        data, at = self._data, self._at
        size = len(data) - at
        if size < 2:
            return None
        second = data[at + 1]
        length, start = second & 0x7F, at + 2
        if (second >= _MASKED) is not self._masked:
            raise FrameError("a frame that is not masked" if self._masked else "a masked frame")
        if length >= _TWO_BYTES:
            start += 2 if length == _TWO_BYTES else 8
            if at + size < start:
                return None
            length = int.from_bytes(data[at + 2 : start])
        if length > self._max_size:
            raise FrameError(f"a frame of {length} bytes; at most {self._max_size} may be")
        mask = b""
        if self._masked:
            mask = data[start : start + 4]
            start += 4
        end = start + length
        if at + size < end:
            return None
        self._at = end
        return RawFrame(data[at], data[at:end], data[start:end], mask)


def pack_frame(first: int, payload: bytes, mask: bytes = b"") -> bytes:
    """A frame's bytes, with its shortest length; with a mask of four bytes, a client's."""
    length, flag = len(payload), _MASKED if mask else 0
    if length < _TWO_BYTES:
        head = bytes((first, flag | length))
    elif length < 1 << 16:
        head = bytes((first, flag | _TWO_BYTES)) + length.to_bytes(2)
    else:
        head = bytes((first, flag | _EIGHT_BYTES)) + length.to_bytes(8)
    return b"".join((head, mask, apply_mask(payload, mask) if mask else payload))
