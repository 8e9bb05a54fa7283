"""Payloads of frames: MessagePack within limits.

A list of four billion entries is announced in five bytes, and an empty map takes one byte in a file
and sixty-four in memory. A payload is therefore checked before it is decoded.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import msgpack

MAX_LENGTH = 200_000
"""Entries of one list or map."""
MAX_ENTRIES = 500_000
"""Values in a frame at any depth, with the keys and values of maps."""
MAX_ANNOUNCED = 4_000_000
"""Places that the lists of a payload may reserve before a count has shown them to be filled."""

_LONG_LISTS = b"\xdc\xdd"
"""First bytes of lists of 16 entries or more, for which the decoder reserves all places at once."""
_FIXED = {0xC0: 0, 0xC2: 0, 0xC3: 0, 0xCA: 4, 0xCB: 8, 0xCC: 1, 0xCD: 2, 0xCE: 4, 0xCF: 8,
          0xD0: 1, 0xD1: 2, 0xD2: 4, 0xD3: 8}  # fmt: skip
_STRINGS = {0xD9: 1, 0xDA: 2, 0xDB: 4}
_CONTAINERS = {0xDC: (2, 1), 0xDD: (4, 1), 0xDE: (2, 2), 0xDF: (4, 2)}
"""Bytes of the length, and values in each entry."""


def unpack(payload: bytes, *, checked: bool = False) -> dict[str, Any]:
    """Decode the map of a payload. ValueError if it is invalid or exceeds a limit.

    `checked`: True if the payload has been decoded before, so that its values need no counting.
    """
    # Most payloads are too small to exceed a limit. Only the others are counted, which is slow.
    size = len(payload)
    longest = min(size, MAX_LENGTH)
    lists = 0 if checked else size - len(payload.translate(None, _LONG_LISTS))
    if not checked and (size > MAX_ENTRIES or lists * longest > MAX_ANNOUNCED):
        _check_entries(payload)
    # Recordings contain no binary or extension values, so the decoder refuses them.
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


def _check_entries(payload: bytes) -> None:
    """Raise ValueError if a payload has too many values or announces more than it has."""
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
                raise ValueError(f"a list or map of {length:,} entries, over {MAX_LENGTH:,}")
            position += width
            more = length * each
        else:
            raise ValueError("a value of a type that recordings do not use")
        if more:
            awaited += more
            seen += more
            if seen > MAX_ENTRIES:
                raise ValueError(f"more than {MAX_ENTRIES:,} values in one frame")
            if awaited > size - position:
                raise ValueError("it announces more values than it has bytes for")


def unpack_without(payload: bytes, fields: Collection[str]) -> dict[str, Any]:
    """Decode a map without some of its fields. To skip a value is much faster than to decode it."""
    decoder = msgpack.Unpacker(max_buffer_size=len(payload))
    decoder.feed(payload)
    found = {}
    for _ in range(decoder.read_map_header()):
        field = decoder.unpack()
        if field in fields:
            decoder.skip()
        else:
            found[field] = decoder.unpack()
    return found
