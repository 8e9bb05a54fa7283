"""Exports without names and without free text."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("pyarrow", reason="needs the extra `data`")

import polars as pl

from robotouille.replay.frame_schema import Note
from robotouille_data.exports.people import UNWRITTEN
from tests.support.random_study import Write, manifest

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
    of_events = {"note", "t", "player", "name", "text", "action"}
    worded = {"reasons", "reasoning", "topic", "why"}
    assert fields - of_events - worded == UNWRITTEN
