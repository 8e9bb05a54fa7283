"""Container of a recording: length-prefixed frames with checksums.

    file  = magic frame*                while it is being written
          | zstd(magic frame*)          once it is closed
    magic = "RBTL" version(1 byte)
    frame = length(4 bytes) crc32 of the payload(4) crc32 of these 8 bytes(4) payload(length bytes)

All numbers are little-endian, and a payload is MessagePack.

`payloads` decodes payloads within limits, and `compression` reads and writes closed files.

A file may be *torn*: its process was killed while it wrote, or the power failed. The frames before
the tear are then intact, and reading ends there. Any other fault is *damage* and an error.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import msgpack

from robotouille.errors import RecordingError
from robotouille.files.reading import content_kind
from robotouille.replay.payloads import unpack, unpack_without

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
MAX_TEXTS = 256 * 1024 * 1024
"""Bytes of the texts of all notes; readers keep some of them. A text that is not ASCII counts four
bytes for each character, which it can take in memory: one emoji in it is enough."""
MAX_CHANGES = 25_000_000
"""Entries of `add` and `remove` in all steps of a recording. Games have about ten in a step."""
MAX_CREATED = 1_000_000
"""Entries of `objects` and `atoms` in all steps of a recording. A step lists an object and its
facts, 12,000 at most, whenever the object is created: also if it had existed before."""

WHOLE = 4 * 1024
"""Bytes of a payload that is decoded as a whole: to look for single fields would be slower."""
UNCHECKED = 128 * 1024
"""Bytes of a payload too short to exceed the limits of `unpack`, so the payload is not checked."""

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

# Frames


def check_magic(stream: bytes) -> None:
    """Raise RecordingError unless an uncompressed stream begins like a readable recording."""
    if stream[:4] != MAGIC[:4]:
        raise RecordingError(other_content(stream))
    if len(stream) < len(MAGIC):
        raise RecordingError("not a recording: it ends after 'RBTL'")
    if stream[4] != FORMAT_VERSION:
        raise RecordingError(_other_version(stream[4]))


def check_number(stream: bytes) -> None:
    """Raise RecordingError if a stream has too many frames. Only lengths are read."""
    if len(stream) <= MAX_FRAMES * (_HEAD + 1):
        return
    position, number = len(MAGIC), 0
    while position + _HEAD <= len(stream):
        position += _HEAD + _LENGTH_AND_SUM.unpack_from(stream, position)[0]
        number += 1
        if number > MAX_FRAMES:
            raise RecordingError(f"damaged: more than {MAX_FRAMES:,} frames")


def other_content(content: bytes) -> str:
    """Return the error of content that is not a recording."""
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
    check_number(stream)
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
    texts: int = 0
    changes: int = 0
    created: int = 0

    def add(self, frame: Mapping[str, Any]) -> None:
        """Count a frame, which need not be valid."""
        self.frames += 1
        if "notes" in frame:
            self.notes += _length(frame["notes"])
            self.reasons += _reasons_in(frame)
            self.texts += _texts_in(frame["notes"])
        else:
            self.changes += _length(frame.get("add")) + _length(frame.get("remove"))
            self.created += _length(frame.get("objects")) + _length(frame.get("atoms"))

    def check(self) -> None:
        """Raise RecordingError if a limit is exceeded. The number of frames is checked before."""
        if self.notes > MAX_NOTES:
            raise RecordingError(f"damaged: more than {MAX_NOTES:,} notes")
        if self.reasons > MAX_REASONS:
            raise RecordingError(f"damaged: more than {MAX_REASONS:,} reasons for rejections")
        if self.texts > MAX_TEXTS:
            raise RecordingError(f"damaged: more than {MAX_TEXTS:,} bytes of texts in notes")
        if self.changes > MAX_CHANGES:
            raise RecordingError(f"damaged: more than {MAX_CHANGES:,} changes of facts")
        if self.created > MAX_CREATED:
            raise RecordingError(f"damaged: more than {MAX_CREATED:,} created objects and facts")


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


def _texts_in(notes: object) -> int:
    """Return the bytes that count for the texts of notes, which need not be valid."""
    # No recursion: an invalid frame can be nested more deeply than Python's stack allows.
    size, rest = 0, [notes]
    while rest:
        value = rest.pop()
        if isinstance(value, str):
            size += len(value) if value.isascii() else 4 * len(value)
        elif isinstance(value, dict):
            rest += value.values()
        elif isinstance(value, list | tuple):
            rest += value
    return size


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
            return unpack_without(payload, without)
        return unpack(payload, checked=checked)
    except (ValueError, msgpack.UnpackException) as error:
        raise RecordingError(f"damaged at byte {start}: {error}") from None


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
