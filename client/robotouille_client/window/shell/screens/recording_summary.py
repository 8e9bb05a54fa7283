"""What a recording was, from its first frames and its last: without going through all of it."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from itertools import islice, pairwise
from pathlib import Path
from stat import S_ISREG
from typing import Any

from robotouille.domain.task import Task
from robotouille.errors import RecordingError
from robotouille.replay.container import MAGIC, frame_ends, frame_value, is_closed, plain
from robotouille_client.window.sources.texts import REASONS

__all__ = ["RecordingSummary", "summary_of", "when_words"]

MAX_BYTES = 16 * 1024 * 1024
"""Of a file, and of what is in it: what is larger is told without being read."""
NEVER = datetime.fromtimestamp(0, UTC)
"""Of what has no time, or one that no calendar has."""
MAX_FIRST = 12
"""Frames at the beginning among which are those that say who plays."""


@dataclass(frozen=True, slots=True)
class RecordingSummary:
    """One recording in a list; `fault` says why nothing, or not all, can be known of it.

    `reason` is how it ended, empty where it did not.
    """

    when: datetime
    task: dict[str, Any] | None = None
    digest: str = ""
    reason: str = ""
    steps: int = 0
    people: tuple[str, ...] = ()
    fault: str = ""

    @property
    def name(self) -> str:
        """The name of its task."""
        return str((self.task or {}).get("name", ""))

    @property
    def result(self) -> str:
        """`won in 31 steps`, `out of steps after 500 steps`, `damaged`."""
        if self.fault:
            return self.fault
        if not self.reason:
            return f"not played to its end: {self.steps} steps"
        if self.reason == "goal":
            return f"won in {self.steps} steps"
        words = REASONS.get(self.reason, self.reason)
        return f"{words[:1].lower()}{words[1:]} after {self.steps} steps"

    def load(self) -> Task:
        """Its task; FileError where what is recorded of it is none."""
        return Task.from_json(self.task or {}, "recording")


def summary_of(path: Path) -> RecordingSummary:
    """What a file says of itself; nothing that is wrong with it is an error."""
    try:
        found = path.stat()
        if not S_ISREG(found.st_mode):
            return RecordingSummary(NEVER, fault="no file")
        return _summary(path, found.st_mtime, found.st_size)
    except OSError as error:
        return RecordingSummary(NEVER, fault=f"{error.strerror}")


def when_words(when: datetime, now: datetime) -> str:
    """`today 14:05`, `yesterday 9:30`, `16 Nov 14:05`, `16 Nov 2025`, as `now`'s clocks go."""
    with contextlib.suppress(OverflowError):
        when = when.astimezone(now.tzinfo)
    days = (now.date() - when.date()).days
    day = f"{when.day} {when:%b}"
    if when.year != now.year and days > 1:
        return f"{day} {when.year}"
    return f"{ {0: 'today', 1: 'yesterday'}.get(days, day) } {when.hour}:{when:%M}"


@lru_cache(maxsize=256)
def _summary(path: Path, modified: float, size: int) -> RecordingSummary:
    try:
        when = datetime.fromtimestamp(modified, UTC)
    except (OverflowError, ValueError):
        when = NEVER
    if size > MAX_BYTES:
        return RecordingSummary(when, fault="too long to look into here")
    try:
        content = path.read_bytes()
        stream, fault = plain(content, MAX_BYTES)
        return _told(stream, when, "damaged" if fault else "", closed=is_closed(content))
    except OSError as error:
        return RecordingSummary(when, fault=f"cannot be read: {error.strerror}")
    except RecordingError as error:
        return RecordingSummary(when, fault=_short(error))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        return RecordingSummary(when, fault="damaged")


def _told(stream: bytes, when: datetime, fault: str, *, closed: bool) -> RecordingSummary:
    ends = [len(MAGIC), *frame_ends(stream)]
    if len(ends) < 2:
        return RecordingSummary(when, fault=fault or "damaged")
    header = frame_value(stream, ends[0], ends[1])
    if header.get("kind") != "header" or not isinstance(header["task"], dict):
        return RecordingSummary(when, fault="not a recording")
    people: dict[str, str] = {}
    for start, end in islice(pairwise(ends), 1, MAX_FIRST):
        frame = frame_value(stream, start, end)
        for note in frame.get("notes", ()):
            if note.get("note") == "roster" and note.get("name"):
                people[str(note["player"])] = str(note["name"])
    last = frame_value(stream, ends[-2], ends[-1])
    outcome = last.get("outcome") if last.get("kind") == "footer" else None
    torn = ends[-1] < len(stream) or (closed and outcome is None)
    return RecordingSummary(
        _began(str(header.get("created", ""))) or when,
        header["task"],
        str(header.get("digest", "")),
        str(outcome["reason"]) if outcome else "",
        int(outcome["steps"] if outcome else last.get("step", 0)),
        tuple(people[player] for player in sorted(people)),
        fault or ("damaged" if torn else ""),
    )


def _began(created: str) -> datetime | None:
    try:
        return datetime.strptime(created, "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC)
    except ValueError:
        return None


def _short(error: RecordingError) -> str:
    words = str(error)
    if words.startswith("format version"):
        return words
    return "not a recording" if words.startswith("not a recording") else "damaged"
