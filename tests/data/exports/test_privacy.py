"""Exports without names and without free text."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("pyarrow", reason="needs the extra `data`")

import polars as pl
import sqlalchemy as sa
from sqlalchemy.engine import URL

from robotouille.replay.compression import compress
from robotouille.replay.frame_schema import Note
from robotouille_data.database import database_url
from robotouille_data.exports.exporting import export
from robotouille_data.exports.privacy import COLUMNS, PLAIN_FIELDS, WRITTEN_FIELDS, Privacy
from robotouille_data.exports.request import ExportFormat, ExportRequest
from robotouille_data.indexing import index
from robotouille_data.query import reading
from robotouille_data.schema import EPISODE_TABLES
from tests.support.random_play import talkative_stream
from tests.support.random_study import Write, manifest
from tests.support.samples import quick_sample

NAMES = ["Ada", "Bob", *(f"x{pair}{one}" for pair in range(3) for one in "ab")]
SECRETS = ["CODE-", "some-owner", "session"]
WRITTEN = ["hello", "[2J", "=1+1", "no action at all", "reasons"]


def everything(folder: Path) -> str:
    return "".join(
        path.read_text()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in ("codebook.json", "README.md")
    )


def test_names_are_replaced_everywhere(write: Write) -> None:
    plain, folder = everything(write("csv")), write("csv", names=False)
    text = everything(folder)
    for each in NAMES + SECRETS:
        assert each in plain
        assert each not in text
    header = (folder / "episodes.csv").read_text().partition("\n")[0]
    assert '"code"' not in header
    assert '"owner"' not in header
    assert "hello" in text


def test_replaced_names_are_consistent(write: Write) -> None:
    plain, folder = write(), write(names=False, split={"train": 0.5, "test": 0.5})
    seats = pl.read_parquet(plain / "seats.parquet")
    new = pl.concat([pl.read_parquet(p) for p in sorted(folder.glob("*/seats.parquet"))])
    joined = seats.join(new, on=["episode_id", "seat"], suffix="_new")
    pairs = set(joined.select("name", "name_new").rows())
    assert len(pairs) == len({one for one, _ in pairs}) == len({new for _, new in pairs}) == 8
    assert all(not one or one[0] == "p" for one in new["participant"])
    known = dict(zip(joined["name"], joined["name_new"], strict=True))
    events = pl.read_parquet(plain / "events.parquet").filter(kind="roster")
    renamed = pl.concat([pl.read_parquet(p) for p in sorted(folder.glob("*/events.parquet"))])
    both = events.join(renamed, on=["episode_id", "number"], suffix="_new")
    for name, other, details in both.select("name", "name_new", "details_new").rows():
        assert other == known.get(name, "")
        assert json.loads(details)["participant"] in ("", other)


def test_texts_are_left_out(write: Write) -> None:
    plain, folder = everything(write("jsonl")), write("jsonl", texts=False)
    text = everything(folder)
    for each in WRITTEN:
        assert each in plain
        assert each not in text
    assert "Ada" in text
    assert "text" not in pl.read_ndjson(folder / "events.jsonl").columns
    assert "phrases" not in pl.read_ndjson(folder / "episodes.jsonl").columns


def test_names_and_texts_can_both_be_left_out(write: Write) -> None:
    query = "SELECT episode_id AS id FROM seats WHERE name LIKE 'Ada%'"
    folder = write("csv", names=False, texts=False, query=query)
    text = everything(folder)
    assert not [each for each in NAMES + SECRETS + WRITTEN if each in text]
    assert (manifest(folder)["names"], manifest(folder)["texts"]) == (False, False)
    assert "Ada" not in (folder / "README.md").read_text()


def test_every_field_of_notes_is_classified() -> None:
    """A new field of recordings is left out until it is listed as free of text."""
    fields: set[str] = set()
    for model in Note.__origin__.__args__:
        fields |= model.model_fields.keys()
    # `agent` is left out with the names and with the texts, as a client writes it.
    of_events = {"note", "t", "player", "name", "text", "action", "agent"}
    assert fields - of_events == PLAIN_FIELDS | WRITTEN_FIELDS


@pytest.mark.parametrize("table", EPISODE_TABLES, ids=lambda table: table.name)
def test_every_column_of_text_declares_its_content(table: sa.Table) -> None:
    texts = {column.name for column in table.columns if isinstance(column.type, sa.Text)}
    assert texts == COLUMNS[table.name].keys()


def test_column_without_a_declaration_is_left_out(url: URL) -> None:
    new = sa.Table(
        "episodes", sa.MetaData(), sa.Column("motto", sa.Text), sa.Column("n", sa.Double)
    )
    with reading(url) as connection:
        for names, texts in ((False, True), (True, False)):
            privacy = Privacy(connection, [], names=names, texts=texts)
            assert privacy.columns(new) == [new.c.n]


PARTICIPANT = ("plantedname", "plantedpseudonym")
SPECTATOR = "plantedwatcher"
SESSION = "plantedsession"
WORDS = "plantedwords"
FORMATS = [("csv",), ("jsonl",), ("parquet", "chat", "arrays", "minari")]


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the recording of an episode that a talkative participant leaves."""
    folder = tmp_path_factory.mktemp("planted")
    stream = talkative_stream(PARTICIPANT, SPECTATOR, SESSION, WORDS)
    (folder / "planted.rbt").write_bytes(compress(stream))
    index(database_url(None, folder), [folder])
    return folder


def contents(folder: Path) -> str:
    """Return the content of all files, with compressed ones unpacked."""
    found = []
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".parquet":
            found.append(pl.read_parquet(path).write_json())
        elif path.suffix == ".npz":
            with zipfile.ZipFile(path) as archive:
                found += [archive.read(name).decode("latin-1") for name in archive.namelist()]
        elif path.is_file():
            found.append(path.read_text("latin-1"))
    return "\n".join(found)


def exported(planted: Path, folder: Path, formats: tuple[str, ...], **options: Any) -> str:
    request = ExportRequest(tuple(map(ExportFormat, formats)), **options)
    result = export(database_url(None, planted), folder, request)
    assert not result.faults
    return contents(folder)


@pytest.mark.parametrize(
    "formats", quick_sample([(each,) for each in FORMATS], 2), ids=lambda formats: formats[0]
)
def test_no_format_contains_what_a_participant_wrote(
    planted: Path, tmp_path: Path, formats: tuple[str, ...]
) -> None:
    if "minari" in formats:
        pytest.importorskip("minari", reason="needs the extra `minari`")
    secrets = (*PARTICIPANT, SPECTATOR, SESSION)
    everything = exported(planted, tmp_path / "all", formats)
    assert all(secret in everything for secret in (*secrets, f"{PARTICIPANT[0]} left", WORDS))
    nameless = exported(planted, tmp_path / "nameless", formats, names=False)
    assert not [secret for secret in secrets if secret in nameless]
    assert WORDS in nameless
    wordless = exported(planted, tmp_path / "wordless", formats, texts=False)
    assert WORDS not in wordless
    assert PARTICIPANT[0] in wordless
    neither = exported(planted, tmp_path / "neither", formats, names=False, texts=False)
    assert "planted" not in neither
