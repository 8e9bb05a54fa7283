"""Container of a recording: length-prefixed frames with checksums.

    file  = magic frame*                while it is being written
          | zstd(magic frame*)          once it is closed
    magic = "RBTL" version(1 byte)
    frame = length(4 bytes) crc32 of the payload(4) crc32 of these 8 bytes(4) payload(length bytes)

All numbers are little-endian, and a payload is MessagePack.

A file may be *torn*: its process was killed while it wrote, or the power failed. The frames before
the tear are then intact, and reading ends there. Any other fault is *damage* and an error.
"""

from __future__ import annotations

import re
import struct
import sys
import zlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import msgpack

from robotouille.errors import RecordingError
from robotouille.files.reading import content_kind

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

FORMAT_VERSION = 3
MAGIC = b"RBTL" + bytes([FORMAT_VERSION])
"""First bytes of an uncompressed recording."""
# These limits are part of the format (docs/recording_format.md). The server ends an episode well
# before a reader would refuse its recording.
MAX_FRAME = 4 * 1024 * 1024
"""Bytes of a frame's payload."""
MAX_FILE = 256 * 1024 * 1024
"""Bytes of an uncompressed recording."""
MAX_FRAMES = 1_250_000
"""Frames of a recording: the longest game has a million steps. A few kilobytes of compressed
recording can contain ten million frames, which take minutes to read."""
MAX_NOTES = 300_000
"""Notes of a recording. The quota of a seat is enough for 115,000 of the shortest ones. A few
kilobytes of compressed frames can contain millions, which take minutes to read."""
MAX_REASONS = 4_000_000
"""Reasons of all rejections of a recording, with a quarter of the objects that they name. In
shipped tasks, a reason takes 60 bytes or more, and an object 16 in the text and the list, so games
do not reach this. Other tasks may have shorter words."""
MAX_CHANGES = 25_000_000
"""Entries of `add` and `remove` in all steps of a recording. Games have about ten in a step."""
MAX_RATIO = 1024
"""Bytes of the stream per byte of a closed file.

`compress` writes a block of 4 KiB in at least 4 bytes, so no written recording exceeds this ratio.
Recordings of games have ratios of 3 to 100; a file of 8 kB can claim 256 MiB."""
SMALL = 4 * 1024 * 1024
"""Bytes of an uncompressed recording that may have any ratio, for example because another program
has compressed it."""
BLOCK = 4 * 1024
"""Bytes in a compressed block. A damaged block is lost as a whole, so blocks are small."""
PIECE, PLAIN_PIECE = 16 * 1024, 1024 * 1024
"""Bytes given to the decompressor at once, and bytes taken from it at once."""

WHOLE = 4 * 1024
"""Bytes of a payload that is decoded as a whole: to look for single fields would be slower."""

UNCHECKED = 128 * 1024
"""Bytes of a payload too short to exceed the limits of `unpack`, so the payload is not checked."""

_ZSTD = b"\x28\xb5\x2f\xfd"
_LENGTH_AND_SUM = struct.Struct("<II")
_SUM = struct.Struct("<I")
_HEAD = 12
"""Bytes before the payload."""
_KIND = b"\xa4kind"
"""First key in the map of every frame."""
_STEP = re.compile(
    rb"(?:[\x80-\x8f]|\xde..)\xa4kind\xa4step\xa4step"
    rb"([\x00-\x7f]|\xcc.|\xcd.{2}|\xce.{4}|\xcf.{8})",
    re.DOTALL,
)
"""Beginning of the payload of a step, with its number."""
_MAP_BYTES = (1, 3)
"""Bytes of a map's head, before its first key."""

_pack = msgpack.Packer(autoreset=True).pack

# MessagePack within limits. A list of four billion entries is announced in five bytes, and an empty
# map takes one byte in a file and sixty-four in memory. A payload is therefore checked before it is
# decoded.

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


# Frames


def check_magic(stream: bytes) -> None:
    """Raise RecordingError unless an uncompressed stream begins like a readable recording."""
    if stream[:4] != MAGIC[:4]:
        raise RecordingError(_other_content(stream))
    if len(stream) < len(MAGIC):
        raise RecordingError("not a recording: it ends after 'RBTL'")
    if stream[4] != FORMAT_VERSION:
        raise RecordingError(_other_version(stream[4]))


def _check_number(stream: bytes) -> None:
    """Raise RecordingError if a stream has too many frames. Only lengths are read."""
    if len(stream) <= MAX_FRAMES * (_HEAD + 1):
        return
    position, number = len(MAGIC), 0
    while position + _HEAD <= len(stream):
        position += _HEAD + _LENGTH_AND_SUM.unpack_from(stream, position)[0]
        number += 1
        if number > MAX_FRAMES:
            raise RecordingError(f"damaged: more than {MAX_FRAMES:,} frames")


def _other_content(content: bytes) -> str:
    kind = content_kind(content[:1024])
    return f"not a recording but {kind}; the server writes recordings as .rbt files"


def _other_version(version: int) -> str:
    if version > FORMAT_VERSION:
        remedy = "install the newer version of Robotouille that recorded it"
    else:
        # No release wrote versions 1 and 2, so no converter exists.
        remedy = "it predates the first release, so record the game again"
    return f"format version {version}; this software reads only {FORMAT_VERSION}: {remedy}"


def pack_frame(value: dict[str, Any]) -> bytes:
    """Return one frame with its length and checksums.

    Raises:
        RecordingError: The frame exceeds the limits of readers.
    """
    payload: bytes = _pack(value)
    size = len(payload)
    if size > MAX_FRAME:
        raise RecordingError(f"a frame of {size:,} bytes; at most {MAX_FRAME:,} can be recorded")
    if size > UNCHECKED:
        _refuse_unreadable(payload)
    # The second checksum covers the length. In version 1, a flipped bit in a length made the rest
    # of the file look like an incomplete frame, and a restart cut 57 of 72 kB
    # (docs/decisions/0021).
    head = _LENGTH_AND_SUM.pack(size, zlib.crc32(payload))
    return head + _SUM.pack(zlib.crc32(head)) + payload


def _refuse_unreadable(payload: bytes) -> None:
    try:
        unpack(payload)
    except (ValueError, msgpack.UnpackException) as error:
        raise RecordingError(f"a frame that cannot be recorded: {error}") from None


# Closed files


def compress(stream: bytes) -> bytes:
    """Return the content of a closed recording, with a checksum over all of it."""
    options = {
        int(zstd.CompressionParameter.compression_level): 9,
        int(zstd.CompressionParameter.checksum_flag): 1,
    }
    compressor = zstd.ZstdCompressor(options=options)
    # Without the size, zstd reserves 11 MiB for each recording that is closed at the same time.
    compressor.set_pledged_input_size(len(stream))
    pieces = [
        # Without flushing, a reader would lose everything that the compressor had not put out
        # before the damage.
        compressor.compress(stream[at : at + BLOCK], mode=zstd.ZstdCompressor.FLUSH_BLOCK)
        for at in range(0, len(stream), BLOCK)
    ]
    return b"".join([*pieces, compressor.flush()])


def is_closed(content: bytes) -> bool:
    """Return whether a file's content is that of a closed recording."""
    # Decided by the content and not by the suffix, because people rename files.
    return content[:4] == _ZSTD


def plain_size(content: bytes) -> int:
    """Return the size of a file's stream without decompressing it, or a limit of the size."""
    if not is_closed(content):
        return len(content)
    most = min(MAX_FILE, max(SMALL, MAX_RATIO * len(content)))
    try:
        stated = zstd.get_frame_info(content).decompressed_size
    except zstd.ZstdError:
        return most
    return most if stated is None else min(most, stated)


def unwrap(content: bytes) -> bytes:
    """Return the uncompressed stream of a recording. RecordingError if it is damaged."""
    stream, fault = plain(content)
    if fault:
        raise RecordingError(fault)
    return stream


def plain(content: bytes, limit: int = MAX_FILE) -> tuple[bytes, str]:
    """Return the readable part of a recording, uncompressed, and the damage as text if any.

    Decompression stops soon after `limit` bytes.

    Raises:
        RecordingError: The content is not a recording.
    """
    if is_closed(content):
        most = max(SMALL, MAX_RATIO * len(content))
        stream, fault = _decompressed(content, min(limit, most))
        if most < min(limit, len(stream)):
            fault = f"damaged: {len(content):,} bytes that expand to more than {most:,}"
    else:
        stream, fault = content, ""
    try:
        check_magic(stream)
    except RecordingError as error:
        raise RecordingError(fault or str(error)) from None
    _check_number(stream)
    return stream, fault


def _decompressed(content: bytes, limit: int) -> tuple[bytes, str]:
    found: list[bytes] = []
    try:
        failed = _inflate(content, found, len(content), limit)
        if failed < len(content):
            # Nothing comes out of a piece that contains damage. A second pass, byte by byte in
            # that piece, finds what stands before the damage.
            found.clear()
            _inflate(content, found, failed, limit)
            return b"".join(found), "damaged: the compressed stream is invalid"
    except RecordingError as error:
        return b"".join(found), str(error)
    return b"".join(found), ""


def _inflate(content: bytes, found: list[bytes], intact_bytes: int, limit: int) -> int:
    """Decompress in pieces, after the first `intact_bytes` byte by byte.

    Returns:
        The position of the piece that cannot be decompressed, or the length of the content.
    """
    decompressor, at = zstd.ZstdDecompressor(), 0
    while at < len(content) and not decompressor.eof:
        size = PIECE if at < intact_bytes else 1
        try:
            _feed(decompressor, content[at : at + size], found, limit)
        except zstd.ZstdError:
            return at
        at += size
    if not decompressor.eof:
        raise RecordingError("damaged: the compressed stream is cut off")
    if decompressor.unused_data or at < len(content):
        raise RecordingError("damaged: data follows the end of the compressed stream")
    return len(content)


def _feed(
    decompressor: zstd.ZstdDecompressor, piece: bytes, found: list[bytes], limit: int
) -> None:
    # A decompression bomb is noticed by its first bytes or by its size, before it fills memory.
    while piece or not (decompressor.needs_input or decompressor.eof):
        more = decompressor.decompress(piece, max_length=PLAIN_PIECE)
        piece = b""
        if not more:
            continue
        found.append(more)
        if not found[0].startswith(MAGIC[: min(4, len(found[0]))]):
            raise RecordingError(_other_content(found[0]))
        if len(found) * PLAIN_PIECE > limit and sum(map(len, found)) > limit:
            raise RecordingError(f"damaged: more than {limit:,} bytes, uncompressed")


# Reading


def intact(stream: bytes) -> int:
    """Return the length of a stream up to the last whole frame before any damage."""
    return max(frame_ends(stream), default=len(MAGIC))


def read_frames(stream: bytes) -> Iterator[dict[str, Any]]:
    """Yield the frames of a stream up to a tear. RecordingError if a frame is damaged."""
    return (frame for frame, _ in frames_with_ends(stream))


def frames_with_ends(
    stream: bytes, position: int = len(MAGIC), totals: Totals | None = None
) -> Iterator[tuple[dict[str, Any], int]]:
    """Yield the frames of a stream up to a tear, each with the position of its end.

    Args:
        stream: The stream.
        position: The position of the first frame to yield.
        totals: The counts over the frames before it, to which these frames are added.

    Raises:
        RecordingError: A frame is damaged. The message has the position of its first byte.
    """
    check_magic(stream)
    _check_number(stream)
    totals = totals or Totals()
    while position < len(stream):
        end, fault = _end_of_frame(stream, position)
        if fault:
            # Only an open file may be torn. Readers of a closed one check that its last frame is a
            # footer.
            if _is_torn(stream, position):
                return
            raise RecordingError(f"damaged at byte {position}: {fault}")
        frame = frame_value(stream, position, end)
        totals.add(frame)
        totals.check()
        yield frame, end
        position = end


@dataclass(slots=True)
class Totals:
    """Counts over the frames of a recording that bound the memory of its readers.

    The server ends an episode before it reaches the limits of readers.
    """

    frames: int = 0
    notes: int = 0
    reasons: int = 0
    changes: int = 0

    def add(self, frame: Mapping[str, Any]) -> None:
        """Count a frame, which need not be valid."""
        self.frames += 1
        if "notes" in frame:
            self.notes += _length(frame["notes"])
            self.reasons += _reasons_in(frame)
        else:
            self.changes += _length(frame.get("add")) + _length(frame.get("remove"))

    def check(self) -> None:
        """Raise RecordingError if a limit is exceeded. The number of frames is checked before."""
        if self.notes > MAX_NOTES:
            raise RecordingError(f"damaged: more than {MAX_NOTES:,} notes")
        if self.reasons > MAX_REASONS:
            raise RecordingError(f"damaged: more than {MAX_REASONS:,} reasons for rejections")
        if self.changes > MAX_CHANGES:
            raise RecordingError(f"damaged: more than {MAX_CHANGES:,} changes of facts")


def _length(value: object) -> int:
    # Events that are being written have tuples.
    return len(value) if isinstance(value, list | tuple) else 0


def _reasons_in(frame: Mapping[str, Any]) -> int:
    """Return the number of reasons in a frame of notes, with a quarter of their objects."""
    notes = frame["notes"] if isinstance(frame["notes"], list) else ()
    found = 0
    for note in notes:
        if isinstance(note, dict) and (reasons := note.get("reasons")):
            whys = note.get("why")
            objects = sum(
                _length(why.get("objects"))
                for why in (whys if isinstance(whys, list) else ())
                if isinstance(why, dict)
            )
            found += _length(reasons) + objects // 4
    return found


def frame_ends(stream: bytes, start: int = len(MAGIC)) -> Iterator[int]:
    """Yield the end of each whole frame from `start` to the first tear or damage.

    This checks the checksums without decoding, so it is much faster than reading the frames.
    """
    check_magic(stream)
    while start < len(stream):
        start, fault = _end_of_frame(stream, start)
        if fault:
            return
        yield start


def frame_value(
    stream: bytes,
    start: int,
    end: int | None = None,
    *,
    checked: bool = False,
    without: Collection[str] = (),
) -> dict[str, Any]:
    """Decode the whole frame at `start`. RecordingError if its payload is invalid.

    Args:
        checked: True if the frame has been decoded before.
        without: Fields that the caller ignores. Long frames, which must be `checked`, lack them.
    """
    if end is None:
        end = start + _HEAD + _LENGTH_AND_SUM.unpack_from(stream, start)[0]
    payload = stream[start + _HEAD : end]
    try:
        if without and checked and len(payload) > WHOLE:
            return _unpack_without(payload, without)
        return unpack(payload, checked=checked)
    except (ValueError, msgpack.UnpackException) as error:
        raise RecordingError(f"damaged at byte {start}: {error}") from None


def _unpack_without(payload: bytes, fields: Collection[str]) -> dict[str, Any]:
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


def step_number(stream: bytes, start: int) -> int | None:
    """Return the number of the step whose frame begins at `start`, without decoding the frame.

    None if it is another frame, or one that another program has written in another way.
    """
    found = _STEP.match(stream, start + _HEAD)
    if found is None:
        return None
    return int.from_bytes(found[1][1:] or found[1], "big")


def _end_of_frame(stream: bytes, position: int) -> tuple[int, str]:
    """Return the end of a frame, and its fault as text if it has one."""
    start = position + _HEAD
    if start > len(stream):
        return position, "it ends within a frame"
    length, checksum = _LENGTH_AND_SUM.unpack_from(stream, position)
    # This check comes before the length is used, because a wrong length may mean gigabytes.
    if _SUM.unpack_from(stream, position + 8)[0] != zlib.crc32(stream[position : position + 8]):
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


def _is_torn(stream: bytes, position: int) -> bool:
    """Return whether the rest of a stream looks like the work of a killed process or a power cut.

    That is the beginning of one frame, or zeros that a file system left, with no whole frame after.
    """
    rest = len(stream) - position
    if rest < _HEAD or not stream[position:].strip(b"\0"):
        return True
    # A tear is always the last thing in a file. A frame that was begun and goes on with zeros
    # counts as damage: it looks the same as an overwritten one (docs/recordings.md).
    return _is_begun(stream, position) and not _whole_behind(stream, position)


def _is_begun(stream: bytes, position: int) -> bool:
    """Return whether a frame's head is valid and only the end of its payload is missing."""
    start = position + _HEAD
    head = stream[position : position + 8]
    length = _LENGTH_AND_SUM.unpack(head)[0]
    if not len(stream) - start < length <= MAX_FRAME:
        return False
    return _SUM.pack(zlib.crc32(head)) == stream[position + 8 : start]


def _whole_behind(stream: bytes, position: int) -> bool:
    """Return whether a whole frame follows somewhere after a position."""
    # A forged file could name many long frames that overlap. The allowance bounds the bytes to sum.
    allowance = 4 * len(stream)
    # Every payload begins with a map whose first key is `kind`, so frames can be found without a
    # chain of lengths that leads to them.
    at = stream.find(_KIND, position + 1)
    while at >= 0:
        for before in _MAP_BYTES:
            begin = at - before - _HEAD
            if begin <= position:
                continue
            length = _LENGTH_AND_SUM.unpack_from(stream, begin)[0]
            if length > len(stream) - at + before:
                continue
            allowance -= length
            if allowance < 0 or not _end_of_frame(stream, begin)[1]:
                return True
        at = stream.find(_KIND, at + 1)
    return False
