"""One part of an export, and what was written of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sqlalchemy.engine import Connection

from robotouille_data.exports.privacy import Privacy
from robotouille_data.exports.request import ExportFormat, Request

__all__ = ["Entry", "Field", "Part", "Written"]


@dataclass(frozen=True, slots=True)
class Field:
    """A column or an array: its type, its unit (empty: none) and its meaning."""

    name: str
    type: str
    meaning: str
    unit: str = ""
    null: bool = False


@dataclass(frozen=True, slots=True)
class Entry:
    """What the codebook says of files that are alike."""

    name: str
    meaning: str
    fields: tuple[Field, ...]
    notes: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Written:
    """A file, or a folder of one data set: its path in the export, its rows, and the sums of its
    columns that have numbers. `entry` is what the codebook calls it."""

    entry: str
    path: str
    rows: int
    sums: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Part:
    """A part of an export, to be written.

    `name` is that of the part, empty if there is one alone; files go into `folder`. `tasks` says by
    the digests of tasks what is called after them. `done` is told how many episodes more are done.
    What cannot be exported of an episode, and why, goes into `faults`; what the codebook has to say
    into `codebook`, by name.
    """

    connection: Connection
    request: Request
    format: ExportFormat
    privacy: Privacy
    root: Path
    name: str
    ids: Sequence[int]
    tasks: Mapping[str, str]
    done: Callable[[int], None]
    faults: dict[int, str]
    codebook: dict[str, Entry]

    @property
    def folder(self) -> Path:
        """Where its files go."""
        return self.root / self.name

    def path(self, file: Path) -> str:
        """A file as the export calls it."""
        return file.relative_to(self.root).as_posix()
