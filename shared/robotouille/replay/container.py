"""The container of a recording: length-prefixed, checksummed frames.

    file  = magic frame*                while it is written
          | zstd(magic frame*)          once it is closed
    magic = "RBTL" version(1 byte)
    frame = length(4 bytes) crc32 of the payload(4) crc32 of these 8 bytes(4) payload(length bytes)

All numbers are little-endian, a payload is MessagePack. In version 1 a frame has no checksum of
its first eight bytes.

A file may be *torn*: its process was killed while it wrote, or the power went. Then the frames
before the tear are all there is. Anything else that is wrong is *damage*, and told as such.
"""

from __future__ import annotations

import struct
import sys
import zlib
from collections.abc import Iterator
from typing import Any

import msgpack

from robotouille.errors import RecordingError
from robotouille.replay.bounded_msgpack import unpack

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = [
    "FORMAT_VERSION",
    "MAGIC",
    "MAX_FILE",
    "MAX_FRAME",
    "VERSIONS",
    "compress",
    "frame_ends",
    "frame_value",
    "frames_with_ends",
    "intact",
    "is_closed",
    "magic",
    "pack_frame",
    "plain",
    "read_frames",
    "unwrap",
    "version_of",
]

FORMAT_VERSION = 2
"""What is written; a recording that began in an earlier one goes on in it."""
VERSIONS = (1, 2)
MAX_FRAME = 4 * 1024 * 1024
"""Bytes of a frame's payload."""
MAX_FILE = 256 * 1024 * 1024
"""Bytes of a recording, uncompressed."""
BLOCK = 4 * 1024
"""Bytes of a stream that are compressed into a block of their own."""
PIECE, PLAIN_PIECE = 16 * 1024, 1024 * 1024
"""Bytes that are decompressed at once, and that come out at once."""

UNCHECKED = 128 * 1024
"""Bytes of a payload that cannot hold more values than a reader takes."""

_ZSTD = b"\x28\xb5\x2f\xfd"
_LENGTH_AND_SUM = struct.Struct("<II")
_SUM = struct.Struct("<I")
_HEAD = {1: 8, 2: 12}
"""Bytes before the payload."""
_KIND = b"\xa4kind"
"""The key with which the map of every frame begins."""
_MAP_BYTES = (1, 3)
"""Bytes that a map may take before its first key."""

_pack = msgpack.Packer(autoreset=True).pack


def magic(version: int) -> bytes:
    """The first bytes of an uncompressed recording."""
    return b"RBTL" + bytes([version])


MAGIC = magic(FORMAT_VERSION)


def version_of(stream: bytes) -> int:
    """The format version of a plain stream; RecordingError if it is none that can be read."""
    if len(stream) < len(MAGIC) or stream[:4] != MAGIC[:4]:
        raise RecordingError("not a recording: it does not begin with 'RBTL'")
    found = stream[4]
    if found not in VERSIONS:
        raise RecordingError(f"format version {found}; this software reads 1 to {FORMAT_VERSION}")
    return found


def pack_frame(value: dict[str, Any], version: int = FORMAT_VERSION) -> bytes:
    """One frame with its length and checksums; RecordingError if no reader would take it."""
    payload: bytes = _pack(value)
    size = len(payload)
    if size > MAX_FRAME:
        raise RecordingError(f"a frame of {size:,} bytes; at most {MAX_FRAME:,} can be recorded")
    if size > UNCHECKED:
        _refuse_unreadable(payload)
    head = _LENGTH_AND_SUM.pack(size, zlib.crc32(payload))
    if version > 1:
        head += _SUM.pack(zlib.crc32(head))
    return head + payload


def _refuse_unreadable(payload: bytes) -> None:
    try:
        unpack(payload)
    except (ValueError, msgpack.UnpackException) as error:
        raise RecordingError(f"a frame that cannot be recorded: {error}") from None


# Closed files


def compress(stream: bytes) -> bytes:
    """The form of a closed recording: with a checksum of all of it, in blocks of their own, so
    that what stands before some damage can still be read."""
    options = {
        int(zstd.CompressionParameter.compression_level): 9,
        int(zstd.CompressionParameter.checksum_flag): 1,
    }
    compressor = zstd.ZstdCompressor(options=options)
    # Otherwise it makes room for a stream without an end: 11 MiB for each that is closed at once.
    compressor.set_pledged_input_size(len(stream))
    pieces = [
        compressor.compress(stream[at : at + BLOCK], mode=zstd.ZstdCompressor.FLUSH_BLOCK)
        for at in range(0, len(stream), BLOCK)
    ]
    return b"".join([*pieces, compressor.flush()])


def is_closed(content: bytes) -> bool:
    """Whether a file's content is that of a closed recording."""
    return content[:4] == _ZSTD


def unwrap(content: bytes) -> bytes:
    """The plain stream of a recording, compressed or not; RecordingError if it is damaged."""
    stream, fault = plain(content)
    if fault:
        raise RecordingError(fault)
    return stream


def plain(content: bytes, limit: int = MAX_FILE) -> tuple[bytes, str]:
    """The plain stream of a recording as far as it can be read, and what is wrong with the
    compressed one, if anything is. RecordingError if it is no recording. Of one with more than
    `limit` bytes not much more than that is decompressed."""
    stream, fault = _decompressed(content, limit) if is_closed(content) else (content, "")
    try:
        version_of(stream)
    except RecordingError as error:
        raise RecordingError(fault or str(error)) from None
    return stream, fault


def _decompressed(content: bytes, limit: int) -> tuple[bytes, str]:
    """What a compressed stream holds before any damage, and the damage in words."""
    found: list[bytes] = []
    try:
        failed = _inflate(content, found, len(content), limit)
        if failed < len(content):
            # Of a piece with damage in it nothing comes out: byte by byte, what stands before.
            found.clear()
            _inflate(content, found, failed, limit)
            return b"".join(found), "damaged: the compressed stream makes no sense"
    except RecordingError as error:
        return b"".join(found), str(error)
    return b"".join(found), ""


def _inflate(content: bytes, found: list[bytes], surely: int, limit: int) -> int:
    """Decompress in pieces, behind the first `surely` bytes of one byte each. Where the piece
    begins that cannot be decompressed; the length of all if there is none."""
    decompressor, at = zstd.ZstdDecompressor(), 0
    while at < len(content) and not decompressor.eof:
        size = PIECE if at < surely else 1
        try:
            _feed(decompressor, content[at : at + size], found, limit)
        except zstd.ZstdError:
            return at
        at += size
    if not decompressor.eof:
        raise RecordingError("damaged: the compressed stream is cut off")
    if decompressor.unused_data or at < len(content):
        raise RecordingError("damaged: something follows the end of the compressed stream")
    return len(content)


def _feed(
    decompressor: zstd.ZstdDecompressor, piece: bytes, found: list[bytes], limit: int
) -> None:
    """Add what comes out; a bomb is noticed by how it begins, or by its size."""
    while piece or not (decompressor.needs_input or decompressor.eof):
        more = decompressor.decompress(piece, max_length=PLAIN_PIECE)
        piece = b""
        if not more:
            continue
        found.append(more)
        if not found[0].startswith(MAGIC[: min(4, len(found[0]))]):
            raise RecordingError("not a recording: it does not begin with 'RBTL'")
        if len(found) * PLAIN_PIECE > limit and sum(map(len, found)) > limit:
            raise RecordingError(f"damaged: more than {limit:,} bytes, uncompressed")


# Reading


def intact(stream: bytes) -> int:
    """The length of a plain stream up to the end of its last whole frame before any damage."""
    return max(frame_ends(stream), default=len(MAGIC))


def read_frames(stream: bytes) -> Iterator[dict[str, Any]]:
    """The frames of a plain stream, up to where it is torn; RecordingError where it is damaged."""
    return (frame for frame, _ in frames_with_ends(stream))


def frames_with_ends(stream: bytes) -> Iterator[tuple[dict[str, Any], int]]:
    """The frames of a plain stream, each with the position at which it ends, up to a tear.

    RecordingError names the byte of the first frame that is damaged.
    """
    version = version_of(stream)
    position = len(MAGIC)
    while position < len(stream):
        end, fault = _end_of_frame(stream, position, version)
        if fault:
            if _is_torn(stream, position, version):
                return
            raise RecordingError(f"damaged at byte {position}: {fault}")
        yield frame_value(stream, position, end), end
        position = end


def frame_ends(stream: bytes, start: int = len(MAGIC)) -> Iterator[int]:
    """Where each whole frame from `start` on ends, by the checksums alone; stops at the first
    that is torn or damaged."""
    version = version_of(stream)
    while start < len(stream):
        start, fault = _end_of_frame(stream, start, version)
        if fault:
            return
        yield start


def frame_value(stream: bytes, start: int, end: int | None = None) -> dict[str, Any]:
    """The whole frame that begins at `start`; RecordingError if it makes no sense."""
    version = version_of(stream)
    if end is None:
        end = start + _HEAD[version] + _LENGTH_AND_SUM.unpack_from(stream, start)[0]
    try:
        return unpack(stream[start + _HEAD[version] : end])
    except (ValueError, msgpack.UnpackException) as error:
        raise RecordingError(f"damaged at byte {start}: {error}") from None


def _end_of_frame(stream: bytes, position: int, version: int) -> tuple[int, str]:
    """Where a frame ends, and what is wrong with it, if anything is."""
    start = position + _HEAD[version]
    if start > len(stream):
        return position, "it ends within a frame"
    length, checksum = _LENGTH_AND_SUM.unpack_from(stream, position)
    if version > 1 and _SUM.unpack_from(stream, position + 8)[0] != zlib.crc32(
        stream[position : position + 8]
    ):
        return position, "the checksum of a frame's length does not match"
    if not 0 < length <= MAX_FRAME:
        return position, f"a frame of {length:,} bytes"
    end = start + length
    if end > len(stream):
        return position, "it ends within a frame"
    if zlib.crc32(stream[start:end]) != checksum:
        return position, "the checksum does not match"
    return end, ""


# Tears


def _is_torn(stream: bytes, position: int, version: int) -> bool:
    """Whether what is wrong from a position on is what a killed process or a power cut leaves:
    a frame that was begun, or zeros, and nothing whole behind it."""
    rest = len(stream) - position
    if rest < _HEAD[version] or not stream[position:].strip(b"\0"):
        return True
    return _is_begun(stream, position, version) and not _whole_behind(stream, position, version)


def _is_begun(stream: bytes, position: int, version: int) -> bool:
    """Whether a frame's first bytes are right, and the end of its payload is missing."""
    start = position + _HEAD[version]
    head = stream[position : position + 8]
    length, checksum = _LENGTH_AND_SUM.unpack(head)
    if not len(stream) - start < length <= MAX_FRAME:
        return False
    if version > 1:
        return _SUM.pack(zlib.crc32(head)) == stream[position + 8 : start]
    # Nothing covers the length: where all that is there fits the checksum, it is the length that
    # is wrong, and nothing is missing.
    its_sum: int = checksum
    return zlib.crc32(stream[start:]) != its_sum


def _whole_behind(stream: bytes, position: int, version: int) -> bool:
    """Whether there is a whole frame somewhere behind a position."""
    allowance = 4 * len(stream)  # Bytes to take checksums of: nobody may make this slow.
    at = stream.find(_KIND, position + 1)
    while at >= 0:
        for before in _MAP_BYTES:
            begin = at - before - _HEAD[version]
            if begin <= position:
                continue
            length = _LENGTH_AND_SUM.unpack_from(stream, begin)[0]
            if length > len(stream) - at + before:
                continue
            allowance -= length
            if allowance < 0 or not _end_of_frame(stream, begin, version)[1]:
                return True
        at = stream.find(_KIND, at + 1)
    return False
