"""MessagePack in a frame, read within limits that hold before anything is made of it.

A list of four billion is announced in five bytes, and an empty map takes one byte in a file and
sixty-four in memory. So a payload is unpacked only once it is known what it would become.
"""

from __future__ import annotations

from typing import Any

import msgpack

__all__ = ["MAX_ENTRIES", "MAX_LENGTH", "unpack"]

MAX_LENGTH = 200_000
"""Entries of one list or map in a frame."""
MAX_ENTRIES = 500_000
"""Values in a frame, at any depth: those of all lists, and the keys and values of all maps."""
MAX_ANNOUNCED = 4_000_000
"""Places in lists that may be made before it is known that they are filled."""

_LONG_LISTS = b"\xdc\xdd"
"""What begins a list of 16 entries or more: a place for each is made at once."""
_FIXED = {0xC0: 0, 0xC2: 0, 0xC3: 0, 0xCA: 4, 0xCB: 8, 0xCC: 1, 0xCD: 2, 0xCE: 4, 0xCF: 8,
          0xD0: 1, 0xD1: 2, 0xD2: 4, 0xD3: 8}  # fmt: skip
_STRINGS = {0xD9: 1, 0xDA: 2, 0xDB: 4}
_CONTAINERS = {0xDC: (2, 1), 0xDD: (4, 1), 0xDE: (2, 2), 0xDF: (4, 2)}
"""Bytes of the length, and values for each entry."""


def unpack(payload: bytes) -> dict[str, Any]:
    """The map of a payload; ValueError says what is wrong with it."""
    size = len(payload)
    longest = min(size, MAX_LENGTH)
    lists = size - len(payload.translate(None, _LONG_LISTS))
    if size > MAX_ENTRIES or lists * longest > MAX_ANNOUNCED:
        _count(payload)
    value = msgpack.unpackb(
        payload,
        strict_map_key=True,
        max_ext_len=0,
        max_bin_len=0,
        max_array_len=longest,
        max_map_len=longest,
    )
    if not isinstance(value, dict):
        raise ValueError("a frame is not a map")
    return value


def _count(payload: bytes) -> None:
    """ValueError where a payload has more values than may be, or announces more than it has."""
    position, awaited, size, seen = 0, 1, len(payload), 1
    while awaited:
        if position >= size:
            raise ValueError("it ends within a value")
        first = payload[position]
        position += 1
        awaited -= 1
        more = 0
        if first < 0x80 or first >= 0xE0:
            continue
        if first < 0x90:
            more = 2 * (first & 0x0F)
        elif first < 0xA0:
            more = first & 0x0F
        elif first < 0xC0:
            position += first & 0x1F
        elif first in _FIXED:
            position += _FIXED[first]
        elif first in _STRINGS:
            width = _STRINGS[first]
            position += width + int.from_bytes(payload[position : position + width], "big")
        elif first in _CONTAINERS:
            width, each = _CONTAINERS[first]
            length = int.from_bytes(payload[position : position + width], "big")
            if length > MAX_LENGTH:
                raise ValueError(f"a list or map of {length:,} entries; {MAX_LENGTH:,} may be")
            position += width
            more = length * each
        else:
            raise ValueError("a value of a kind that no recording has")
        if more:
            awaited += more
            seen += more
            if seen > MAX_ENTRIES:
                raise ValueError(f"more than {MAX_ENTRIES:,} values in one frame")
            if awaited > size - position:
                raise ValueError("it announces more values than it has bytes for")
