"""WebSocket frames in a byte stream, so that a link can treat messages separately."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

__all__ = ["FrameSplitter", "Unit", "UnitKind", "payload_of"]

END_OF_HEAD = b"\r\n\r\n"
UPGRADED = b"HTTP/1.1 101"


class UnitKind(Enum):
    """Kind of a piece of the stream."""

    HANDSHAKE = "handshake"
    MESSAGE = "message"
    CONTROL = "control"


class Unit(NamedTuple):
    """A whole frame, or a part of the HTTP handshake."""

    kind: UnitKind
    data: bytes


class FrameSplitter:
    """Splitter of one direction of a connection into units."""

    def __init__(self) -> None:
        self._rest = b""
        self._frames = False
        self._http_only = False

    def feed(self, data: bytes) -> list[Unit]:
        """Return the units that are complete now."""
        if self._http_only:
            return [Unit(UnitKind.HANDSHAKE, data)]
        self._rest += data
        units: list[Unit] = []
        if not self._frames:
            end = self._rest.find(END_OF_HEAD)
            if end < 0:
                return units
            head = self._rest[: end + len(END_OF_HEAD)]
            self._http_only = head.startswith(b"HTTP/") and not head.startswith(UPGRADED)
            if self._http_only:
                head, self._rest = self._rest, b""
                return [Unit(UnitKind.HANDSHAKE, head)]
            self._rest = self._rest[len(head) :]
            self._frames = True
            units.append(Unit(UnitKind.HANDSHAKE, head))
        while (size := _frame_size(self._rest)) is not None and len(self._rest) >= size:
            frame, self._rest = self._rest[:size], self._rest[size:]
            control = frame[0] & 0x08
            units.append(Unit(UnitKind.CONTROL if control else UnitKind.MESSAGE, frame))
        return units


def _frame_size(data: bytes) -> int | None:
    """Return the size of the frame that starts here, or None while its head is incomplete."""
    if len(data) < 2:
        return None
    length, head = data[1] & 0x7F, 2
    if length == 126:
        head = 4
    elif length == 127:
        head = 10
    if len(data) < head:
        return None
    if head > 2:
        length = int.from_bytes(data[2:head], "big")
    return head + (4 if data[1] & 0x80 else 0) + length


def payload_of(frame: bytes) -> bytes:
    """Return a frame's payload, unmasked."""
    length, start = frame[1] & 0x7F, 2
    if length == 126:
        start = 4
    elif length == 127:
        start = 10
    if not frame[1] & 0x80:
        return frame[start:]
    mask, masked = frame[start : start + 4], frame[start + 4 :]
    key = (mask * (len(masked) // 4 + 1))[: len(masked)]
    return (int.from_bytes(masked, "big") ^ int.from_bytes(key, "big")).to_bytes(len(masked), "big")
