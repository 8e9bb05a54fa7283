"""Writing of whole files, and checks that commands make before their work begins."""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from robotouille.errors import RobotouilleError

_NO_WAIT = getattr(os, "O_NONBLOCK", 0)
_NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0)
_DEVICES = (Path("/dev"), Path("/dev/fd"))
"""Folders of standard output and pipes, which are written in place."""
LINK = "it is a symbolic link, and another file would be changed; delete the link"


def check_file(path: Path, name: str = "--out") -> None:
    """Reject a file that cannot be written.

    Args:
        name: The option or argument, for the error.

    Raises:
        RobotouilleError: Its folder is missing, it is a folder, or it cannot be written.
    """
    try:
        if not path.name or path.is_dir():
            why = f"{str(path)!r} is a folder; expected a file"
        elif not path.parent.is_dir():
            why = f"no folder {path.parent}; create it first"
        elif not os.access(path if path.exists() else path.parent, os.W_OK):
            why = f"{path} cannot be written"
        else:
            return
    except OSError as error:  # For example, a name of 300 letters.
        why = f"{path} cannot be written: {error.strerror}"
    raise RobotouilleError(f"{name}: {why}")


def check_folder(path: Path, name: str = "--out") -> None:
    """Reject a folder that cannot be created or written.

    Args:
        name: The option or argument, for the error.

    Raises:
        RobotouilleError: A file is in its place or in that of a parent, or it cannot be written.
    """
    try:
        there = next(each for each in (path, *path.absolute().parents) if each.exists())
        if not there.is_dir():
            why = f"{there} is a file; expected a folder"
        elif not os.access(there, os.W_OK):
            why = f"{there} cannot be written"
        else:
            return
    except OSError as error:
        why = f"{path} cannot be written: {error.strerror}"
    raise RobotouilleError(f"{name}: {why}")


@contextmanager
def whole_file(path: Path, *, text: bool = True, mode: int = 0o666) -> Iterator[IO[Any]]:
    """Open a file for writing that replaces `path` only if the block succeeds.

    Line endings of text are not converted. A link is replaced itself, not the file it points to.

    Args:
        mode: Permissions before the umask. A file that only its owner could read stays private.

    Raises:
        OSError: The file cannot be written; the error names `path`.
    """
    kind: dict[str, Any] = {"encoding": "utf-8", "newline": ""} if text else {}
    if path.parent in _DEVICES:
        with path.open("w" if text else "wb", **kind) as file:
            yield file
        return
    with (
        drafted(path, draft_of(path), mode) as draft,
        draft.open("r+" if text else "r+b", **kind) as file,
    ):
        yield file


def replace_file(path: Path, content: str | bytes) -> None:
    """Write a file completely or not at all, like `whole_file`."""
    with whole_file(path, text=isinstance(content, str)) as file:
        file.write(content)


def draft_of(path: Path) -> Path:
    """Return an unpredictable name next to `path`, for a file that will replace it."""
    # In the same folder, because only there a rename is atomic.
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")


@contextmanager
def drafted(path: Path, draft: Path, mode: int = 0o666) -> Iterator[Path]:
    """Create the file `draft`, which replaces `path` if the block succeeds, else is deleted.

    Raises:
        OSError: The file cannot be written; the error names `path`.
    """
    try:
        # Folders come from other people: a link or pipe they put there must never be opened.
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _NO_FOLLOW
        os.close(os.open(draft, flags, mode & 0o600 if _is_private(path) else mode))
        try:
            yield draft
            draft.replace(path)
        finally:
            with suppress(OSError):
                draft.unlink(missing_ok=True)
    except OSError as error:
        if error.filename in (None, str(draft)):
            with suppress(AttributeError):  # Errors of PyAV have a read-only name.
                error.filename = str(path)
        raise


def _is_private(path: Path) -> bool:
    try:
        found = path.lstat().st_mode
    except OSError:
        return False
    return stat.S_ISREG(found) and not stat.S_IMODE(found) & 0o077


def open_own(path: str, flags: int) -> int:
    """Open a file that is changed in place; pass this as `opener` to `open` or `FileIO`.

    Raises:
        OSError: The file is a symbolic link, which may point to any file of the user.
    """
    try:
        return os.open(path, flags | _NO_FOLLOW | _NO_WAIT, 0o666)
    except OSError as error:
        if error.errno == errno.ELOOP:
            error.strerror = LINK
        raise
