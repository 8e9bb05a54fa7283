"""Pictures of pixels from elsewhere: which PNG files are taken, and what of them is kept.

W3C, Portable Network Graphics, https://www.w3.org/TR/png-3/, sections 5 and 11.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

from robotouille.errors import RobotouilleError

__all__ = ["MAX_PICTURE_BYTES", "MAX_SIDE", "PictureError", "plain_png"]

MAX_PICTURE_BYTES = 256 * 1024
MAX_SIDE = 1024
"""Pixels: what a decoder makes of a picture is 4 MiB at most, whatever the file says."""
SIGNATURE = b"\x89PNG\r\n\x1a\n"
KEPT = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
"""The chunks that make the picture; others hold texts and profiles, which may be compressed."""


class PictureError(RobotouilleError):
    """A file that is no picture, or not one that is taken."""


def plain_png(content: bytes) -> bytes:
    """A picture without all that is not needed to draw it.

    Raises:
        PictureError: It is no PNG, torn, too long, or has too many pixels.
    """
    if len(content) > MAX_PICTURE_BYTES:
        raise PictureError(f"has {len(content):,} bytes; at most {MAX_PICTURE_BYTES:,} are taken")
    if not content.startswith(SIGNATURE):
        raise PictureError("is no PNG picture")
    chunks = list(_chunks(content))
    kinds = [kind for kind, _ in chunks]
    if kinds[0] != b"IHDR" or kinds[-1] != b"IEND" or kinds.count(b"IHDR") != 1:
        raise PictureError("is a PNG without its beginning or its end")
    width, height = struct.unpack(">II", chunks[0][1][:8])
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise PictureError(f"is {width} × {height} pixels large; at most {MAX_SIDE} a side are")
    kept = (_chunk(kind, data) for kind, data in chunks if kind in KEPT)
    return SIGNATURE + b"".join(kept)


def _chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """The kinds and data of the chunks up to the end."""
    at = len(SIGNATURE)
    while at + 12 <= len(content):
        (size,) = struct.unpack_from(">I", content, at)
        kind, data = content[at + 4 : at + 8], content[at + 8 : at + 8 + size]
        check = content[at + 8 + size : at + 12 + size]
        if check != struct.pack(">I", zlib.crc32(kind + data)) or (kind == b"IHDR" and size != 13):
            break
        yield kind, data
        if kind == b"IEND":
            return
        at += 12 + size
    raise PictureError("is a torn PNG")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
