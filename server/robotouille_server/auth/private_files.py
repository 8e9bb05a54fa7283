"""Small files that nobody else may read or change: written durably, in one step."""

from __future__ import annotations

import os
import secrets
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from robotouille.errors import RobotouilleError

__all__ = ["PrivateFileError", "fingerprint", "locked", "read_private", "write_private"]

Fingerprint = tuple[int, int, int]


class PrivateFileError(RobotouilleError):
    """A file that cannot be used: names the file and the fault."""

    def __init__(self, source: str, fault: str) -> None:
        self.source = source
        self.fault = fault
        super().__init__(f"{source}: {fault}")


def fingerprint(path: Path) -> Fingerprint | None:
    """What changes whenever the file does; None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_ino, found.st_size


def read_private(path: Path, max_bytes: int) -> bytes:
    """The content of a file; FileNotFoundError where there is none, PrivateFileError where others
    may use it, where it has more than `max_bytes`, or where it cannot be read."""
    source = str(path)
    try:
        with path.open("rb") as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            if sys.platform != "win32" and mode & 0o027:
                fault = f"others may use it (mode {mode:04o}); run `chmod 600 {path}`"
                raise PrivateFileError(source, fault)
            content = file.read(max_bytes + 1)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise PrivateFileError(source, f"cannot be read: {error.strerror}") from None
    if len(content) > max_bytes:
        raise PrivateFileError(source, f"larger than {max_bytes} bytes; is it the right file?")
    return content


def write_private(path: Path, content: bytes, *, replace: bool, durable_name: bool = True) -> None:
    """Write a file durably, in one step, readable by its owner only. Without `durable_name` a
    power cut may take a new file with it, but leaves none that is not whole.

    FileExistsError where there is one that is not to be replaced, PrivateFileError where it
    cannot be written.
    """
    new = path.with_name(f".{path.name}.{secrets.token_hex(4)}.new")
    try:
        try:
            descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            if replace:
                _keep_owner(path, new)
                new.replace(path)
            else:
                os.link(new, path)
        finally:
            new.unlink(missing_ok=True)
        if durable_name:
            _sync_folder(path.parent)
    except FileExistsError:
        raise
    except OSError as error:
        raise PrivateFileError(str(path), f"cannot be written: {error.strerror}") from None


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """One process at a time changes what lies in a folder; PrivateFileError where that cannot be
    had. (On Windows nobody waits.)"""
    if sys.platform == "win32":
        yield
        return
    import fcntl

    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise PrivateFileError(str(folder), f"cannot be opened: {error.strerror}") from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _keep_owner(old: Path, new: Path) -> None:
    """So that root can change the files of a server that runs as somebody else."""
    if sys.platform != "win32" and os.geteuid() == 0:
        owner = (old if old.exists() else old.parent).stat()
        os.chown(new, owner.st_uid, owner.st_gid)


def _sync_folder(folder: Path) -> None:
    if sys.platform != "win32":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
