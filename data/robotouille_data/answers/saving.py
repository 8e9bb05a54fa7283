"""Answers as a table on a terminal, or as a file: CSV, JSON or Parquet."""

from __future__ import annotations

import csv
import json
from decimal import Decimal
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import Any

from robotouille.domain.files import whole_file
from robotouille.errors import MissingExtraError
from robotouille.program import printable
from robotouille_data.answers.query import Answer

__all__ = [
    "MAX_SHOWN",
    "save_csv",
    "save_json",
    "save_parquet",
    "table_lines",
]

MAX_SHOWN = 1000
"""Rows that a terminal is shown."""
MAX_WIDTH = 60
"""Letters of a value that a terminal is shown."""


def table_lines(answer: Answer, limit: int = MAX_SHOWN) -> tuple[list[str], bool]:
    """The first rows as lines with a heading, and whether there are more."""
    rows = [[_shown(value) for value in row] for row in islice(answer.rows, limit + 1)]
    more = len(rows) > limit
    table = [[_shown(name) for name in answer.columns], *rows[:limit]]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    ruled = [table[0], ["-" * width for width in widths], *table[1:]]
    lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in ruled)
    return list(lines), more


def save_csv(answer: Answer, path: Path) -> int:
    """Write CSV with a heading; how many rows there are. OSError if it cannot be written."""
    with whole_file(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(answer.columns)
        count = 0
        for row in answer.rows:
            writer.writerow(row)
            count += 1
    return count


def save_json(answer: Answer, path: Path) -> int:
    """Write a list of objects, one a line; how many there are. OSError as in `save_csv`.

    Numbers that are none, or endless, are null: JSON has no others.
    """
    count = 0
    with whole_file(path) as file:
        file.write("[")
        for count, row in enumerate(answer.rows, 1):
            file.write(",\n" if count > 1 else "\n")
            named = dict(zip(answer.columns, map(_finite, row), strict=True))
            json.dump(named, file, ensure_ascii=False, default=_number)
        file.write("\n]\n")
    return count


def save_parquet(answer: Answer, path: Path) -> int:
    """Write Parquet, compressed with Zstandard; how many rows there are.

    Raises:
        MissingExtraError: polars is not installed.
        OSError: The file cannot be written.
    """
    try:
        import polars as pl
    except ImportError:
        raise MissingExtraError("Parquet", "data") from None
    rows = [tuple(map(_plain, row)) for row in answer.rows]
    frame = pl.DataFrame(rows, list(answer.columns), orient="row", infer_schema_length=None)
    with whole_file(path, text=False) as file:
        frame.write_parquet(file, compression="zstd")
    return len(rows)


def _shown(value: Any) -> str:
    text = "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
    return printable(text if len(text) <= MAX_WIDTH else f"{text[: MAX_WIDTH - 1]}…")


def _plain(value: Any) -> Any:
    return float(value) if isinstance(value, Decimal) else value


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


def _number(value: Any) -> Any:
    """What JSON has no type for: sums and means of PostgreSQL are decimals, else as text."""
    return float(value) if isinstance(value, Decimal) else str(value)
