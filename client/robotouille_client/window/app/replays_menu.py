"""List of recordings, and the form shown while a video is saved."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from itertools import islice, pairwise
from pathlib import Path
from stat import S_ISREG
from typing import Any

import pygame
from pygame import Surface

from robotouille.domain.task import Task
from robotouille.errors import RecordingError
from robotouille.replay.compression import is_closed, plain
from robotouille.replay.container import MAGIC, frame_ends, frame_value
from robotouille.replay.file_names import CLOSED, OPEN
from robotouille.world.presentation.places import capitalised
from robotouille_client.window.app.thumbnails import Thumbnails
from robotouille_client.window.forms.form import Form
from robotouille_client.window.forms.picker import EntryText, Picker, PickerEntry
from robotouille_client.window.forms.widgets import Button, DrawContext, Row, Words
from robotouille_client.window.pictures.shapes import box
from robotouille_client.window.pictures.theme import ACCENT, TEXT, TRACK
from robotouille_client.window.sources.texts import REASONS, task_title

MAX_BYTES = 16 * 1024 * 1024
"""Size of a file and of its content above which it is not read."""
NEVER = datetime.fromtimestamp(0, UTC)
"""Time of files without a valid one."""
MAX_FIRST = 12
"""Number of frames at the beginning that are searched for the players' names."""


@dataclass(frozen=True, slots=True)
class RecordingEntry:
    """One recording in the list.

    Attributes:
        reason: How the episode ended; empty if it did not.
        fault: Why the recording cannot be read, or not completely.
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
        return str((self.task or {}).get("name", ""))

    @property
    def result(self) -> str:
        """Result in words, such as `won in 31 steps` or `damaged`."""
        if self.fault:
            return self.fault
        if not self.reason:
            return f"unfinished after {self.steps} steps"
        if self.reason == "goal":
            return f"won in {self.steps} steps"
        words = REASONS.get(self.reason, self.reason)
        return f"{words[:1].lower()}{words[1:]} after {self.steps} steps"

    def load(self) -> Task:
        """Load the task; raise FileError if the recorded one is invalid."""
        return Task.from_json(self.task or {}, "recording")


def summary_of(path: Path) -> RecordingEntry:
    """Return the summary of a file. Problems with the file go into `fault`."""
    try:
        found = path.stat()
        if not S_ISREG(found.st_mode):
            return RecordingEntry(NEVER, fault="not a file")
        return _summary(path, found.st_mtime, found.st_size)
    except OSError as error:
        return RecordingEntry(NEVER, fault=f"{error.strerror}")


def when_words(when: datetime, now: datetime) -> str:
    """Return a time in words relative to `now`, such as `today 14:05` or `16 Nov 2025`."""
    # Times at the ends of the calendar cannot be moved to another time zone.
    with contextlib.suppress(OverflowError):
        when = when.astimezone(now.tzinfo)
    days = (now.date() - when.date()).days
    day = f"{when.day} {when:%b}"
    if when.year != now.year and days > 1:
        return f"{day} {when.year}"
    return f"{ {0: 'today', 1: 'yesterday'}.get(days, day) } {when.hour}:{when:%M}"


# Time and size are part of the key, so that a file is read again after a change.
@lru_cache(maxsize=256)
def _summary(path: Path, modified: float, size: int) -> RecordingEntry:
    try:
        when = datetime.fromtimestamp(modified, UTC)
    except (OverflowError, ValueError):
        when = NEVER
    # Reading one large file would stop the window for a moment.
    if size > MAX_BYTES:
        return RecordingEntry(when, fault="too large to preview")
    try:
        content = path.read_bytes()
        stream, fault = plain(content, MAX_BYTES)
        return _parsed(stream, when, "damaged" if fault else "", closed=is_closed(content))
    except OSError as error:
        return RecordingEntry(when, fault=f"cannot be read: {error.strerror}")
    except RecordingError as error:
        return RecordingEntry(when, fault=_short(error))
    # The content can be anything, so every error while reading it counts as damage.
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        return RecordingEntry(when, fault="damaged")


def _parsed(stream: bytes, when: datetime, fault: str, *, closed: bool) -> RecordingEntry:
    ends = [len(MAGIC), *frame_ends(stream)]
    if len(ends) < 2:
        return RecordingEntry(when, fault=fault or "damaged")
    header = frame_value(stream, ends[0], ends[1])
    if header.get("kind") != "header" or not isinstance(header["task"], dict):
        return RecordingEntry(when, fault="not a recording")
    people: dict[str, str] = {}
    # Participants join at the start. Reading on would make a long list of recordings slow.
    for start, end in islice(pairwise(ends), 1, MAX_FIRST):
        frame = frame_value(stream, start, end)
        for note in frame.get("notes", ()):
            if note.get("note") == "roster" and note.get("name"):
                people[str(note["player"])] = str(note["name"])
    last = frame_value(stream, ends[-2], ends[-1])
    outcome = last.get("outcome") if last.get("kind") == "footer" else None
    torn = ends[-1] < len(stream) or (closed and outcome is None)
    return RecordingEntry(
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


class SavingForm(Form):
    """Form with a progress bar for `percent`."""

    def __init__(self, words: str) -> None:
        self.percent = 0
        self._shown = -1
        rows = [Words(words), _Bar(self), Button("Cancel", "back")]
        super().__init__("Saving the video …", rows, idle=self._changed)

    def _changed(self) -> bool:
        before, self._shown = self._shown, self.percent
        return before != self._shown


class _Bar(Row):
    focusable = False

    def __init__(self, form: SavingForm) -> None:
        super().__init__("")
        self._form = form

    def draw(self, target: pygame.Surface, area: pygame.Rect, context: DrawContext) -> None:
        percent = context.text.line(f"{self._form.percent} %", context.size, TEXT)
        room = context.text.width("100 %", context.size) + context.size
        high = context.size * 2 // 3
        track = pygame.Rect(area.x, 0, area.width - room, high)
        track.centery = area.y + area.height // 2 - context.size // 4
        target.blit(box(track.size, TRACK, high // 2), track)
        done = pygame.Rect(track.topleft, (track.width * self._form.percent // 100, high))
        if done.width >= high:
            target.blit(box(done.size, ACCENT, high // 2), done)
        target.blit(percent, percent.get_rect(midright=(area.right, track.centery)))


QUIET_SECONDS = 60.0
"""Time without new data after which an open recording counts as interrupted."""
MAX_SHOWN = 50
AT_ONCE = 0.02
"""Time in seconds for reading files before handling the next input."""


def recent_recordings(folders: Iterable[Path]) -> list[Path]:
    """Return the recordings in some folders, the newest first.

    Interrupted recordings are included, but no recordings of games that still run.
    """
    found: list[tuple[float, Path]] = []
    now = time.time()
    for folder in folders:
        for path in folder.glob("*.rbt*") if folder.is_dir() else ():
            try:
                stat = path.stat()
            except OSError:
                continue
            # Reading from a pipe or device would block the window.
            if not S_ISREG(stat.st_mode):
                continue
            written = stat.st_mtime
            if path.suffix == CLOSED or (_is_cut_off(path) and now - written > QUIET_SECONDS):
                found.append((written, path))
    return [path for _, path in sorted(found, reverse=True)[:MAX_SHOWN]]


def _is_cut_off(path: Path) -> bool:
    """Return whether a file was never closed, and not closed under another name either."""
    return path.name.endswith(OPEN) and not path.with_suffix("").exists()


class ReplaysMenu:
    """List of recordings; the form's result is a path, or `back`."""

    def __init__(
        self,
        paths: Iterable[Path],
        message: str = "",
        *,
        rendering: str = "",
        chosen: object = None,
        now: datetime | None = None,
    ) -> None:
        self._now = now or datetime.now().astimezone()
        self._pictures = Thumbnails(rendering)
        self._summaries: dict[Path, RecordingEntry] = {}
        entries = [self._entry(path) for path in paths]
        self._unread: Iterator[Path] = iter([Path(str(entry.answer)) for entry in entries])
        self.form = Picker(
            "Replays",
            entries,
            [Button("Back", "back")],
            chosen=chosen,
            empty="No replays yet. Play a game first!",
            idle=self._load,
        )
        self.form.message = message

    def _entry(self, path: Path) -> PickerEntry:
        return PickerEntry(
            path,
            lambda: self._text(path),
            picture=lambda room: self._picture(path, room),
            about=lambda: self._about(path),
        )

    def _text(self, path: Path) -> EntryText:
        found = self._summaries.get(path)
        if found is None:
            return EntryText(path.name.partition(CLOSED)[0].replace("_", " "), "…")
        title = task_title(found.name) if found.name else path.name
        return EntryText(title, f"{when_words(found.when, self._now)} · {found.result}")

    def _about(self, path: Path) -> str:
        found = self._summaries.get(path)
        if found is None:
            return ""
        people = f"Played by {', '.join(found.people)}." if found.people else ""
        result = found.result
        return "\n".join(
            each
            for each in (
                when_words(found.when, self._now),
                f"{capitalised(result)}.",
                people,
                path.name,
            )
            if each
        )

    def _picture(self, path: Path, room: tuple[int, int]) -> Surface | None:
        found = self._summaries.get(path)
        if found is None or found.task is None:
            return None
        return self._pictures.at(f"{found.name} {found.digest}", room, found.load)

    def _load(self) -> bool:
        """Read some files, or else draw a kitchen."""
        until = time.perf_counter() + AT_ONCE
        read = False
        while time.perf_counter() < until:
            path = next(self._unread, None)
            if path is None:
                return read or self._pictures.load()
            self._summaries[path] = summary_of(path)
            read = True
        return read
