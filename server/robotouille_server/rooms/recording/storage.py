"""Storage of recordings: a folder of files that grow while an episode runs.

An append is handed to the operating system before it returns, so appended data survives the
process. Files that are open for appending are locked: of two processes with the same folder, only
one can continue an episode. Links are not followed, and everything but plain files is ignored.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import stat
import sys
from enum import Enum
from pathlib import Path
from typing import BinaryIO, Protocol

from robotouille.errors import RecordingError
from robotouille.replay.container import MAX_FILE

MODE = 0o640
"""Mode of recordings. They contain names and chat, so other users may not read them."""
PLAIN = getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0)
NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | PLAIN


class FileCondition(Enum):
    """Condition of a file that is open for appending."""

    WHOLE = "whole"
    REMOVED = "removed"
    """The file has no name any more. Its data can only be read through this object."""
    CUT_SHORT = "cut short"
    """Appended data is gone."""


class Appender(Protocol):
    """File that grows."""

    def append(self, data: bytes) -> None:
        """Append all data, or raise OSError and leave the file as it was."""

    def cut(self, size: int) -> None:
        """Keep only the first `size` bytes."""

    def read(self) -> bytes:
        """Return the content, even if the file has lost its name."""

    def condition(self) -> FileCondition:
        """Return whether other programs have changed the file. Takes a few microseconds."""

    def close(self) -> None:
        """Close the file and release its lock."""


class Storage(Protocol):
    """Folder of files. All methods may raise OSError."""

    def names(self) -> list[str]:
        """Return the names of all files, in order."""

    def read(self, name: str) -> bytes:
        """Return the content of a file; raise RecordingError if it is larger than `MAX_FILE`."""

    def open(self, name: str) -> BinaryIO:
        """Open a file for reading in pieces."""

    def create(self, name: str) -> Appender:
        """Create a file; raise FileExistsError if it exists."""

    def resume(self, name: str) -> Appender:
        """Open a file for appending; raise BlockingIOError if another process writes it."""

    def replace(self, name: str, content: bytes) -> None:
        """Write a whole file, durably and atomically."""

    def remove(self, name: str) -> None:
        """Delete a file."""

    def free_space(self) -> int:
        """Return the free bytes of the disk."""


class Folder:
    """Folder on disk."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def names(self) -> list[str]:
        if not self.path.is_dir():
            return []
        # Links are left out: a link in the folder could make the server read or replace another
        # file.
        entries = os.scandir(self.path)
        return sorted(entry.name for entry in entries if entry.is_file(follow_symlinks=False))

    def read(self, name: str) -> bytes:
        with self.open(name) as file:
            size = os.fstat(file.fileno()).st_size
            if size > MAX_FILE:
                raise RecordingError(f"larger than {MAX_FILE >> 20} MiB, the maximum size")
            return file.read(size)

    def open(self, name: str) -> BinaryIO:
        # Opening a named pipe without `O_NONBLOCK` would block the event loop until a program
        # writes to it.
        flags = os.O_RDONLY | PLAIN | getattr(os, "O_NONBLOCK", 0)
        file = os.fdopen(os.open(self._file(name), flags), "rb")
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            file.close()
            raise FileNotFoundError(errno.ENOENT, "not a plain file", name)
        return file

    def create(self, name: str) -> Appender:
        self.path.mkdir(parents=True, exist_ok=True)
        # With `O_EXCL`, an existing recording is never overwritten, even if two ids are equal.
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
            # The file is synced before the rename. Otherwise, after a power cut, the new name could
            # refer to an empty file.
            os.fsync(file.fileno())
        new.replace(path)
        _sync(self.path)

    def remove(self, name: str) -> None:
        self._file(name).unlink()

    def free_space(self) -> int:
        return shutil.disk_usage(self.path).free

    def _file(self, name: str) -> Path:
        # Names also come from the operator's requests for recordings, such as `../keys.json`.
        if Path(name).name != name:
            raise FileNotFoundError(errno.ENOENT, "not a file of this folder", name)
        return self.path / name


class _File:
    """Locked file descriptor, and the size of the completely appended data."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        try:
            # The lock comes first, because the size below is reliable only while no other process
            # can append.
            _lock(descriptor)
        except OSError:
            os.close(descriptor)
            raise
        found = os.fstat(descriptor)
        # Without links, the file was closed and removed by another process between `open` and the
        # lock.
        if not found.st_nlink:
            os.close(descriptor)
            raise FileNotFoundError(errno.ENOENT, "another process has just removed the file")
        self._size = found.st_size
        self._cut_short = False

    def cut(self, size: int) -> None:
        os.ftruncate(self._descriptor, size)
        self._size = size

    def append(self, data: bytes) -> None:
        # The end of the file costs a fraction of its status, and this runs for every step.
        self._notice_cut(os.lseek(self._descriptor, 0, os.SEEK_END))
        written = 0
        try:
            # `pwrite` may write less than requested, for example when the disk is nearly full.
            while written < len(data):
                written += _write_at(self._descriptor, data[written:], self._size + written)
        except OSError:
            with contextlib.suppress(OSError):
                # Remove what was written: half a frame in the middle of a file would count as
                # damage and end the recording there.
                os.ftruncate(self._descriptor, self._size)
            raise
        self._size += written

    def _notice_cut(self, found: int) -> None:
        # The flag remembers this, because the next append restores the length of the file.
        self._cut_short = self._cut_short or found < self._size

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
        self._notice_cut(found.st_size)
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
        pass  # Windows cannot open folders.

    def _lock(descriptor: int) -> None:
        import msvcrt

        # Lock a byte far behind any content, so that other programs can read the file.
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
