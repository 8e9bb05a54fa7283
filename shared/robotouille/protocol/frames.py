"""WebSocket frames (RFC 6455, section 5), told apart and made: bytes in, frames out, no I/O.

reader = FrameReader(masked=True, max_size=65536)
reader.receive(data)
while reader.next_frame():
    ...  # reader.first, reader.content

The server and the load tester use it for what is met a hundred thousand times a second; handshakes,
closing and everything rare is the business of the `websockets` library.
"""

from __future__ import annotations

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


class FrameReader:
    """The frames of one direction of a connection, one after the other. `masked` are those of
    clients; a payload of more than `max_size` bytes is an error as soon as its length is there.

    It is its own cursor, as a frame of its own for each would cost more than all the rest: `first`
    is the present frame's first byte (FIN, reserved bits and opcode), `size` its bytes in all.
    """

    __slots__ = ("_at", "_data", "_masked", "_max_size", "_start", "first", "size")

    def __init__(self, *, masked: bool, max_size: int) -> None:
        self._masked = masked
        self._max_size = max_size
        self._data = b""
        self._at = self._start = 0
        self.first = self.size = 0

    def receive(self, data: bytes) -> None:
        """More bytes are here."""
        rest = self._data[self._at :]
        self._data = rest + data if rest else data
        self._at = 0

    def next_frame(self) -> bool:
        """Whether there is one more frame that is whole; it is the present one from now on.

        Raises:
            FrameError: The next one may not be, now and whenever this is asked again: nothing
                behind such a frame can be read.
        """
        data, at = self._data, self._at
        there = len(data) - at
        if there < 2:
            if at:
                self._forget_read()
            return False
        length, start = data[at + 1], 2
        if self._masked:
            length -= _MASKED
            start = 6
        if not 0 <= length < _MASKED:
            raise FrameError("a frame that is not masked" if self._masked else "a masked frame")
        if length >= _TWO_BYTES:
            more = 2 if length == _TWO_BYTES else 8
            if there < 2 + more:
                return False
            length = int.from_bytes(data[at + 2 : at + 2 + more])
            start += more
        if length > self._max_size:
            raise FrameError(f"a frame of {length} bytes; at most {self._max_size} may be")
        size = start + length
        if there < size:
            if at:
                self._forget_read()
            return False
        self.first, self.size = data[at], size
        self._start, self._at = at + start, at + size
        return True

    def _forget_read(self) -> None:
        """An idle connection keeps nothing of what it has read."""
        self._data, self._at = self._data[self._at :], 0

    @property
    def content(self) -> bytes:
        """The present frame's payload, unmasked."""
        start = self._start
        payload = self._data[start : self._at]
        return apply_mask(payload, self._data[start - 4 : start]) if self._masked else payload

    @property
    def raw(self) -> bytes:
        """The present frame as it came."""
        return self._data[self._at - self.size : self._at]

    @property
    def rest(self) -> bytes:
        """What has come behind the present frame."""
        return self._data[self._at :]

    def clear(self) -> None:
        """Forget the rest."""
        self._data, self._at = b"", 0


def pack_frame(first: int, payload: bytes, mask: bytes = b"") -> bytes:
    """A frame's bytes, with its shortest length.

    Args:
        first: FIN and opcode.
        mask: Four bytes make it a client's.
    """
    length, flag = len(payload), _MASKED if mask else 0
    if length < _TWO_BYTES:
        head = bytes((first, flag | length))
    elif length < 1 << 16:
        head = bytes((first, flag | _TWO_BYTES)) + length.to_bytes(2)
    else:
        head = bytes((first, flag | _EIGHT_BYTES)) + length.to_bytes(8)
    return b"".join((head, mask, apply_mask(payload, mask) if mask else payload))
