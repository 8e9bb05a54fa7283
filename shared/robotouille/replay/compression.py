"""Files of recordings: a closed one is a zstd frame with a checksum over the whole stream."""

from __future__ import annotations

import sys
from io import BytesIO

from robotouille.errors import RecordingError
from robotouille.replay.container import (
    MAGIC,
    MAX_FILE,
    check_magic,
    check_number,
    other_content,
)

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

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

_ZSTD = b"\x28\xb5\x2f\xfd"


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
    check_number(stream)
    return stream, fault


def _decompressed(content: bytes, limit: int) -> tuple[bytes, str]:
    # Its value is not copied, as that of a list of pieces would be.
    found, fault = BytesIO(), ""
    try:
        failed = _inflate(content, found, len(content), limit)
        if failed < len(content):
            # Nothing comes out of a piece that contains damage. A second pass, byte by byte in
            # that piece, finds what stands before the damage.
            found.seek(0)
            found.truncate()
            _inflate(content, found, failed, limit)
            fault = "damaged: the compressed stream is invalid"
    except RecordingError as error:
        fault = str(error)
    return found.getvalue(), fault


def _inflate(content: bytes, found: BytesIO, intact_bytes: int, limit: int) -> int:
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


def _feed(decompressor: zstd.ZstdDecompressor, piece: bytes, found: BytesIO, limit: int) -> None:
    # A decompression bomb is noticed by its first bytes or by its size, before it fills memory.
    while piece or not (decompressor.needs_input or decompressor.eof):
        more = decompressor.decompress(piece, max_length=PLAIN_PIECE)
        piece = b""
        if not more:
            continue
        if not found.tell() and not more.startswith(MAGIC[: min(4, len(more))]):
            found.write(more)
            raise RecordingError(other_content(more))
        found.write(more)
        if found.tell() > limit:
            raise RecordingError(f"damaged: more than {limit:,} bytes, uncompressed")
