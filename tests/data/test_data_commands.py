"""`robotouille data …` on the command line."""

from __future__ import annotations

import builtins
import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille_client.cli.main import app
from tests.support.random_play import write_recordings


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = tmp_path / "recordings"
    write_recordings(found, 3)
    return found


def run(*arguments: str | Path) -> Any:
    return CliRunner().invoke(app, ["data", *map(str, arguments)])


def test_index_then_sql(folder: Path) -> None:
    (folder / "broken.rbt").write_bytes(b"\x1b[2J no recording")
    (folder / "open.rbt.part").write_bytes(b"")
    result = run("index", folder, "--jobs", "1")
    assert result.exit_code == 0, result.output
    assert "indexed 3, unchanged 0, forgotten 0" in result.stdout
    assert "1 without an end were left out" in result.stdout
    assert "broken.rbt: not a recording" in result.stderr
    out = folder / "out.json"
    query = "SELECT episode, count(*) AS n FROM steps JOIN episodes ON id = episode_id GROUP BY 1"
    result = run("sql", query, "--folder", folder)
    assert result.exit_code == 0
    assert result.stdout.splitlines()[0].split() == ["episode", "n"]
    assert len(result.stdout.splitlines()) == 5
    result = run("sql", query, "--folder", folder, "--json", out)
    assert result.stdout == f"{out}: 3 rows\n"
    assert {row["episode"] for row in json.loads(out.read_text())} == {
        "random0", "random1", "random2"
    }  # fmt: skip


def test_errors_are_a_line(folder: Path) -> None:
    for arguments in (
        ["sql", "SELECT 1", "--folder", folder],
        ["index", folder / "nowhere"],
        ["index", folder, "--database", "mysql://user:secret@host/name"],
        ["sql", "SELECT 1", "--database", "postgresql://user:secret@/x?host=/nowhere"],
    ):
        result = run(*arguments)
        assert result.exit_code == 1
        assert len(result.stderr.splitlines()) == 1
        assert "secret" not in result.output


def test_a_query_that_writes_is_refused(folder: Path) -> None:
    run("index", folder)
    result = run("sql", "DELETE FROM steps", "--folder", folder)
    assert (result.exit_code, result.stdout) == (1, "")


def test_a_missing_extra_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("robotouille_data.database"):
            raise ModuleNotFoundError("No module named 'sqlalchemy'", name="sqlalchemy")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    result = run("index", folder)
    assert result.exit_code == 1
    assert "robotouille[data]" in result.stderr
