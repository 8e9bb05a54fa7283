"""The recordings folder as the operator sees it: a list with outcomes, and downloads.

Everything here may take long (a slow disk, a large file) and is called in a thread.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Protocol

from robotouille.errors import RecordingError
from robotouille.replay.container import MAGIC, frame_ends, frame_value, intact, is_closed, unwrap
from robotouille_server.admin.errors import RequestRefusedError
from robotouille_server.admin.models import RecordingPage, RecordingRow

__all__ = ["NoRecordings", "Readable", "RecordingStore"]

NAME = re.compile(r"[A-Za-z0-9_.-]+\.rbt(\.part)?")
MAX_SUMMARISED = 32 * 1024 * 1024
KEPT = 5000


class Readable(Protocol):
    """What is needed of the storage; both may raise OSError."""

    def names(self) -> list[str]: ...

    def read(self, name: str) -> bytes: ...


class NoRecordings:
    """The storage of a server that records nothing."""

    def names(self) -> list[str]:
        return []

    def read(self, name: str) -> bytes:
        raise FileNotFoundError(errno.ENOENT, "nothing is recorded", name)


@dataclass(frozen=True, slots=True)
class Summary:
    """What a recording says about itself."""

    size: int
    created: str = ""
    task: str = ""
    outcome: str = "unreadable"
    steps: int | None = None


class RecordingStore:
    """The recordings of one storage. What closed ones say is read once."""

    def __init__(self, storage: Readable) -> None:
        self._storage = storage
        self._known: dict[str, Summary] = {}

    def page(self, search: str, limit: int, offset: int, live: Mapping[str, str]) -> RecordingPage:
        """A part of the list, newest first; `live` are the episodes that write some, by name."""
        words = search.lower().split()
        found = [name for name in self._names() if all(word in name.lower() for word in words)]
        found.sort(reverse=True)
        shown = found[offset : offset + limit]
        return RecordingPage(
            found=len(found), recordings=[self._row(name, live.get(name)) for name in shown]
        )

    def content(self, name: str) -> bytes:
        """A recording to download; one that is still written ends with its last whole frame."""
        if name not in self._names():
            message = f"there is no recording {name!r}; it may have been finished or moved"
            raise RequestRefusedError(HTTPStatus.NOT_FOUND, "recording/unknown", message)
        content = self._read(name)
        if is_closed(content):
            return content
        try:
            return content[: intact(content)]
        except RecordingError:
            return content  # Whatever it is: as it is.

    def _names(self) -> list[str]:
        try:
            return [name for name in self._storage.names() if NAME.fullmatch(name)]
        except OSError as error:
            raise _unreadable("the recordings folder", error) from None

    def _read(self, name: str) -> bytes:
        try:
            return self._storage.read(name)
        except OSError as error:
            raise _unreadable(name, error) from None

    def _row(self, name: str, episode: str | None) -> RecordingRow:
        summary = self._known.get(name) or self._summary(name)
        outcome = "live" if episode is not None else summary.outcome
        return RecordingRow(
            name=name,
            size=summary.size,
            created=summary.created,
            task=summary.task,
            outcome=outcome,
            steps=summary.steps,
            episode=episode,
        )

    def _summary(self, name: str) -> Summary:
        try:
            content = self._storage.read(name)
        except OSError:
            return Summary(0)
        summary = _summarised(content)
        if not name.endswith(".part"):
            if len(self._known) >= KEPT:
                self._known.pop(next(iter(self._known)))
            self._known[name] = summary
        return summary


def _unreadable(what: str, error: OSError) -> RequestRefusedError:
    message = f"{what} cannot be read: {error.strerror or error}"
    return RequestRefusedError(HTTPStatus.SERVICE_UNAVAILABLE, "recording/unreadable", message)


def _summarised(content: bytes) -> Summary:
    """From the first and the last frame alone."""
    size = len(content)
    if size > MAX_SUMMARISED:
        return Summary(size, outcome="unread")
    try:
        stream = unwrap(content)
        ends = list(frame_ends(stream))
        if not ends:
            return Summary(size)
        head = frame_value(stream, len(MAGIC))
        last = frame_value(stream, ends[-2] if len(ends) > 1 else len(MAGIC))
        return _from_frames(size, head, last)
    except (RecordingError, KeyError, TypeError):
        return Summary(size)


def _from_frames(size: int, head: dict[str, Any], last: dict[str, Any]) -> Summary:
    outcome = last["outcome"] if last.get("kind") == "footer" else {}
    return Summary(
        size=size,
        created=str(head["created"]),
        task=str(head["task"]["name"]),
        outcome=str(outcome.get("reason", "unfinished")),
        steps=outcome.get("steps"),
    )
