"""Bounded reading of regular files, which may come from anyone."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import IO

from robotouille.errors import Fault, FileError

MAX_FILE_BYTES = 4 * 1024 * 1024

_NO_WAIT = getattr(os, "O_NONBLOCK", 0)


def is_file(path: Path) -> bool:
    """Return whether a file exists; False also if the name is too long or the folder unreadable."""
    try:
        return path.is_file()
    except OSError:
        return False


_BEGINNINGS = (
    (b"\x89PNG", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"\x1f\x8b", "a gzip file"),
    (b"RBTL", "a recording"),
    (b"\x28\xb5\x2f\xfd", "a Zstandard file, such as a recording"),
)
"""First bytes of kinds of files that are often given by mistake."""
_UTF16 = (b"\xff\xfe", b"\xfe\xff")


def content_kind(content: bytes) -> str:
    """Return what a file's content, or its beginning, looks like, e.g. `a PNG picture`."""
    if not content:
        return "an empty file"
    for beginning, kind in _BEGINNINGS:
        if content.startswith(beginning):
            return kind
    # Text has no control characters except tab, line feed, form feed, carriage return and escape.
    control = set(range(32)) - {9, 10, 12, 13, 27}
    if content.startswith(_UTF16) or control.isdisjoint(content[:1024]):
        return "a text file"
    return "a binary file"


def open_regular(path: Path) -> IO[bytes]:
    """Open a file for reading.

    Raises:
        OSError: The path leads to a pipe, a device or a folder, or the file cannot be opened.
    """
    # Without `O_NONBLOCK`, opening a named pipe would wait for a program that writes to it.
    file = open(path, "rb", opener=lambda name, flags: os.open(name, flags | _NO_WAIT))  # noqa: SIM115
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "not a regular file", str(path))
    return file


def read_bytes(path: Path, most: int = MAX_FILE_BYTES) -> bytes:
    """Return the content of a file of at most `most` bytes.

    Raises:
        OSError: The path leads to a pipe, a device or a folder, or the file cannot be read.
        FileError: The file is too large.
    """
    with open_regular(path) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise FileError(str(path), [Fault("", f"the file is longer than {most:,} bytes")])
    return content


def read_text(path: Path, errors: str = "strict", most: int = MAX_FILE_BYTES) -> str:
    """Return the text of a file in UTF-8, with line feeds as line ends; see `read_bytes`."""
    text = read_bytes(path, most).decode("utf-8-sig", errors)
    return text.replace("\r\n", "\n").replace("\r", "\n")
