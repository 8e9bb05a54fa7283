"""Small files that only their owner may access, also written durably and atomically."""

from __future__ import annotations

import os
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from robotouille.files.private import PrivateFileError, read_private

__all__ = [
    "Fingerprint",
    "PrivateFileError",
    "fingerprint",
    "locked",
    "read_private",
    "write_private",
]

Fingerprint = tuple[int, int, int]


def fingerprint(path: Path) -> Fingerprint | None:
    """Return a value that changes whenever the file does; None if the file does not exist."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_ino, found.st_size


def write_private(path: Path, content: bytes, *, replace: bool, durable_name: bool = True) -> None:
    """Write a file durably and atomically, accessible to its owner only.

    Args:
        path: The file.
        content: Its content.
        replace: Replace an existing file.
        durable_name: Sync the folder, too. Otherwise a power failure may remove a new file, but
            never leaves an incomplete one.

    Raises:
        FileExistsError: The file exists, and `replace` is False.
        PrivateFileError: The file cannot be written.
    """
    # In the same folder, because only there a rename is atomic. The random part keeps two processes
    # from writing the same file.
    new = path.with_name(f".{path.name}.{secrets.token_hex(4)}.new")
    try:
        try:
            # The mode is set at creation. With a later `chmod`, other users could open the file in
            # between.
            descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            if replace:
                _keep_owner(path, new)
                new.replace(path)
            else:
                # A link fails if the name exists, which a rename does not.
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
    """Lock a folder against other processes. On Windows, nothing is locked.

    Raises:
        PrivateFileError: The folder cannot be opened.
    """
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
    # Root may change the files of a server that runs as another user, which must stay able to
    # read them.
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
