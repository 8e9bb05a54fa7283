"""The container of a recording: length-prefixed, checksummed frames.

    file  = magic frame*            while it is written
          | zstd(magic frame*)      once it is closed
    magic = "RBTL" version(1 byte)
    frame = length(4 bytes, little-endian) crc32(4 bytes) payload(length bytes, MessagePack)

A file that was cut off anywhere is readable up to its last whole frame.
"""

from __future__ import annotations

import struct
import sys
import zlib
from collections.abc import Iterator
from typing import Any

import msgpack

from robotouille.errors import RecordingError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = [
    "FORMAT_VERSION",
    "MAGIC",
    "compress",
    "frames_with_ends",
    "intact",
    "pack_frame",
    "read_frames",
    "unwrap",
]

FORMAT_VERSION = 1
MAGIC = b"RBTL" + bytes([FORMAT_VERSION])
_ZSTD = b"\x28\xb5\x2f\xfd"
_PREFIX = struct.Struct("<II")
MAX_FRAME = 4 * 1024 * 1024
MAX_FILE = 256 * 1024 * 1024
MAX_LENGTH = 200_000
"""Entries of a list or map in a frame."""


_pack = msgpack.Packer(autoreset=True).pack


def pack_frame(value: dict[str, Any]) -> bytes:
    """One frame with its length and checksum."""
    payload: bytes = _pack(value)
    return _PREFIX.pack(len(payload), zlib.crc32(payload)) + payload


def compress(stream: bytes) -> bytes:
    """The form of a closed recording."""
    return zstd.compress(stream, level=9)


def unwrap(content: bytes) -> bytes:
    """The plain stream of a recording, compressed or not."""
    if content[:4] == _ZSTD:
        decompressor = zstd.ZstdDecompressor()
        try:
            content = decompressor.decompress(content, max_length=MAX_FILE)
        except zstd.ZstdError as error:
            raise RecordingError(f"damaged: {error}") from None
        if not decompressor.eof:
            raise RecordingError("damaged: the compressed stream is cut off or too large")
    if len(content) < len(MAGIC) or content[:4] != MAGIC[:4]:
        raise RecordingError("not a recording: it does not begin with 'RBTL'")
    if content[4] != FORMAT_VERSION:
        found = content[4]
        raise RecordingError(f"format version {found}; this software reads {FORMAT_VERSION}")
    return content


def intact(stream: bytes) -> int:
    """The length of a plain stream up to the end of its last whole frame before any damage."""
    end = len(MAGIC)
    try:
        for _, position in frames_with_ends(stream):
            end = position
    except RecordingError:
        pass
    return end


def read_frames(stream: bytes) -> Iterator[dict[str, Any]]:
    """The whole frames of a plain stream; stops silently where the file was cut off."""
    return (frame for frame, _ in frames_with_ends(stream))


def frames_with_ends(stream: bytes) -> Iterator[tuple[dict[str, Any], int]]:
    """The whole frames of a plain stream, each with the position at which it ends."""
    position = len(MAGIC)
    while position + _PREFIX.size <= len(stream):
        length, checksum = _PREFIX.unpack_from(stream, position)
        start = position + _PREFIX.size
        payload = stream[start : start + length]
        if length > MAX_FRAME:
            raise RecordingError(f"damaged at byte {position}: a frame of {length:,} bytes")
        if len(payload) < length:
            return
        if zlib.crc32(payload) != checksum:
            raise RecordingError(f"damaged at byte {position}: the checksum does not match")
        try:
            value = msgpack.unpackb(
                payload,
                strict_map_key=True,
                max_ext_len=0,
                max_bin_len=0,
                max_array_len=MAX_LENGTH,
                max_map_len=MAX_LENGTH,
            )
        except (ValueError, msgpack.UnpackException) as error:
            raise RecordingError(f"damaged at byte {position}: {error}") from None
        if not isinstance(value, dict):
            raise RecordingError(f"damaged at byte {position}: a frame is not a map")
        position = start + length
        yield value, position
