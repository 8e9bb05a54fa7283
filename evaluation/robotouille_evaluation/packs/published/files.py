"""Files of a checkout: never one outside it, whatever a path or a link in it says."""

from __future__ import annotations

from pathlib import Path

from robotouille.domain.files import MAX_FILE_BYTES
from robotouille.errors import Fault, FileError

__all__ = ["read_text", "require_inside"]


def read_text(path: Path, root: Path) -> str:
    """The text of a file below `root`.

    Raises:
        FileError: It leads outside, is too large, cannot be read, or is not UTF-8.
    """
    require_inside(path, root)
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise FileError(str(path), [Fault("", f"is larger than {MAX_FILE_BYTES:,} bytes")])
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        fault = Fault("", f"cannot be read: {error.strerror or error}")
        raise FileError(str(path), [fault]) from None
    except UnicodeDecodeError as error:
        raise FileError(str(path), [Fault("", f"is not UTF-8 text: {error.reason}")]) from None


def require_inside(path: Path, root: Path) -> None:
    """Raises FileError where a path leads outside `root`, links followed."""
    try:
        inside = path.resolve().is_relative_to(root.resolve())
    except (OSError, RuntimeError, ValueError):  # Links in a circle; a NUL in the name.
        inside = False
    if not inside:
        raise FileError(str(path), [Fault("", f"leads outside {root}")])
