"""Walking over the frames of a recording without reading each of them."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Any

import msgpack

from robotouille.replay.frames import MAGIC

__all__ = ["frame_ends", "frame_value"]

PREFIX = struct.Struct("<II")


def frame_ends(stream: bytes, start: int = len(MAGIC)) -> Iterator[int]:
    """Where each whole frame from `start` on ends; stops where the stream is cut off."""
    while start + PREFIX.size <= len(stream):
        length, checksum = PREFIX.unpack_from(stream, start)
        end = start + PREFIX.size + length
        if end > len(stream) or zlib.crc32(stream[start + PREFIX.size : end]) != checksum:
            return
        yield end
        start = end


def frame_value(stream: bytes, start: int) -> dict[str, Any]:
    """The whole frame that begins at `start`; ValueError if it is no map."""
    length, _ = PREFIX.unpack_from(stream, start)
    begin = start + PREFIX.size
    value = msgpack.unpackb(stream[begin : begin + length], strict_map_key=True, max_ext_len=0)
    if not isinstance(value, dict):
        raise ValueError("a frame is not a map")
    return value
