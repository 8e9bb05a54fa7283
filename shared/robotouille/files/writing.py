"""Writing of whole files, and checks that commands make before their work begins."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from robotouille.errors import RobotouilleError
from robotouille.files.drafts import NO_FOLLOW, NO_WAIT, drafted

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
        drafted(path, mode=mode) as draft,
        draft.open("r+" if text else "r+b", **kind) as file,
    ):
        yield file


def replace_file(path: Path, content: str | bytes) -> None:
    """Write a file completely or not at all, like `whole_file`."""
    with whole_file(path, text=isinstance(content, str)) as file:
        file.write(content)


def open_own(path: str, flags: int) -> int:
    """Open a file that is changed in place; pass this as `opener` to `open` or `FileIO`.

    Raises:
        OSError: The file is a symbolic link, which may point to any file of the user.
    """
    try:
        return os.open(path, flags | NO_FOLLOW | NO_WAIT, 0o666)
    except OSError as error:
        if error.errno == errno.ELOOP:
            error.strerror = LINK
        raise
