"""Recordings for the operator page: list with outcomes, downloads, and events of open episodes.

Reading can take long (slow disk, large file), so the service calls it in a thread.
"""

from __future__ import annotations

import asyncio
import errno
import os
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from http import HTTPStatus
from typing import Any, BinaryIO, Protocol

from robotouille.errors import RecordingError
from robotouille.replay.compression import is_closed
from robotouille.replay.container import MAGIC, frame_value
from robotouille.replay.file_names import is_recording_name
from robotouille.replay.frame_schema import check_frame
from robotouille_server.operator.models import LogLine, RecordingPage, RecordingRow
from robotouille_server.operator.principal import RequestRefusedError
from robotouille_server.operator.recordings.heads import RecordingHead, read_head, whole_frames
from robotouille_server.operator.rows import shown_code

MAX_LINES = 80
FIRST_READ = 400
"""Frames at the end of a long recording that are decoded at first."""
DOWNLOAD_PIECE = 256 * 1024
"""Bytes of a download that are in memory."""
NOTES = {
    "started": "everyone is ready, the game begins",
    "resumed": "the game continues",
    "restarted": "the server was restarted, the game continues",
}

Sentence = Callable[[list[str]], str]
TranscriptEvent = tuple[Any, str, str, list[str]]
"""Kind, participant, text and reasons of a line."""


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

    def new_frames(self, file: BinaryIO) -> NewFrames:
        """Read the new frames of a recording.

        This changes nothing, so a thread can do it.
        """
        end, recent = self._position, deque[bytes](maxlen=FIRST_READ)
        for end, frame in whole_frames(file, self._position):  # noqa: B007
            recent.append(frame)
        return NewFrames([frame_value(frame, 0) for frame in recent], end)

    def add(self, new: NewFrames) -> None:
        """Add lines for new frames. Call this on the event loop, which owns the world."""
        self._position = new.end
        steps = []
        for frame in new.frames:
            if frame["kind"] == "step":
                self._step = frame["step"]
            steps.append(self._step)
        # The loop starts at the end, because only the last lines are kept, and each costs time.
        recent: deque[LogLine] = deque()
        for step, frame in zip(reversed(steps), reversed(new.frames), strict=True):
            if len(recent) >= MAX_LINES:
                break
            recent.extendleft(reversed(list(self._lines(step, frame))))
        self.lines.extend(recent)

    def _lines(self, step: int, frame: dict[str, Any]) -> Iterator[LogLine]:
        for kind, who, text, reasons in self._events(frame):
            yield LogLine(step=step, kind=kind, who=who, text=text, reasons=reasons)

    def _events(self, frame: dict[str, Any]) -> Iterator[TranscriptEvent]:
        if frame["kind"] == "step":
            yield from self._acts(frame)
        elif frame["kind"] == "notes":
            for note in frame["notes"]:
                if note["note"] != "round_trip":  # The row of the seat shows it.
                    yield self._note(note)
        elif frame["kind"] == "footer":
            outcome = frame["outcome"]
            detail = f": {outcome['detail']}" if outcome.get("detail") else ""
            yield self._line("note", "", f"ended, {outcome['reason']}{detail}")

    def _acts(self, frame: dict[str, Any]) -> Iterator[TranscriptEvent]:
        unmet = frame.get("unmet", {})
        for number, move in enumerate(frame["moves"]):
            reasons = unmet.get(str(number), [])
            kind = "reject" if reasons else "act"
            yield self._line(kind, move["player"], self._sentence(move["action"]), reasons)

    def _note(self, note: dict[str, Any]) -> TranscriptEvent:
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

    def _line(
        self, kind: Any, who: str, text: str, reasons: list[str] | None = None
    ) -> TranscriptEvent:
        return kind, who, text, reasons or []


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
MAX_SEARCHED = 2000
"""Newest recordings whose content is searched. Of older ones, a search reads only the names."""


class ReadableStorage(Protocol):
    """Storage that recordings can be read from. Both methods may raise OSError."""

    def names(self) -> list[str]: ...

    def open(self, name: str) -> BinaryIO: ...


class NoRecordings:
    """Storage of a server that records nothing."""

    def names(self) -> list[str]:
        return []

    def open(self, name: str) -> BinaryIO:
        raise FileNotFoundError(errno.ENOENT, "nothing is recorded", name)


@dataclass(frozen=True, slots=True)
class RecordingSummary:
    """Facts from the end of a recording.

    Attributes:
        end: The end of the last frame that was read.
        read_size: The size of the file when all its frames were read.
    """

    size: int
    end: int = len(MAGIC)
    read_size: int = 0
    outcome: str = "unfinished"
    steps: int | None = None


@dataclass(frozen=True, slots=True)
class KnownHead:
    """Head of a recording, None if it is unreadable, and the size of the file when it was read."""

    size: int
    head: RecordingHead | None


class RecordingStore:
    """Recordings of one storage. Of a file that was read before, only new frames are read."""

    def __init__(self, storage: ReadableStorage) -> None:
        self._storage = storage
        self._known: dict[str, RecordingSummary] = {}
        self._heads: dict[str, KnownHead] = {}

    def page(
        self, search: str, limit: int, offset: int, live: Mapping[str, str], only: str = ""
    ) -> RecordingPage:
        """Return a part of the list, newest first. `live` maps open recordings to episodes."""
        found = self.found(search, only)
        shown = found[offset : offset + limit]
        return RecordingPage(
            found=len(found), recordings=[self._row(name, live.get(name)) for name in shown]
        )

    def found(self, search: str, only: str = "") -> list[str]:
        """Return the names of the recordings that contain all words of a search, newest first.

        Args:
            search: Words that occur in the names, codes, tasks, labels or players.
            only: The end of the names, without `.part`, of the recordings that may be found.
        """
        words = search.lower().split()
        allowed = [name for name in self._names() if name.removesuffix(".part").endswith(only)]
        newest = sorted(allowed, reverse=True)
        return [
            name
            for place, name in enumerate(newest)
            if self._matches(name, words, with_head=place < MAX_SEARCHED)
        ]

    def _matches(self, name: str, words: list[str], *, with_head: bool) -> bool:
        rest = [word for word in words if word not in name.lower()]
        if not rest or not with_head:
            return not rest
        head = self._head(name)
        return head is not None and all(word in head.text for word in rest)

    def opened(self, name: str, live_size: int | None) -> tuple[BinaryIO, int]:
        """Open a recording for a download, and return the bytes up to its last whole frame.

        Args:
            name: The name of the file.
            live_size: The size of the recording if an episode of this server still writes it.
        """
        if name not in self._names():
            raise unknown_recording(name)
        try:
            file = self._storage.open(name)
            end = _intact(file) if live_size is None else live_size
            file.seek(0)
        except OSError as error:
            raise _unreadable(name, error) from None
        return file, end

    def _names(self) -> list[str]:
        try:
            return [name for name in self._storage.names() if is_recording_name(name)]
        except OSError as error:
            raise _unreadable("the recordings folder", error) from None

    def _row(self, name: str, episode: str | None) -> RecordingRow:
        head = self._head(name)
        summary = self._summary(name, live=episode is not None, readable=head is not None)
        head = head or RecordingHead("", "")
        return RecordingRow(
            name=name,
            size=summary.size,
            created=head.created,
            task=head.task,
            code=shown_code(head.code),
            labels=dict(head.labels),
            players=list(head.players),
            outcome="live" if episode is not None else summary.outcome,
            steps=summary.steps,
            episode=episode,
        )

    def _head(self, name: str) -> RecordingHead | None:
        """Return the head of a recording, or None if it is unreadable."""
        known = self._heads.get(name)
        # The head is final once the game began, and a closed recording never changes.
        if known is not None and (_is_closed_name(name) or (known.head and known.head.begun)):
            return known.head
        try:
            with self._storage.open(name) as file:
                size = file.seek(0, os.SEEK_END)
                if known is None or known.size != size:
                    known = KnownHead(size, read_head(file))
        except OSError:
            return None
        if len(self._heads) >= MAX_SUMMARIES:
            # Several threads use the store, so none may remove single entries.
            self._heads = {}
        self._heads[name] = known
        return known.head

    def _summary(self, name: str, *, live: bool, readable: bool) -> RecordingSummary:
        known = self._known.get(name)
        if known is not None and _is_closed_name(name):
            return known
        try:
            with self._storage.open(name) as file:
                size = file.seek(0, os.SEEK_END)
                if not readable:
                    return RecordingSummary(size, outcome="unreadable")
                if live or (known is not None and known.read_size == size):
                    # The last frame of a live recording tells nothing.
                    return replace(known or RecordingSummary(size), size=size)
                if known is None or known.size > size:
                    known = RecordingSummary(size)
                summary = _summarised(file, replace(known, size=size))
        except OSError:
            return RecordingSummary(0, outcome="unreadable")
        if len(self._known) >= MAX_SUMMARIES:
            self._known = {}
        self._known[name] = summary
        return summary


def _is_closed_name(name: str) -> bool:
    return not name.endswith(".part")


async def pieces(file: BinaryIO, size: int) -> AsyncIterator[bytes]:
    """Yield the first `size` bytes of a file, and close it."""
    with file:
        while size > 0 and (piece := await asyncio.to_thread(file.read, min(size, DOWNLOAD_PIECE))):
            size -= len(piece)
            yield piece


def unknown_recording(name: str) -> RequestRefusedError:
    """Return the refusal of a request for a recording that is not in the list."""
    message = f"no recording {name!r}; it may have been closed (without .part) or moved"
    return RequestRefusedError(HTTPStatus.NOT_FOUND, "recording/unknown", message)


def _unreadable(what: str, error: OSError) -> RequestRefusedError:
    message = f"{what} cannot be read: {error.strerror or error}"
    return RequestRefusedError(HTTPStatus.SERVICE_UNAVAILABLE, "recording/unreadable", message)


def _intact(file: BinaryIO) -> int:
    """Return the bytes of a file up to its last whole frame, or all if it is closed or damaged."""
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    if is_closed(file.read(4)):
        return size
    try:
        return max((end for end, _ in whole_frames(file)), default=len(MAGIC))
    except RecordingError:
        return size  # A damaged file may still help whoever repairs it.


def _summarised(file: BinaryIO, known: RecordingSummary) -> RecordingSummary:
    """Return the summary of a recording, from the last of its new frames."""
    if known.size > MAX_SUMMARISED:
        return replace(known, outcome="unread", read_size=known.size)
    end, last = known.end, None
    try:
        for end, last in whole_frames(file, known.end):  # noqa: B007
            pass
        known = replace(known, end=end, read_size=known.size)
        return known if last is None else _with_outcome(known, frame_value(last, 0))
    except (RecordingError, KeyError, TypeError):
        return RecordingSummary(known.size, read_size=known.size, outcome="unreadable")


def _with_outcome(known: RecordingSummary, last: dict[str, Any]) -> RecordingSummary:
    if last.get("kind") != "footer":
        return replace(known, outcome="unfinished")
    check_frame(last, 0)
    return replace(known, outcome=last["outcome"]["reason"], steps=last["outcome"]["steps"])
