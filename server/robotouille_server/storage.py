"""Where recordings live: a folder of files that are appended to while an episode runs.

An append is handed to the operating system before it returns, so that what was appended outlives
the process. A file that is open for appending is locked: of two processes on one folder only one
can continue an episode.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from pathlib import Path
from typing import Protocol

__all__ = ["Appender", "Folder", "Storage"]


MODE = 0o640
"""Names and chat are nobody else's business."""
NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_BINARY", 0)


class Appender(Protocol):
    """A file that grows."""

    def append(self, data: bytes) -> None:
        """All of `data`, or OSError and the file is as before; it may be tried again."""

    def cut(self, size: int) -> None:
        """Keep the first `size` bytes only."""

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
        return sorted(entry.name for entry in os.scandir(self.path) if entry.is_file())

    def read(self, name: str) -> bytes:
        return self._file(name).read_bytes()

    def create(self, name: str) -> Appender:
        self.path.mkdir(parents=True, exist_ok=True)
        return _File(os.open(self._file(name), os.O_WRONLY | os.O_CREAT | os.O_EXCL, MODE))

    def resume(self, name: str) -> Appender:
        return _File(os.open(self._file(name), os.O_WRONLY))

    def replace(self, name: str, content: bytes) -> None:
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

    def cut(self, size: int) -> None:
        os.ftruncate(self._descriptor, size)
        self._size = size

    def append(self, data: bytes) -> None:
        written = 0
        try:
            while written < len(data):
                written += _write_at(self._descriptor, data[written:], self._size + written)
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self._size)
            raise
        self._size += written

    def close(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


if sys.platform == "win32":

    def _write_at(descriptor: int, data: bytes, offset: int) -> int:
        os.lseek(descriptor, offset, os.SEEK_SET)
        return os.write(descriptor, data)

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

    def _sync(folder: Path) -> None:
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)

    def _lock(descriptor: int) -> None:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
