"""The catalogue's tables as Parquet, CSV and JSON lines."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Sequence
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

from robotouille_data.database import in_pieces
from robotouille_data.exports.codebook import table_entry
from robotouille_data.exports.part import Part, Written
from robotouille_data.exports.request import ExportFormat
from robotouille_data.schema import EPISODE_TABLES, EPISODES, EVENTS

__all__ = ["write_tables"]

ROWS_AT_ONCE = 100_000
"""Rows of a table that are held before they are written."""
TEXTS_AT_ONCE = 2_000
"""The same of events, whose texts may have tens of thousands of letters."""
FETCHED_AT_ONCE = 2_000
ARROW_TYPES: dict[str, pa.DataType] = {
    "BigInteger": pa.int64(),
    "Integer": pa.int32(),
    "Double": pa.float64(),
    "Boolean": pa.bool_(),
    "Text": pa.string(),
}
KEYS = frozenset(("id", "episode_id", "seed"))
"""Numbers whose sum says nothing."""


class Writer(Protocol):
    """Takes batches of rows one after the other."""

    def write_batch(self, batch: pa.RecordBatch) -> None:
        """Write some rows."""

    def close(self) -> None:
        """The file is whole."""


class JsonLines:
    """An object a line."""

    def __init__(self, path: Path) -> None:
        self._file: IO[bytes] = path.open("wb")

    def write_batch(self, batch: pa.RecordBatch) -> None:
        """Write some rows."""
        pl.DataFrame(pa.Table.from_batches([batch])).write_ndjson(self._file)

    def close(self) -> None:
        """The file is whole."""
        self._file.close()


def open_writer(format_: ExportFormat, path: Path, schema: pa.Schema) -> Writer:
    """A file of one of the three formats."""
    match format_:
        case ExportFormat.PARQUET:
            writer: Writer = pq.ParquetWriter(path, schema, compression="zstd")
        case ExportFormat.CSV:
            writer = pyarrow.csv.CSVWriter(path, schema)
        case _:
            writer = JsonLines(path)
    return writer


class TableFile:
    """One table's file as it grows."""

    def __init__(self, part: Part, table: sa.Table) -> None:
        columns = part.privacy.columns(table)
        part.codebook[table.name] = table_entry(table, columns)
        self._change = part.privacy.change(table)
        self._key = table.c.id if table is EPISODES else table.c.episode_id
        self._query = sa.select(*columns).order_by(*table.primary_key.columns)
        self._schema = pa.schema([
            pa.field(c.name, ARROW_TYPES[type(c.type).__name__], bool(c.nullable)) for c in columns
        ])  # fmt: skip
        path = part.folder / f"{table.name}.{part.format}"
        self._name, self._path = table.name, part.path(path)
        self._writer = open_writer(part.format, path, self._schema)
        self._rows: list[tuple[Any, ...]] = []
        self._at_once = TEXTS_AT_ONCE if table is EVENTS else ROWS_AT_ONCE
        self._count = 0
        numbers = (f.name for f in self._schema if f.type != pa.string() and f.name not in KEYS)
        self._sums: dict[str, float] = dict.fromkeys(numbers, 0)

    def add(self, connection: Connection, ids: Sequence[int]) -> None:
        """Add the rows of some episodes."""
        query = self._query.where(self._key.in_(ids))
        for rows in _fetched(connection, query):
            self._rows += rows if self._change is None else map(self._change, rows)
            if len(self._rows) >= self._at_once:
                self._flush()

    def finish(self) -> Written:
        """Write what is left; what the file holds."""
        self._flush()
        return Written(self._name, self._path, self._count, self._sums)

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
        self._rows = []


def write_tables(part: Part) -> Iterator[Written]:
    """Write a file for each table; what is in each."""
    with ExitStack() as stack:
        stack.enter_context(_no_search_for_garbage())
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


def _fetched(connection: Connection, query: sa.Select[Any]) -> Iterator[Sequence[Any]]:
    streaming = connection.execution_options(yield_per=FETCHED_AT_ONCE)
    yield from streaming.execute(query).partitions()


@contextmanager
def _no_search_for_garbage() -> Iterator[None]:
    """Rows have no cycles, and looking for some among so many new ones takes a third of the time
    in which they are read."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
