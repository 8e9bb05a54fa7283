"""Requests for exports, and the parts in which they are written."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from sqlalchemy.engine import Connection

from robotouille_data.exports.privacy import Privacy
from robotouille_data.query import SECONDS


class ExportFormat(StrEnum):
    """Format of the data."""

    PARQUET = "parquet"
    CSV = "csv"
    JSONL = "jsonl"
    CHAT = "chat"
    MINARI = "minari"
    ARRAYS = "arrays"


TABLES = (ExportFormat.PARQUET, ExportFormat.CSV, ExportFormat.JSONL)
"""Formats of the catalogue's tables."""


@dataclass(frozen=True, slots=True)
class About:
    """Description of a data set. `license` is an SPDX identifier. Fields may be empty."""

    title: str = ""
    description: str = ""
    license: str = ""
    contact: str = ""


@dataclass(frozen=True, slots=True)
class ExportRequest:
    """Request for an export.

    Attributes:
        formats: Formats to write.
        query: SQL with a column `id` or `episode_id` that selects episodes. Empty selects all.
        seconds: Time limit of the query.
        labels: Labels that the episodes must have.
        consent: Name and value of the label that gives consent.
        names: Keep names and pseudonyms of participants, codes and owners.
        texts: Keep text that people or models wrote.
        split: Shares of the parts by name. Empty means one part.
        split_by: Episodes with equal values of this label are in the same part.
        system: System prompt of each conversation of the format `chat`.
        per_decision: Write one conversation per decision, instead of one per seat.
    """

    formats: tuple[ExportFormat, ...]
    query: str = ""
    seconds: float = SECONDS
    labels: Mapping[str, str] = field(default_factory=dict)
    consent: tuple[str, str] | None = None
    names: bool = True
    texts: bool = True
    split: Mapping[str, float] = field(default_factory=dict)
    split_by: str = "pair"
    system: str = ""
    per_decision: bool = False
    about: About = field(default_factory=About)


@dataclass(frozen=True, slots=True)
class Field:
    """Column or array, for the codebook."""

    name: str
    type: str
    meaning: str
    unit: str = ""
    null: bool = False


@dataclass(frozen=True, slots=True)
class ExportEntry:
    """ExportEntry of the codebook for a table, array file or data set."""

    name: str
    meaning: str
    fields: tuple[Field, ...]
    notes: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class WrittenFile:
    """File, or folder of a data set.

    Attributes:
        entry: Name of its entry in the codebook.
        path: Path in the export.
        sums: Sums of the columns with numbers.
    """

    entry: str
    path: str
    rows: int
    sums: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Part:
    """Part of an export, to be written in one format.

    Attributes:
        name: Name of the part, or empty without a split.
        tasks: Names for files, by the digests of the tasks.
        done: Called with the number of episodes that were finished.
        faults: Receives the reasons why episodes could not be exported.
        codebook: Receives the entries of the codebook by name.
    """

    connection: Connection
    request: ExportRequest
    format: ExportFormat
    privacy: Privacy
    root: Path
    name: str
    ids: Sequence[int]
    tasks: Mapping[str, str]
    done: Callable[[int], None]
    faults: dict[int, str]
    codebook: dict[str, ExportEntry]

    @property
    def folder(self) -> Path:
        """Folder of the part's files."""
        return self.root / self.name

    def path(self, file: Path) -> str:
        """Return the path of a file in the export."""
        return file.relative_to(self.root).as_posix()
