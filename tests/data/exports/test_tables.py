"""Other software reads the tables with equal counts and sums."""

from __future__ import annotations

import csv
import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("polars", reason="needs the extra `data`")

import polars as pl
from sqlalchemy.engine import URL

from robotouille.replay.compression import compress
from robotouille.terminal import spreadsheet_cell
from robotouille_data.database import database_url
from robotouille_data.exports import tables
from robotouille_data.exports.exporting import export
from robotouille_data.exports.request import ExportFormat, ExportRequest
from robotouille_data.indexing import index
from robotouille_data.query import asking
from robotouille_data.schema import EPISODE_TABLES, METADATA
from tests.support.random_play import talkative_stream
from tests.support.random_study import Write, manifest

FORMATS = ("parquet", "csv", "jsonl")
TYPES = {
    "BigInteger": pl.Int64,
    "Integer": pl.Int32,
    "Double": pl.Float64,
    "Boolean": pl.Boolean,
    "Text": pl.String,
}


def loaded(folder: Path, table: str, format_: str) -> pl.DataFrame:
    path = folder / f"{table}.{format_}"
    schema = {c.name: TYPES[type(c.type).__name__] for c in METADATA.tables[table].columns}
    match format_:
        case "parquet":
            return pl.read_parquet(path)
        case "csv":
            return pl.read_csv(path, schema=schema)
    return pl.read_ndjson(path, schema=schema)


def agrees(rows: int, sums: Mapping[str, Any], written: Mapping[str, Any]) -> None:
    """Check counts and sums against those in export.json."""
    assert rows == written["rows"]
    for column, total in written["sums"].items():
        found = sums[column]
        assert math.isclose(0 if found is None else found, total, rel_tol=1e-9), column


@pytest.mark.parametrize("format_", FORMATS)
def test_tables_equal_the_catalogue(url: URL, write: Write, format_: str) -> None:
    folder = write(format_)
    for table in EPISODE_TABLES:
        keys = ", ".join(column.name for column in table.primary_key.columns)
        with asking(url, f"SELECT * FROM {table.name} ORDER BY {keys}") as answer:
            expected = [tuple(row) for row in answer.rows]
        if format_ == "csv":
            expected = [
                tuple(spreadsheet_cell(one) if isinstance(one, str) else one for one in row)
                for row in expected
            ]
        frame = loaded(folder, table.name, format_)
        assert frame.columns == [column.name for column in table.columns]
        assert frame.dtypes == [TYPES[type(column.type).__name__] for column in table.columns]
        assert frame.rows() == expected, table.name


def test_long_tables_are_written_in_batches(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = write()
    monkeypatch.setattr(tables, "ROWS_AT_ONCE", 7)
    monkeypatch.setattr(tables, "TEXT_AT_ONCE", 500)
    monkeypatch.setattr(tables, "FETCHED_AT_ONCE", 3)
    pieces = write()
    for table in EPISODE_TABLES:
        name = f"{table.name}.parquet"
        assert pl.read_parquet(whole / name).equals(pl.read_parquet(pieces / name))
    assert manifest(whole)["episodes"] == manifest(pieces)["episodes"]


@pytest.mark.parametrize("format_", FORMATS)
def test_only_csv_marks_texts_that_look_like_formulas(tmp_path: Path, format_: str) -> None:
    name = '=HYPERLINK("https://evil.example","open me")'
    stream = talkative_stream((name, ""), "\uff1d1+1", "s", "\t+2")
    (tmp_path / "formula.rbt").write_bytes(compress(stream))
    url = database_url(None, tmp_path)
    index(url, [tmp_path])
    export(url, tmp_path / "out", ExportRequest((ExportFormat(format_),)))
    mark = "'" if format_ == "csv" else ""
    assert loaded(tmp_path / "out", "seats", format_)["name"].to_list() == [mark + name, "bot"]
    assert loaded(tmp_path / "out", "episodes", format_)["detail"].item() == f"{mark}{name} left"
    names = loaded(tmp_path / "out", "events", format_)["name"].to_list()
    assert {each for each in names if each} == {mark + name, "bot", mark + "\uff1d1+1"}


@pytest.mark.slow
@pytest.mark.parametrize("format_", FORMATS)
@pytest.mark.parametrize("split", [{}, {"train": 0.5, "test": 0.5}])
def test_datasets_reads_equal_counts_and_sums(
    write: Write, hub: Any, format_: str, split: dict[str, float]
) -> None:
    folder = write(format_, split=split)
    written = [each for each in manifest(folder)["data"] if each["rows"]]
    for name in {each["entry"] for each in written}:
        parts = hub.load_dataset(str(folder), name)
        for each in (each for each in written if each["entry"] == name):
            frame = parts[each["part"] or "train"].to_pandas()
            sums = {column: frame[column].astype("float64").sum() for column in each["sums"]}
            agrees(len(frame), sums, each)


def test_export_json_lists_all_files(write: Write) -> None:
    folder = write(split={"train": 0.5, "test": 0.5})
    received = manifest(folder)["files"]
    later = {"README.md", "export.json"}
    found = {
        path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()
    }
    assert found.keys() - later == received.keys()
    for name, sums in received.items():
        content = found[name].read_bytes()
        assert (len(content), hashlib.sha256(content).hexdigest()) == (
            sums["bytes"],
            sums["sha256"],
        )


def test_the_codebook_has_all_columns(write: Write) -> None:
    entries = json.loads((write() / "codebook.json").read_text())["entries"]
    assert [entry["name"] for entry in entries] == [table.name for table in EPISODE_TABLES]
    for entry, table in zip(entries, EPISODE_TABLES, strict=True):
        assert [field["name"] for field in entry["fields"]] == [c.name for c in table.columns]
        assert all(field["meaning"] and "](" not in field["meaning"] for field in entry["fields"])


def test_csv_distinguishes_null_from_empty_text(write: Write) -> None:
    folder = write("csv")
    with (folder / "events.csv").open(newline="") as file:
        assert next(csv.reader(file))[:3] == ["episode_id", "number", "step"]
    frame = loaded(folder, "steps", "csv")
    assert frame["action"].null_count() == (frame["applied"].is_null()).sum() > 0
