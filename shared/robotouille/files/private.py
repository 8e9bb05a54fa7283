"""Small files that only their owner may access."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

from robotouille.errors import RobotouilleError
from robotouille.files.reading import open_regular


def user_state(name: str) -> Path:
    """Return a folder of this user for what commands remember."""
    home = os.environ.get("XDG_STATE_HOME")
    return (Path(home) if home else Path.home() / ".local" / "state") / "robotouille" / name


class PrivateFileError(RobotouilleError):
    """A file cannot be used. The message names the file and the fault."""

    def __init__(self, source: str, fault: str) -> None:
        self.source = source
        self.fault = fault
        super().__init__(f"{source}: {fault}")


def read_private(path: Path, max_bytes: int) -> bytes:
    """Return the content of a file.

    Raises:
        FileNotFoundError: The file does not exist.
        PrivateFileError: Other users may access it, it has more than `max_bytes`, it is not a
            regular file, or it cannot be read.
    """
    source = str(path)
    try:
        with open_regular(path) as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            # Group members may read the file (0640), so that an administrator can give a group
            # access.
            if sys.platform != "win32" and mode & 0o027:
                fault = f"other users may access it (mode {mode:04o}); run `chmod 600 {path}`"
                raise PrivateFileError(source, fault)
            content = file.read(max_bytes + 1)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise PrivateFileError(source, f"cannot be read: {error.strerror}") from None
    if len(content) > max_bytes:
        raise PrivateFileError(source, f"larger than {max_bytes} bytes; it may be the wrong file")
    return content
