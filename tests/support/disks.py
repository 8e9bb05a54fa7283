"""Recording folders in which writes can fail."""

from __future__ import annotations

import errno

from robotouille_server.rooms.recording.storage import Appender, FileCondition, Folder

__all__ = ["FullDisk", "NearlyFull", "TroubledFolder", "WrappedFile"]


class TroubledFolder(Folder):
    """Folder that calls `before_append`, which may raise or block, before each append."""

    def before_append(self, name: str) -> None:
        raise NotImplementedError

    def create(self, name: str) -> Appender:
        return _TroubledFile(self, name, super().create(name))


class NearlyFull(Folder):
    """Folder on a disk with configurable free space."""

    free = 2**40

    def free_space(self) -> int:
        return self.free


class WrappedFile:
    """File that forwards to another file."""

    def __init__(self, file: Appender) -> None:
        self._file = file

    def append(self, data: bytes) -> None:
        self._file.append(data)

    def cut(self, size: int) -> None:
        self._file.cut(size)

    def read(self) -> bytes:
        return self._file.read()

    def condition(self) -> FileCondition:
        return self._file.condition()

    def close(self) -> None:
        self._file.close()


class _TroubledFile(WrappedFile):
    def __init__(self, folder: TroubledFolder, name: str, file: Appender) -> None:
        super().__init__(file)
        self._folder = folder
        self._name = name

    def append(self, data: bytes) -> None:
        self._folder.before_append(self._name)
        super().append(data)


class FullDisk(TroubledFolder):
    """Folder on a disk that can be full."""

    full = False

    def before_append(self, name: str) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")

    def replace(self, name: str, content: bytes) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        super().replace(name, content)
