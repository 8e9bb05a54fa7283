"""SQLite catalogues that this user has made on this computer.

A catalogue answers without its recordings, so one in a folder from other people could say anything.
A catalogue made here has a random number in its header, and the user's state folder has a file for
that number and the catalogue's path.
"""

from __future__ import annotations

import hashlib
import os
import secrets
import sqlite3
from contextlib import closing, suppress
from pathlib import Path

from robotouille.files.drafts import drafted
from robotouille.files.private import user_state
from robotouille.files.reading import open_regular

MARKS = slice(60, 64), slice(68, 72)
"""Places of `user_version` and `application_id` in the header of an SQLite file."""
MAX_REMEMBERED = 1000


def is_own(path: Path) -> bool:
    """Return whether this user has made the catalogue. The database is not opened."""
    try:
        with open_regular(path) as file:
            head = file.read(100)
    except OSError:
        return False
    mark = b"".join(head[place] for place in MARKS)
    return _entry(path, mark).is_file()


def create(path: Path) -> None:
    """Create an empty catalogue and remember it, unless there is a file.

    Raises:
        OSError: The catalogue or its entry in the state folder cannot be written.
    """
    if path.exists():
        return
    marks = [secrets.randbits(31) for _ in MARKS]
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.execute(f"PRAGMA user_version={marks[0]}")
        connection.execute(f"PRAGMA application_id={marks[1]}")
        content = connection.serialize()
    entry = _entry(path, b"".join(mark.to_bytes(4, "big") for mark in marks))
    entry.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    _forget_oldest(entry.parent)
    entry.write_text(f"{path}\n", encoding="utf-8", errors="surrogateescape")
    # Another process may create it at the same time, and must not lose what it has written.
    with suppress(FileExistsError), drafted(path, replace=False) as draft:
        draft.write_bytes(content)


def _entry(path: Path, mark: bytes) -> Path:
    place = os.fsencode(os.path.realpath(path))
    return user_state("catalogues") / hashlib.sha256(place + b"\0" + mark).hexdigest()[:32]


def _forget_oldest(folder: Path) -> None:
    kept = sorted(folder.iterdir(), key=lambda entry: entry.stat().st_mtime_ns)
    for entry in kept[: max(0, len(kept) - MAX_REMEMBERED + 1)]:
        entry.unlink(missing_ok=True)
