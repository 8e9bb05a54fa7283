"""The newest recordings that are here."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from datetime import datetime
from pathlib import Path
from stat import S_ISREG

from pygame import Surface

from robotouille.world.people.templates import capitalised
from robotouille_client.window.forms.picker import Picker, PickerEntry, Told
from robotouille_client.window.forms.widgets import Button
from robotouille_client.window.shell.screens.recording_summary import (
    RecordingSummary,
    summary_of,
    when_words,
)
from robotouille_client.window.shell.screens.thumbnails import Thumbnails
from robotouille_client.window.sources.task_titles import task_title

__all__ = ["ReplaysMenu", "recent_recordings"]

OPEN, CLOSED = ".rbt.part", ".rbt"
QUIET_SECONDS = 60.0
"""Without a new step, after which a game is taken to be cut off."""
MAX_SHOWN = 50
AT_ONCE = 0.02
"""Seconds that may be spent on reading files before the next look for what its owner does."""


def recent_recordings(folders: Iterable[Path]) -> list[Path]:
    """Recordings in some folders, the newest first; those of games that were cut off as well, but
    none of a game that is being played. Folders, pipes and devices are none."""
    found: list[tuple[float, Path]] = []
    now = time.time()
    for folder in folders:
        for path in folder.glob("*.rbt*") if folder.is_dir() else ():
            try:
                stat = path.stat()
            except OSError:
                continue
            if not S_ISREG(stat.st_mode):
                continue
            written = stat.st_mtime
            if path.suffix == CLOSED or (_is_cut_off(path) and now - written > QUIET_SECONDS):
                found.append((written, path))
    return [path for _, path in sorted(found, reverse=True)[:MAX_SHOWN]]


def _is_cut_off(path: Path) -> bool:
    """Whether a file was never closed, and has not been closed under another name."""
    return path.name.endswith(OPEN) and not path.with_suffix("").exists()


class ReplaysMenu:
    """The form, whose result is a path, or `back`."""

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
        self._summaries: dict[Path, RecordingSummary] = {}
        entries = [self._entry(path) for path in paths]
        self._unread: Iterator[Path] = iter([Path(str(entry.answer)) for entry in entries])
        self.form = Picker(
            "Replays",
            entries,
            [Button("Back", "back")],
            chosen=chosen,
            empty="There is no recording yet: play a game first.",
            idle=self._load,
        )
        self.form.message = message

    def _entry(self, path: Path) -> PickerEntry:
        return PickerEntry(
            path,
            lambda: self._told(path),
            picture=lambda room: self._picture(path, room),
            about=lambda: self._about(path),
        )

    def _told(self, path: Path) -> Told:
        found = self._summaries.get(path)
        if found is None:
            return Told(path.name.partition(CLOSED)[0].replace("_", " "), "…")
        title = task_title(found.name) if found.name else path.name
        return Told(title, f"{when_words(found.when, self._now)} · {found.result}")

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
        """Look into some files, or else draw a kitchen."""
        until = time.perf_counter() + AT_ONCE
        read = False
        while time.perf_counter() < until:
            path = next(self._unread, None)
            if path is None:
                return read or self._pictures.load()
            self._summaries[path] = summary_of(path)
            read = True
        return read
