"""Names of recordings' files: `CREATED_TASK_EPISODE.rbt`, or `.rbt.part` while one is written."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta

OPEN = ".rbt.part"
"""Suffix of a recording that is being written."""
CLOSED = ".rbt"

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_BASIC_TIME = re.compile(r"(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)Z")
# The pattern has no path separators, because the operator page takes these names from requests.
_SAFE_NAME = re.compile(r"[A-Za-z0-9_.-]+\.rbt(\.part)?")


def is_recording_name(name: str) -> bool:
    """Return whether a file name is that of a recording and safe to use in a URL and a path."""
    return _SAFE_NAME.fullmatch(name) is not None


def recording_stem(name: str) -> str:
    """Return the name of a recording without its suffix."""
    return name.removesuffix(".part").removesuffix(CLOSED)


def file_name(created: str, task: str, episode: str) -> str:
    """Return the name of a new recording, in characters that every file system permits."""
    words = f"{created}_{task}_{episode}"
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", words) + OPEN


def iso_time_of(milliseconds: int) -> str:
    """Return a time in milliseconds since 1970 (UTC) in ISO 8601's extended form.

    Raises:
        OverflowError: The year is not between 1 and 9999.
    """
    moment = _EPOCH + timedelta(milliseconds=milliseconds)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def iso_time(created: str) -> str:
    """Return a recording's `created` in ISO 8601's extended form, which can be compared with dates.

    Texts in any other form are returned unchanged.
    """
    if not _BASIC_TIME.fullmatch(created):
        return created
    return _BASIC_TIME.sub(r"\1-\2-\3T\4:\5:\6Z", created)
