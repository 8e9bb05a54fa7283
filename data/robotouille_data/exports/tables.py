"""Tables of the catalogue as Parquet, CSV and JSON lines."""

from __future__ import annotations

import gc
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any, Protocol

import polars as pl
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq
import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille.terminal import FORMULA
from robotouille_data.database import in_pieces
from robotouille_data.exports.request import ExportEntry, ExportFormat, Field, Part, WrittenFile
from robotouille_data.schema import EPISODE_TABLES, EPISODES, EVENTS

UNITS = {
    "seats.thinking_ms": "ms",
    "seats.delay_ms": "ms",
    "steps.t": "ms",
    "steps.late_ms": "ms",
    "steps.ms": "ms",
    "events.t": "ms",
    "episodes.seconds": "s",
    "episodes.active_seconds": "s",
    "episodes.grace": "s",
    "episodes.step_rate": "1/s",
    "episodes.max_steps": "steps",
    "episodes.steps": "steps",
    "measures.fewest_steps": "steps",
    "measures.steps_to_go_least": "steps",
    "measures.steps_to_go_most": "steps",
    "measures.repeated_transitions": "steps",
    "measures.blocking": "actions",
    "measures.score": "points",
    "measures.score_bound": "points",
    "measures.served": "orders",
    "measures.expired": "orders",
    "steps.staleness": "steps",
    "seats.staleness": "steps",
    "seats.lost": "actions",
    "seats.invalid": "requests",
    "seats.malformed": "requests",
    "seats.rejected": "requests",
    "seats.said": "messages",
    **{
        f"seats.{name}": "steps"
        for name in (
            "acted",
            "busy",
            "waiting",
            "idle",
            "away",
            "substituted",
            "waits",
            "unused",
            "hindered",
        )
    },
}
"""Units of columns. All other numbers are shares or have no unit."""

MEANINGS = {
    "episodes": "one row per episode",
    "seats": "one row per seat of an episode",
    "steps": "one row per step and seat of an episode",
    "events": "events between the steps: arrivals, departures, chat, rejected requests, pauses",
    "labels": "one row per label of an episode",
    "measures": "one row per episode: measures of its team",
}

LINK = re.compile(r"\[([^\]]+)\]\([^)]*\)")


def table_entry(table: sa.Table, columns: Iterable[sa.Column[Any]]) -> ExportEntry:
    """Return the codebook entry of a table with the remaining columns."""
    fields = tuple(
        Field(
            column.name,
            type(column.type).__name__.lower(),
            LINK.sub(r"\1", column.doc or ""),
            UNITS.get(f"{table.name}.{column.name}", ""),
            bool(column.nullable),
        )
        for column in columns
    )
    return ExportEntry(table.name, MEANINGS[table.name], fields)


ROWS_AT_ONCE = 100_000
"""Rows held in memory before they are written."""
TEXT_AT_ONCE = 16 * 1024 * 1024
"""Characters of texts held in memory before they are written."""
FETCHED_AT_ONCE, EVENTS_AT_ONCE = 2_000, 20
"""Rows fetched at once. An event's texts may have millions of characters."""
ARROW_TYPES: dict[str, pa.DataType] = {
    "BigInteger": pa.int64(),
    "Integer": pa.int32(),
    "Double": pa.float64(),
    "Boolean": pa.bool_(),
    "Text": pa.string(),
}
KEYS = frozenset(("id", "episode_id", "seed"))
"""Columns of identifiers, for which a sum is meaningless."""


class BatchWriter(Protocol):
    """Writer of batches of rows."""

    def write_batch(self, batch: pa.RecordBatch) -> None:
        """Write some rows."""

    def close(self) -> None:
        """Finish the file."""


class SpreadsheetCsv:
    """Writer of CSV whose texts no spreadsheet interprets as formulas."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._writer = pyarrow.csv.CSVWriter(path, schema)

    def write_batch(self, batch: pa.RecordBatch) -> None:
        """Write some rows, with an apostrophe before each text that looks like a formula."""
        columns = [
            _inert(column) if pa.types.is_string(column.type) else column for column in batch
        ]
        self._writer.write_batch(pa.RecordBatch.from_arrays(columns, schema=batch.schema))

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()


def _inert(texts: pa.Array) -> pa.Array:
    """Return what `spreadsheet_cell` returns for each text."""
    quoted = pc.binary_join_element_wise("'", texts, "")
    return pc.if_else(pc.match_substring_regex(texts, FORMULA), quoted, texts)


class JsonLines:
    """Writer of one JSON object per line."""

    def __init__(self, path: Path) -> None:
        self._file: IO[bytes] = path.open("wb")

    def write_batch(self, batch: pa.RecordBatch) -> None:
        """Write some rows."""
        pl.DataFrame(pa.Table.from_batches([batch])).write_ndjson(self._file)

    def close(self) -> None:
        """Finish the file."""
        self._file.close()


def open_writer(format_: ExportFormat, path: Path, schema: pa.Schema) -> BatchWriter:
    """Open a file in one of the three formats."""
    match format_:
        case ExportFormat.PARQUET:
            writer: BatchWriter = pq.ParquetWriter(path, schema, compression="zstd")
        case ExportFormat.CSV:
            writer = SpreadsheetCsv(path, schema)
        case _:
            writer = JsonLines(path)
    return writer


class TableFile:
    """File of one table, written in batches."""

    def __init__(self, part: Part, table: sa.Table) -> None:
        columns = part.privacy.columns(table)
        part.codebook[table.name] = table_entry(table, columns)
        self._change = part.privacy.change(table)
        self._key = table.c.id if table is EPISODES else table.c.episode_id
        # Ordered by the primary key, because a database may return rows in any order, and equal
        # catalogues must give equal files.
        self._query = sa.select(*columns).order_by(*table.primary_key.columns)
        self._schema = pa.schema([
            pa.field(c.name, ARROW_TYPES[type(c.type).__name__], bool(c.nullable)) for c in columns
        ])  # fmt: skip
        path = part.folder / f"{table.name}.{part.format}"
        self._name, self._path = table.name, part.path(path)
        self._writer = open_writer(part.format, path, self._schema)
        self._rows: list[tuple[Any, ...]] = []
        self._at_once = EVENTS_AT_ONCE if table is EVENTS else FETCHED_AT_ONCE
        self._count = self._text = 0
        # Sums of the columns let a reader notice an incomplete download or a wrong import without
        # our software.
        numbers = (f.name for f in self._schema if f.type != pa.string() and f.name not in KEYS)
        self._sums: dict[str, float] = dict.fromkeys(numbers, 0)

    def add(self, connection: Connection, ids: Sequence[int]) -> None:
        """Add the rows of some episodes."""
        query = self._query.where(self._key.in_(ids))
        for rows in _fetched(connection, query, self._at_once):
            changed = rows if self._change is None else list(map(self._change, rows))
            self._rows += changed
            if self._at_once == EVENTS_AT_ONCE:
                self._text += sum(len(v) for row in changed for v in row if isinstance(v, str))
            if len(self._rows) >= ROWS_AT_ONCE or self._text >= TEXT_AT_ONCE:
                self._flush()

    def finish(self) -> WrittenFile:
        """Write the remaining rows, and return a summary of the file."""
        self._flush()
        return WrittenFile(self._name, self._path, self._count, self._sums)

    def close(self) -> None:
        """Close the file."""
        self._writer.close()

    def _flush(self) -> None:
        if not self._rows:
            return
        columns = zip(*self._rows, strict=True)
        arrays = [pa.array(c, f.type) for c, f in zip(columns, self._schema, strict=True)]
        batch = pa.RecordBatch.from_arrays(arrays, schema=self._schema)
        self._writer.write_batch(batch)
        for name in self._sums:
            self._sums[name] += pc.sum(batch[name]).as_py() or 0
        self._count += len(self._rows)
        self._rows, self._text = [], 0


def write_tables(part: Part) -> Iterator[WrittenFile]:
    """Write one file per table."""
    with ExitStack() as stack:
        stack.enter_context(_without_garbage_collection())
        files = []
        for table in EPISODE_TABLES:
            file = TableFile(part, table)
            stack.callback(file.close)
            files.append(file)
        for ids in in_pieces(part.ids):
            for file in files:
                file.add(part.connection, ids)
            part.done(len(ids))
        yield from [file.finish() for file in files]


def _fetched(
    connection: Connection, query: sa.Select[Any], at_once: int
) -> Iterator[Sequence[Any]]:
    streaming = connection.execution_options(yield_per=at_once)
    yield from streaming.execute(query).partitions()


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Disable garbage collection.

    Rows have no reference cycles, and collecting garbage among many new rows takes a third of the
    reading time.
    """
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
