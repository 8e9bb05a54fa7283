"""In-memory folder of recordings that can fill up and lose the end of an append.

It outlives the processes that write to it. Completed appends survive a crash. The append in
progress when a process is killed may be torn at any byte. Locks end with their process.
"""

from __future__ import annotations

import errno
import io
import random
from collections.abc import Callable
from typing import BinaryIO

from robotouille_server.rooms.recording.storage import FileCondition
from tests.programs.simulation.loop import Killed, Process, current_process

__all__ = ["Disk", "OpenFile"]


class Disk:
    """Implementation of the server's `Storage`."""

    def __init__(self, chance: random.Random) -> None:
        self.files: dict[str, bytearray] = {}
        self.full = False
        self.on_append: Callable[[str, int, bytes], None] | None = None
        self.on_cut: Callable[[str, int], None] | None = None
        self.on_closed: Callable[[str, bytes], None] | None = None
        self.on_removed: Callable[[str], None] | None = None
        self.dies_after: int | None = None
        self._random = chance
        self._locks: dict[str, OpenFile] = {}

    # Called by the server

    def names(self) -> list[str]:
        self._alive()
        return sorted(self.files)

    def read(self, name: str) -> bytes:
        self._alive()
        return bytes(self._content(name))

    def open(self, name: str) -> BinaryIO:
        return io.BytesIO(self.read(name))

    def create(self, name: str) -> OpenFile:
        self._alive()
        self._fail_if_full()
        if name in self.files:
            raise FileExistsError(errno.EEXIST, "File exists", name)
        self.files[name] = bytearray()
        return self._lock(name)

    def resume(self, name: str) -> OpenFile:
        self._alive()
        self._content(name)
        return self._lock(name)

    def replace(self, name: str, content: bytes) -> None:
        self._alive()
        self._fail_if_full()
        if self._dies():
            self._kill()
        self.files[name] = bytearray(content)
        if self.on_closed is not None:
            self.on_closed(name, content)

    def free_space(self) -> int:
        return 2**40

    def remove(self, name: str) -> None:
        self._alive()
        self._content(name)
        del self.files[name]
        if self.on_removed is not None:
            self.on_removed(name)

    # Called by open files

    def append(self, file: OpenFile, data: bytes) -> None:
        self._alive()
        content = self._content(file.name)
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device", file.name)
        if self._dies():
            torn = data[: self._random.randint(0, len(data))]
            content += torn
            if self.on_append is not None:
                self.on_append(file.name, len(content) - len(torn), torn)
            self._kill()
        before = len(content)
        content += data
        if self.on_append is not None:
            self.on_append(file.name, before, data)

    def cut(self, file: OpenFile, size: int) -> None:
        self._alive()
        content = self._content(file.name)
        if size < len(content):
            del content[size:]
            if self.on_cut is not None:
                self.on_cut(file.name, size)

    def unlock(self, file: OpenFile) -> None:
        if self._locks.get(file.name) is file:
            del self._locks[file.name]

    def _lock(self, name: str) -> OpenFile:
        holder = self._locks.get(name)
        if holder is not None and not (holder.process is not None and holder.process.dead):
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable", name)
        file = self._locks[name] = OpenFile(self, name, current_process())
        return file

    def _content(self, name: str) -> bytearray:
        if name not in self.files:
            raise FileNotFoundError(errno.ENOENT, "No such file or directory", name)
        return self.files[name]

    def _fail_if_full(self) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")

    def _alive(self) -> None:
        """Stop `finally` blocks of a dead process from reaching the disk."""
        process = current_process()
        if process is not None and process.dead:
            raise Killed

    def _dies(self) -> bool:
        if self.dies_after is None:
            return False
        self.dies_after -= 1
        if self.dies_after > 0:
            return False
        self.dies_after = None
        return True

    def _kill(self) -> None:
        process = current_process()
        if process is not None:
            process.kill()
        raise Killed


class OpenFile:
    """File that is open for appending, and locked."""

    def __init__(self, disk: Disk, name: str, process: Process | None) -> None:
        self.name = name
        self.process = process
        self._disk = disk
        self._open = True

    def append(self, data: bytes) -> None:
        if not self._open:
            raise OSError(errno.EBADF, "Bad file descriptor", self.name)
        self._disk.append(self, data)

    def cut(self, size: int) -> None:
        self._disk.cut(self, size)

    def read(self) -> bytes:
        return self._disk.read(self.name)

    def condition(self) -> FileCondition:
        return FileCondition.WHOLE

    def close(self) -> None:
        self._open = False
        self._disk.unlock(self)
