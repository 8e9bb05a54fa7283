"""Where recordings live: a folder of files that are appended to while an episode runs.

An append is handed to the operating system before it returns, so that what was appended outlives
the process. A file that is open for appending is locked: of two processes on one folder only one
can continue an episode. Links are not followed, and nothing but plain files is seen.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import sys
from enum import Enum
from pathlib import Path
from typing import Protocol

__all__ = ["Appender", "FileCondition", "Folder", "Storage"]


MODE = 0o640
"""Names and chat are nobody else's business."""
PLAIN = getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0)
NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | PLAIN


class FileCondition(Enum):
    """What has become of a file that is open for appending."""

    WHOLE = "whole"
    REMOVED = "removed"
    """It has no name any more; what was appended can still be read here, and only here."""
    CUT_SHORT = "cut short"
    """Something that was appended is gone."""


class Appender(Protocol):
    """A file that grows."""

    def append(self, data: bytes) -> None:
        """All of `data`, or OSError and the file is as before; it may be tried again."""

    def cut(self, size: int) -> None:
        """Keep the first `size` bytes only."""

    def read(self) -> bytes:
        """What was appended, also where the file has lost its name; less where it was cut."""

    def condition(self) -> FileCondition:
        """What others have done to the file; takes a microsecond or two."""

    def close(self) -> None:
        """Give the file, and the lock on it, up."""


class Storage(Protocol):
    """A folder of files; everything may raise OSError."""

    def names(self) -> list[str]:
        """The names of all files, in order."""

    def read(self, name: str) -> bytes:
        """A file's content."""

    def create(self, name: str) -> Appender:
        """A new file; FileExistsError if there is one."""

    def resume(self, name: str) -> Appender:
        """Go on at the end of a file; BlockingIOError if another process writes it."""

    def replace(self, name: str, content: bytes) -> None:
        """Write a whole file, durably and in one step."""

    def remove(self, name: str) -> None:
        """Delete a file."""


class Folder:
    """A folder on disk."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def names(self) -> list[str]:
        if not self.path.is_dir():
            return []
        entries = os.scandir(self.path)
        return sorted(entry.name for entry in entries if entry.is_file(follow_symlinks=False))

    def read(self, name: str) -> bytes:
        flags = os.O_RDONLY | PLAIN | getattr(os, "O_NONBLOCK", 0)
        with os.fdopen(os.open(self._file(name), flags), "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise FileNotFoundError(errno.ENOENT, "not a plain file", name)
            return file.read()

    def create(self, name: str) -> Appender:
        self.path.mkdir(parents=True, exist_ok=True)
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | PLAIN
        return _File(os.open(self._file(name), flags, MODE))

    def resume(self, name: str) -> Appender:
        return _File(os.open(self._file(name), os.O_RDWR | PLAIN))

    def replace(self, name: str, content: bytes) -> None:
        self.path.mkdir(parents=True, exist_ok=True)
        path = self._file(name)
        new = path.with_name(f"{name}.new")
        with os.fdopen(os.open(new, NEW_FILE, MODE), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        new.replace(path)
        _sync(self.path)

    def remove(self, name: str) -> None:
        self._file(name).unlink()

    def _file(self, name: str) -> Path:
        if Path(name).name != name:
            raise FileNotFoundError(errno.ENOENT, "not a file of this folder", name)
        return self.path / name


class _File:
    """A locked file descriptor and the size of what was appended whole."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        try:
            _lock(descriptor)
        except OSError:
            os.close(descriptor)
            raise
        found = os.fstat(descriptor)
        if not found.st_nlink:
            os.close(descriptor)
            raise FileNotFoundError(errno.ENOENT, "another process has just removed it")
        self._size = found.st_size
        self._cut_short = False

    def cut(self, size: int) -> None:
        os.ftruncate(self._descriptor, size)
        self._size = size

    def append(self, data: bytes) -> None:
        self._notice_cut(os.fstat(self._descriptor))
        written = 0
        try:
            while written < len(data):
                written += _write_at(self._descriptor, data[written:], self._size + written)
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self._size)
            raise
        self._size += written

    def _notice_cut(self, found: os.stat_result) -> None:
        """Once, and for good: the next append makes the file as long as it was."""
        self._cut_short = self._cut_short or found.st_size < self._size

    def read(self) -> bytes:
        pieces, left = [], self._size
        while left:
            piece = _read_at(self._descriptor, left, self._size - left)
            if not piece:
                break
            pieces.append(piece)
            left -= len(piece)
        return b"".join(pieces)

    def condition(self) -> FileCondition:
        found = os.fstat(self._descriptor)
        self._notice_cut(found)
        if self._cut_short:
            return FileCondition.CUT_SHORT
        return FileCondition.WHOLE if found.st_nlink else FileCondition.REMOVED

    def close(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


if sys.platform == "win32":

    def _write_at(descriptor: int, data: bytes, offset: int) -> int:
        os.lseek(descriptor, offset, os.SEEK_SET)
        return os.write(descriptor, data)

    def _read_at(descriptor: int, size: int, offset: int) -> bytes:
        os.lseek(descriptor, offset, os.SEEK_SET)
        return os.read(descriptor, size)

    def _sync(folder: Path) -> None:
        pass  # Folders cannot be opened there.

    def _lock(descriptor: int) -> None:
        import msvcrt

        # One byte far behind any content, so that others can read the file.
        os.lseek(descriptor, 2**40, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)

else:

    def _write_at(descriptor: int, data: bytes, offset: int) -> int:
        return os.pwrite(descriptor, data, offset)

    def _read_at(descriptor: int, size: int, offset: int) -> bytes:
        return os.pread(descriptor, size, offset)

    def _sync(folder: Path) -> None:
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)

    def _lock(descriptor: int) -> None:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
