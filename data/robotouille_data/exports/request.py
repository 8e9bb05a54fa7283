"""What is asked for: which episodes, in which format, and what is left out of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from robotouille_data.answers.query import SECONDS

__all__ = ["TABLES", "About", "ExportFormat", "Request"]


class ExportFormat(StrEnum):
    """What the data is written as; the first three are the catalogue's tables."""

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
    """What its makers say of a data set; `license` is an identifier of SPDX. Empty: not said."""

    title: str = ""
    description: str = ""
    license: str = ""
    contact: str = ""


@dataclass(frozen=True, slots=True)
class Request:
    """An export.

    Args:
        formats: In each of them the episodes are written; of the tables' in one at most.
        query: SQL whose answer has a column `id` or `episode_id`; empty: all episodes.
        seconds: How long the query may take.
        labels: Only episodes that have all of these.
        consent: Only episodes that have this label, whose name and value it is.
        names: Names and pseudonyms of participants are kept, and codes and owners.
        texts: Whatever people or models have written is kept.
        split: The shares of the parts, by their names; empty: one part.
        split_by: Episodes with the same value of this label are in the same part.
        system: For chat, what each conversation begins with; empty: nothing.
        per_decision: For chat, a conversation for each decision instead of each seat.
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
