"""`robotouille data export` and `card` on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("pyarrow", reason="needs the extra `data`")

import polars as pl

from robotouille_client.cli.main import app
from robotouille_data.database import database_url
from robotouille_data.exports.exporting import export
from robotouille_data.exports.request import ExportFormat, ExportRequest
from robotouille_data.indexing import index
from tests.support.random_study import manifest, write_random_study


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = tmp_path / "recordings"
    write_random_study(found)
    return found


def run(*arguments: str | Path) -> Any:
    return CliRunner().invoke(app, ["data", *map(str, arguments)])


def test_export_indexes_first(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run(
        *("export", out, "--folder", folder, "--label", "condition=a", "--consent", "consent=yes"),
        *("--split", "train=2,test=1", "--no-names", "--title", "Pairs", "--license", "CC0-1.0"),
    )
    assert result.exit_code == 0, result.output
    assert result.stderr == "indexed 8, removed 0\n"
    assert result.stdout.splitlines() == [
        "left out: 4 by label, 1 by consent",
        f"{out}: 3 episodes (train 2, test 1)",
    ]
    assert len(pl.read_parquet(out / "train" / "episodes.parquet")) == 2
    assert manifest(out)["about"]["title"] == "Pairs"


def test_errors_are_one_line_and_nothing_is_written(folder: Path, tmp_path: Path) -> None:
    run("index", folder)
    full = tmp_path / "full"
    full.mkdir()
    (full / "x").touch()
    out = tmp_path / "out"
    for arguments in (
        [full, "--folder", folder],
        [out, "--folder", tmp_path / "nowhere"],
        [out, "--database", tmp_path / "nothing.sqlite"],
        [out, "--folder", folder, "--format", "excel"],
        [out, "--folder", folder, "--label", "condition"],
        [out, "--folder", folder, "--split", "train=much"],
        [out, "--folder", folder, "--split", "../x=1"],
        [out, "--folder", folder, "--license", "free for all"],
        [out, "--folder", folder, "--license", "CCBY"],
        [out, "--folder", folder, "--split", "train=0.9,test=0.2"],
        [out, "--folder", folder, "--query", "SELECT 1"],
    ):
        result = run("export", *arguments)
        assert result.exit_code == 1, arguments
        assert len(result.stderr.splitlines()) == 1, result.stderr
        assert not out.exists()


def test_damaged_recordings_are_reported_and_left_out(folder: Path, tmp_path: Path) -> None:
    path = folder / "random1.rbt"
    path.write_bytes(path.read_bytes()[:200])
    result = run("export", tmp_path / "out", "--folder", folder, "--format", "chat")
    assert result.exit_code == 0, result.output
    assert "random1.rbt: " in result.stderr
    assert manifest(tmp_path / "out")["episodes"] == 7


@pytest.mark.slow
def test_card_command_prints_and_changes_the_card(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    run("export", out, "--folder", folder, "--format", "csv")
    assert "No licence was given" in run("card", out).stdout
    result = run("card", out, "--license", "CC0-1.0", "--contact", "lab@example.org")
    assert "CC0-1.0" in result.stdout
    assert (out / "LICENSE").exists()
    assert run("card", tmp_path).exit_code == 1


@pytest.mark.slow
def test_both_databases_give_equal_exports(database: str, folder: Path, tmp_path: Path) -> None:
    other, own = database_url(database, folder), database_url(None, folder)
    index(other, [folder])
    index(own, [folder])
    request = ExportRequest((ExportFormat.PARQUET,), names=False, split={"train": 1, "test": 1})
    export(own, tmp_path / "own", request)
    export(other, tmp_path / "other", request)
    assert manifest(tmp_path / "own") == manifest(tmp_path / "other")
