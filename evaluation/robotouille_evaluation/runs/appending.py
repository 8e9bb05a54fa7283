"""Lines at the end of a file, whole or not at all: a disk can be full in the middle of one."""

from __future__ import annotations

import os
from contextlib import suppress
from io import FileIO

__all__ = ["append_line"]


def append_line(file: FileIO, line: bytes) -> None:
    """Write a line behind what is there; it is on the disk when this returns.

    Args:
        file: Open for appending, without a buffer.

    Raises:
        OSError: It cannot be written; then nothing of it is.
    """
    size = file.seek(0, os.SEEK_END) if file.seekable() else None
    try:
        rest = memoryview(line)
        while rest:
            rest = rest[file.write(rest) :]
        if size is not None:
            os.fsync(file.fileno())
    except OSError:
        with suppress(OSError):
            if size is not None:
                file.truncate(size)
        raise
