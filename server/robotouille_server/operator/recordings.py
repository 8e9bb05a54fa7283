"""Recordings for the operator page: list with outcomes, downloads, and events of open episodes.

Reading can take long (slow disk, large file), so the service calls it in a thread.
"""

from __future__ import annotations

import errno
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Protocol

from robotouille.errors import RecordingError
from robotouille.replay.container import MAGIC, frame_ends, frame_value, intact, is_closed, unwrap
from robotouille.replay.file_names import is_recording_name
from robotouille_server.operator.models import LogLine, RecordingPage, RecordingRow
from robotouille_server.operator.principal import RequestRefusedError

MAX_LINES = 80
FIRST_READ = 400
"""Frames at the end of a long recording that are decoded at first."""
NOTES = {
    "started": "everyone is ready, the game begins",
    "resumed": "the game continues",
    "restarted": "the server was restarted, the game continues",
}

Sentence = Callable[[list[str]], str]


@dataclass(frozen=True, slots=True)
class NewFrames:
    """Frames that were added to a recording, and the position after them."""

    frames: list[dict[str, Any]]
    end: int


class Transcript:
    """Recent events of a growing recording, as text. `sentence` describes an action."""

    def __init__(self, sentence: Sentence) -> None:
        self.lines: deque[LogLine] = deque(maxlen=MAX_LINES)
        self._sentence = sentence
        self._position = len(MAGIC)
        self._step = 0

    def new_frames(self, stream: bytes) -> NewFrames:
        """Return the new frames of a recording; `stream` is all of it so far.

        This changes nothing, so a thread can do it: decoding many frames takes a while.
        """
        starts = [self._position, *frame_ends(stream, self._position)]
        end = starts.pop()
        return NewFrames([frame_value(stream, start) for start in starts[-FIRST_READ:]], end)

    def add(self, new: NewFrames) -> None:
        """Add lines for new frames. Call this on the event loop, which owns the world."""
        self._position = new.end
        for frame in new.frames:
            self.lines.extend(self._lines(frame))

    def _lines(self, frame: dict[str, Any]) -> Iterator[LogLine]:
        if frame["kind"] == "step":
            self._step = frame["step"]
            yield from self._acts(frame)
        elif frame["kind"] == "notes":
            for note in frame["notes"]:
                if note["note"] != "round_trip":  # The row of the seat shows it.
                    yield self._note(note)
        elif frame["kind"] == "footer":
            outcome = frame["outcome"]
            detail = f": {outcome['detail']}" if outcome.get("detail") else ""
            yield self._line("note", "", f"ended, {outcome['reason']}{detail}")

    def _acts(self, frame: dict[str, Any]) -> Iterator[LogLine]:
        unmet = frame.get("unmet", {})
        for number, move in enumerate(frame["moves"]):
            reasons = unmet.get(str(number), [])
            kind = "reject" if reasons else "act"
            yield self._line(kind, move["player"], self._sentence(move["action"]), reasons)

    def _note(self, note: dict[str, Any]) -> LogLine:
        match note["note"]:
            case "rejected":
                return self._line("reject", note["player"], note["action"], note["reasons"])
            case "said":
                return self._line("say", note["name"], note["text"])
            case "roster":
                return self._line("seat", note["player"], _seat(note))
            case "ready":
                words = "is ready" if note["ready"] else "is not ready"
                return self._line("seat", note["player"], words)
            case "noted":
                return self._line("note", note["player"], f"made a note ({note['topic']})")
            case "announced":
                return self._line("say", "operator", note["text"])
            case "moderated":
                return self._line("note", note["name"], f"was {note['what']}")
            case "countdown":
                begins = f"begins in {note['ms'] / 1000:g} s" if "ms" in note else "waits again"
                return self._line("note", "", f"the game {begins}")
            case "paused":
                return self._line("note", "", f"the game is paused ({', '.join(note['holds'])})")
            case other:
                return self._line("note", "", NOTES.get(other, other))

    def _line(self, kind: Any, who: str, text: str, reasons: list[str] | None = None) -> LogLine:
        return LogLine(step=self._step, kind=kind, who=who, text=text, reasons=reasons or [])


WHY_FREE = {
    "left": "left, the seat is free",
    "lost": "was away too long, the seat is free",
    "removed": "was removed, the seat is free",
}


def _seat(note: dict[str, Any]) -> str:
    """Describe what a roster note reports about a seat."""
    name = note["name"]
    if not note.get("taken", True):
        return WHY_FREE.get(note.get("why", ""), "the seat is free")
    if note["present"]:
        return f"{name} is here ({note['kind']})"
    if note.get("controller") == "substitute":
        return f"{name} is away, a substitute plays"
    return f"{name} is away"


MAX_SUMMARISED = 32 * 1024 * 1024
"""Larger recordings are listed without their outcome: decompressing them takes too long."""
MAX_SUMMARIES = 5000


class ReadableStorage(Protocol):
    """Storage that recordings can be read from. Both methods may raise OSError."""

    def names(self) -> list[str]: ...

    def read(self, name: str) -> bytes: ...


class NoRecordings:
    """Storage of a server that records nothing."""

    def names(self) -> list[str]:
        return []

    def read(self, name: str) -> bytes:
        raise FileNotFoundError(errno.ENOENT, "nothing is recorded", name)


@dataclass(frozen=True, slots=True)
class RecordingSummary:
    """Facts from the header and footer of a recording."""

    size: int
    created: str = ""
    task: str = ""
    outcome: str = "unreadable"
    steps: int | None = None


class RecordingStore:
    """Recordings of one storage. Closed recordings are read once, because they never change."""

    def __init__(self, storage: ReadableStorage) -> None:
        self._storage = storage
        self._known: dict[str, RecordingSummary] = {}

    def page(self, search: str, limit: int, offset: int, live: Mapping[str, str]) -> RecordingPage:
        """Return a part of the list, newest first. `live` maps open recordings to episodes."""
        words = search.lower().split()
        found = [name for name in self._names() if all(word in name.lower() for word in words)]
        found.sort(reverse=True)
        shown = found[offset : offset + limit]
        return RecordingPage(
            found=len(found), recordings=[self._row(name, live.get(name)) for name in shown]
        )

    def content(self, name: str) -> bytes:
        """Return the content of a recording, up to its last complete frame if it is still open."""
        if name not in self._names():
            message = f"no recording {name!r}; it may have been closed (without .part) or moved"
            raise RequestRefusedError(HTTPStatus.NOT_FOUND, "recording/unknown", message)
        content = self._read(name)
        if is_closed(content):
            return content
        try:
            return content[: intact(content)]
        except RecordingError:
            return content  # A damaged file may still help whoever repairs it.

    def _names(self) -> list[str]:
        try:
            return [name for name in self._storage.names() if is_recording_name(name)]
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

    def _summary(self, name: str) -> RecordingSummary:
        try:
            content = self._storage.read(name)
        except OSError:
            return RecordingSummary(0)
        summary = _summarised(content)
        if not name.endswith(".part"):
            if len(self._known) >= MAX_SUMMARIES:
                self._known.pop(next(iter(self._known)))
            self._known[name] = summary
        return summary


def _unreadable(what: str, error: OSError) -> RequestRefusedError:
    message = f"{what} cannot be read: {error.strerror or error}"
    return RequestRefusedError(HTTPStatus.SERVICE_UNAVAILABLE, "recording/unreadable", message)


def _summarised(content: bytes) -> RecordingSummary:
    """Return the summary of a recording, from its first and last frames alone."""
    size = len(content)
    if size > MAX_SUMMARISED:
        return RecordingSummary(size, outcome="unread")
    try:
        stream = unwrap(content)
        ends = list(frame_ends(stream))
        if not ends:
            return RecordingSummary(size)
        head = frame_value(stream, len(MAGIC))
        last = frame_value(stream, ends[-2] if len(ends) > 1 else len(MAGIC))
        return _from_frames(size, head, last)
    except (RecordingError, KeyError, TypeError):
        return RecordingSummary(size)


def _from_frames(size: int, head: dict[str, Any], last: dict[str, Any]) -> RecordingSummary:
    outcome = last["outcome"] if last.get("kind") == "footer" else {}
    return RecordingSummary(
        size=size,
        created=str(head["created"]),
        task=str(head["task"]["name"]),
        outcome=str(outcome.get("reason", "unfinished")),
        steps=outcome.get("steps"),
    )
