"""Reader and writer of WebSocket frames (RFC 6455, section 5), without I/O.

reader = FrameReader(masked=True, max_size=65536)
reader.receive(data)
while reader.next_frame():
    ...  # reader.first, reader.content

The server and the load tester use this for data frames, pings and pongs, because they handle a
hundred thousand a second. Handshakes, closing and everything rare are left to the `websockets`
library.
"""

from __future__ import annotations

try:
    from websockets.speedups import apply_mask
except ImportError:
    from websockets.utils import apply_mask

FIN = 0x80
"""Bit of a frame's first byte: the last part of a message."""
CONTINUATION, TEXT, BINARY, CLOSE, PING, PONG = 0x0, 0x1, 0x2, 0x8, 0x9, 0xA
"""Opcodes, in the lower half of the first byte."""

_MASKED = 0x80
_TWO_BYTES, _EIGHT_BYTES = 126, 127


class FrameError(ValueError):
    """An invalid frame: wrongly masked, wrongly unmasked, or too large."""


class FrameReader:
    """Reader of the frames in one direction of a connection.

    The reader is its own cursor: an object for each frame would cost more than all the rest.

    Args:
        masked: True for frames from a client.
        max_size: Limit of a payload in bytes, checked as soon as the length has arrived.

    Attributes:
        max_size: As above. It may change between two frames.
        first: The current frame's first byte (FIN, reserved bits and opcode).
        size: The current frame's bytes, with its head.
    """

    __slots__ = ("_at", "_data", "_masked", "_start", "first", "max_size", "size")

    def __init__(self, *, masked: bool, max_size: int) -> None:
        self._masked = masked
        self.max_size = max_size
        self._data = b""
        self._at = self._start = 0
        self.first = self.size = 0

    def receive(self, data: bytes) -> None:
        """Add received bytes."""
        rest = self._data[self._at :]
        self._data = rest + data if rest else data
        self._at = 0

    def next_frame(self) -> bool:
        """Move to the next frame, and return whether it is complete.

        Raises:
            FrameError: The next frame is invalid. Every later call raises again, because nothing
                after such a frame can be read.
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
            raise FrameError("an unmasked frame" if self._masked else "a masked frame")
        if length >= _TWO_BYTES:
            more = 2 if length == _TWO_BYTES else 8
            if there < 2 + more:
                return False
            length = int.from_bytes(data[at + 2 : at + 2 + more])
            start += more
        # The length is checked before the payload arrives, so a forged length costs no memory.
        if length > self.max_size:
            raise FrameError(f"a frame of {length} bytes; the limit is {self.max_size}")
        size = start + length
        if there < size:
            if at:
                self._forget_read()
            return False
        self.first, self.size = data[at], size
        self._start, self._at = at + start, at + size
        return True

    def _forget_read(self) -> None:
        # Otherwise every idle connection would keep its last read in memory.
        self._data, self._at = self._data[self._at :], 0

    @property
    def content(self) -> bytes:
        """The current frame's payload, unmasked."""
        start = self._start
        payload = self._data[start : self._at]
        return apply_mask(payload, self._data[start - 4 : start]) if self._masked else payload

    @property
    def raw(self) -> bytes:
        """The current frame as received."""
        return self._data[self._at - self.size : self._at]

    @property
    def more(self) -> bool:
        """True if there are bytes after the current frame."""
        return self._at < len(self._data)

    @property
    def rest(self) -> bytes:
        """The bytes received after the current frame."""
        return self._data[self._at :]

    def clear(self) -> None:
        """Forget all received bytes."""
        self._data, self._at = b"", 0


def pack_frame(first: int, payload: bytes, mask: bytes = b"") -> bytes:
    """Return the bytes of a frame.

    Args:
        first: FIN and opcode.
        mask: Four bytes, for a client's frame.
    """
    length, flag = len(payload), _MASKED if mask else 0
    if length < _TWO_BYTES:
        head = bytes((first, flag | length))
    elif length < 1 << 16:
        head = bytes((first, flag | _TWO_BYTES)) + length.to_bytes(2)
    else:
        head = bytes((first, flag | _EIGHT_BYTES)) + length.to_bytes(8)
    return b"".join((head, mask, apply_mask(payload, mask) if mask else payload))
