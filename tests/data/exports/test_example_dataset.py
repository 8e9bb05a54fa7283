"""The data set that is shipped as an example holds what it says, and is loaded by others."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("pyarrow", reason="needs the extra `data`")

import polars as pl

from robotouille.planning.anytime import AnytimePlanner
from robotouille.replay import recording_of
from robotouille_data.exports.card import card_text
from robotouille_data.exports.manifest import CODEBOOK, MANIFEST, read_json
from robotouille_data.schema import EPISODE_TABLES
from tests.support.scripts import script_module
from tests.support.sources import ROOT

FOLDER = ROOT / "datasets" / "bot_teams"
TOLD = read_json(FOLDER, MANIFEST)
ENTRIES = {each["name"]: each for each in read_json(FOLDER, CODEBOOK)["entries"]}


def frame(name: str) -> pl.DataFrame:
    return pl.read_parquet(FOLDER / f"{name}.parquet")


@pytest.mark.parametrize("table", [table.name for table in EPISODE_TABLES])
def test_tables_are_what_the_codebook_says(table: str) -> None:
    found = frame(table)
    assert len(found) == ENTRIES[table]["rows"]
    assert found.columns == [field["name"] for field in ENTRIES[table]["fields"]]
    [written] = [each for each in TOLD["data"] if each["entry"] == table]
    for name, total in written["sums"].items():
        assert (found[name].sum() or 0) == pytest.approx(total)


def test_conversations_are_as_many_as_the_codebook_says() -> None:
    lines = (FOLDER / "chat.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(lines) == ENTRIES["chat"]["rows"] == len(pl.read_ndjson(FOLDER / "lines.jsonl"))
    assert all(json.loads(line)["messages"] for line in lines)


def test_files_are_small_and_as_they_were_made() -> None:
    for name, sums in TOLD["files"].items():
        assert hashlib.sha256((FOLDER / name).read_bytes()).hexdigest() == sums["sha256"]
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 1_000_000


def test_there_is_something_to_study() -> None:
    conditions = frame("labels").filter(name="condition")["value"].value_counts()
    assert dict(conditions.rows()) == {"together": 6, "alone": 6}
    seats = frame("seats")
    assert min(seats[name].sum() for name in ("acted", "idle", "away", "substituted", "lost")) > 0


def test_the_card_is_of_this_version() -> None:
    card = card_text(TOLD, read_json(FOLDER, CODEBOOK))
    assert card == (FOLDER / "README.md").read_text(encoding="utf-8")
    assert (FOLDER / "LICENSE").read_text() == (ROOT / "LICENSE").read_text()


@pytest.mark.slow
def test_datasets_loads_it(hub: Any) -> None:
    for table in EPISODE_TABLES:
        found = hub.load_dataset(str(FOLDER), table.name)["train"]
        assert len(found) == ENTRIES[table.name]["rows"]
    chat = hub.load_dataset("json", data_files=str(FOLDER / "chat.jsonl"))["train"]
    assert len(chat) == ENTRIES["chat"]["rows"]


@pytest.mark.slow
def test_the_program_makes_the_same_episode_again() -> None:
    program = script_module(ROOT / "tools/make_example_dataset.py")
    planner = AnytimePlanner(program.World(program.load_task(program.TASK)))
    streams = [program.record("alone", 0, program.LAST, planner) for _ in range(2)]
    assert streams[0] == streams[1]
    assert recording_of(streams[0], "example").verify().ok
