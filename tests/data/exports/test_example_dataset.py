"""The example data set matches its documents and loads in other software."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("pyarrow", reason="needs the extra `data`")

import polars as pl

from robotouille_data.exports.documents import CODEBOOK, MANIFEST, card_text, read_json
from robotouille_data.schema import EPISODE_TABLES
from tests.support.sources import ROOT

FOLDER = ROOT / "datasets" / "bot_teams"
TOLD = read_json(FOLDER, MANIFEST)
ENTRIES = {each["name"]: each for each in read_json(FOLDER, CODEBOOK)["entries"]}


def frame(name: str) -> pl.DataFrame:
    return pl.read_parquet(FOLDER / f"{name}.parquet")


@pytest.mark.parametrize("table", [table.name for table in EPISODE_TABLES])
def test_tables_match_the_codebook(table: str) -> None:
    found = frame(table)
    assert len(found) == ENTRIES[table]["rows"]
    assert found.columns == [field["name"] for field in ENTRIES[table]["fields"]]
    [written] = [each for each in TOLD["data"] if each["entry"] == table]
    for name, total in written["sums"].items():
        assert (found[name].sum() or 0) == pytest.approx(total)


def test_conversations_match_the_codebook() -> None:
    lines = (FOLDER / "chat.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(lines) == ENTRIES["chat"]["rows"] == len(pl.read_ndjson(FOLDER / "lines.jsonl"))
    assert all(json.loads(line)["messages"] for line in lines)


def test_files_are_small_and_match_their_hashes() -> None:
    for name, sums in TOLD["files"].items():
        assert hashlib.sha256((FOLDER / name).read_bytes()).hexdigest() == sums["sha256"]
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 1_000_000


def test_card_is_up_to_date() -> None:
    card = card_text(TOLD, read_json(FOLDER, CODEBOOK))
    assert card == (FOLDER / "README.md").read_text(encoding="utf-8")
    assert (FOLDER / "LICENSE").read_text() == (ROOT / "LICENSE").read_text()


@pytest.mark.slow
def test_datasets_loads_the_data_set(hub: Any) -> None:
    for table in EPISODE_TABLES:
        found = hub.load_dataset(str(FOLDER), table.name)["train"]
        assert len(found) == ENTRIES[table.name]["rows"]
    chat = hub.load_dataset("json", data_files=str(FOLDER / "chat.jsonl"))["train"]
    assert len(chat) == ENTRIES["chat"]["rows"]
