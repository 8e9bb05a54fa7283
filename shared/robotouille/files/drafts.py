"""Drafts: files and folders that get their name when they are complete.

A draft is locked while it is written, and the kernel releases the lock of a killed process. The
next draft for the same output can therefore delete what a killed process has left.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

NO_WAIT = getattr(os, "O_NONBLOCK", 0)
NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0)
_NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_FOLLOW
MAX_NUMBERED = 8
"""Drafts of one output with a number: enough for the programs that write it at the same time. With
numbers, an abandoned draft is found without listing its folder."""


def draft_of(path: Path, ending: str = "tmp") -> Path:
    """Return a free name next to `path`, for a file or folder that will replace it."""
    return next(name for name in _names(path, ending) if _is_free(name))


def _names(path: Path, ending: str) -> Iterator[Path]:
    # In the same folder, because only there a rename is atomic.
    for number in range(MAX_NUMBERED):
        yield path.with_name(f".{path.name}.{number}.{ending}")
    while True:
        yield path.with_name(f".{path.name}.{secrets.token_hex(4)}.{ending}")


@contextmanager
def drafted(
    path: Path, draft: Path | None = None, mode: int = 0o666, *, replace: bool = True
) -> Iterator[Path]:
    """Create a file that gets the name `path` if the block succeeds, else is deleted.

    Args:
        draft: Its name until then. Default: that of `draft_of`.
        mode: Permissions before the umask. A file that only its owner could read stays private.
        replace: False to raise FileExistsError if there is a file named `path`.

    Raises:
        OSError: The file cannot be written; the error names `path`.
    """
    mode = mode & 0o600 if _is_private(path) else mode
    names = _names(path, "tmp") if draft is None else [draft]
    try:
        # Folders come from other people: a link or pipe they put there must never be opened.
        with _locked(names, lambda new: _new_file(new, mode)) as name:
            yield name
            if replace or not _linked(name, path):
                name.replace(path)
    except OSError as error:
        if error.filename is None or Path(error.filename).name.startswith(f".{path.name}."):
            with suppress(AttributeError):  # Errors of PyAV have a read-only name.
                error.filename = str(path)
        raise


@contextmanager
def drafted_folder(path: Path) -> Iterator[Path]:
    """Create a folder next to `path`. Unless the block renames it, it is deleted.

    Raises:
        OSError: The folder cannot be created.
    """
    with _locked(_names(path, "part"), _new_folder) as draft:
        yield draft


def _linked(name: Path, path: Path) -> bool:
    """Give a file another name that no file has. Return whether the file system can do that."""
    try:
        path.hardlink_to(name)
    except FileExistsError:
        raise
    except OSError:
        if os.path.lexists(path):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        return False
    return True


def _is_private(path: Path) -> bool:
    try:
        found = path.lstat().st_mode
    except OSError:
        return False
    return stat.S_ISREG(found) and not stat.S_IMODE(found) & 0o077


@contextmanager
def _locked(names: Iterable[Path], create: Callable[[Path], int]) -> Iterator[Path]:
    """Create a draft under the first free name, lock it, and delete it after the block."""
    for name in names:
        if not _is_free(name):
            continue
        try:
            descriptor = create(name)
        except FileExistsError:
            continue
        try:
            # Another process may have deleted the draft before the lock.
            if _lock(descriptor) and not _has_name(descriptor, name):
                continue
            yield name
            return
        finally:
            with suppress(OSError):
                _discard(descriptor, name)
            os.close(descriptor)
    raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))


def _has_name(descriptor: int, name: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), name.lstat())
    except FileNotFoundError:
        return False


if sys.platform == "win32":

    def _is_free(name: Path) -> bool:
        return not os.path.lexists(name)

    # Windows cannot rename open files, and cannot open folders.
    def _new_file(name: Path, mode: int) -> int:
        os.close(os.open(name, _NEW_FILE, mode))
        return os.open(os.devnull, os.O_RDONLY)

    def _new_folder(name: Path) -> int:
        name.mkdir()
        return os.open(os.devnull, os.O_RDONLY)

    def _lock(descriptor: int) -> bool:
        return False

    def _discard(descriptor: int, name: Path) -> None:
        if name.is_dir():
            shutil.rmtree(name)
        else:
            name.unlink(missing_ok=True)

else:
    import fcntl

    def _is_free(name: Path) -> bool:
        """Return whether a draft can have a name, after deleting an abandoned one."""
        try:
            descriptor = os.open(name, os.O_RDONLY | NO_FOLLOW | NO_WAIT)
        except OSError:
            return not os.path.lexists(name)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return _has_name(descriptor, name) and _deleted(descriptor, name)
        except OSError:  # A process writes it, or it cannot be locked or deleted.
            return False
        finally:
            os.close(descriptor)

    def _deleted(descriptor: int, name: Path) -> bool:
        found = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(found):
            shutil.rmtree(name)  # Follows no links.
        elif stat.S_ISREG(found):
            name.unlink()
        else:
            return False
        return True

    def _new_file(name: Path, mode: int) -> int:
        return os.open(name, _NEW_FILE, mode)

    def _new_folder(name: Path) -> int:
        name.mkdir()
        return os.open(name, os.O_RDONLY | NO_FOLLOW)

    def _lock(descriptor: int) -> bool:
        """Lock a draft. Return whether the file system has locks."""
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        except OSError:
            return False
        return True

    def _discard(descriptor: int, name: Path) -> None:
        """Delete a draft unless it was renamed: its name may belong to another one by now."""
        if _has_name(descriptor, name):
            _deleted(descriptor, name)
