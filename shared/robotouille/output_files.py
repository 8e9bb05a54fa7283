"""Checks of output files and folders, for commands to make before their work begins."""

from __future__ import annotations

import os
from pathlib import Path

from robotouille.errors import RobotouilleError


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
