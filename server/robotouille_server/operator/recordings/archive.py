"""Several recordings as one tar file, which is made while it is sent."""

from __future__ import annotations

import tarfile
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from typing import BinaryIO

from robotouille.errors import RecordingError
from robotouille_server.operator.principal import RequestRefusedError
from robotouille_server.operator.recordings.store import pieces

MAX_ARCHIVED = 500
"""Recordings in one archive."""
LEFT_OUT = "left_out.txt"
"""File at the end of an archive with the recordings that could not be read, and the reasons."""
BLOCK = 512
END = bytes(2 * BLOCK)

OpenRecording = Callable[[str], Awaitable[tuple[BinaryIO, int]]]
"""Function that opens a recording and returns the bytes to read."""


async def archive(
    names: Sequence[str], open_one: OpenRecording, time: float
) -> AsyncIterator[bytes]:
    """Yield a tar file of recordings piece by piece. One file is open at a time.

    A recording that cannot be read is left out, because the head of the answer has been sent.

    Args:
        names: The names of the recordings.
        open_one: Opens one of them.
        time: The time of the files in the archive, in seconds since 1970.

    Raises:
        RecordingError: A file became shorter while it was read.
    """
    left_out: list[str] = []
    for name in names:
        try:
            file, size = await open_one(name)
        except RequestRefusedError as error:
            left_out.append(f"{name}: {error.message}\n")
            continue
        yield _head(name, size, time)
        sent = 0
        async for piece in pieces(file, size):
            sent += len(piece)
            yield piece
        if sent != size:
            raise RecordingError(f"{name} became shorter while it was read")
        yield bytes(-size % BLOCK)
    if left_out:
        text = "".join(left_out).encode()
        yield _head(LEFT_OUT, len(text), time) + text + bytes(-len(text) % BLOCK)
    yield END


def _head(name: str, size: int, time: float) -> bytes:
    entry = tarfile.TarInfo(name)
    entry.size, entry.mtime = size, int(time)
    return entry.tobuf(tarfile.PAX_FORMAT)
