"""`robotouille data …` on the command line."""

from __future__ import annotations

import builtins
import json
import os
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille_client.cli.main import app
from robotouille_data.report import page
from tests.support.random_play import write_recordings
from tests.support.samples import quick_sample


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = tmp_path / "recordings"
    write_recordings(found, 3)
    return found


def run(*arguments: str | Path) -> Any:
    return CliRunner().invoke(app, ["data", *map(str, arguments)])


def test_index_of_only_damaged_recordings_fails(tmp_path: Path) -> None:
    (tmp_path / "broken.rbt").write_bytes(b"no recording")
    result = run("index", tmp_path, "--jobs", "1")
    assert result.exit_code == 1
    assert "broken.rbt: not a recording" in result.stderr


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no devices")
def test_system_text_must_be_a_regular_file(folder: Path, tmp_path: Path) -> None:
    flags = ["--system", "/dev/zero", "--format", "chat", "--folder", folder]
    result = run("export", tmp_path / "out", *flags)
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1].endswith("/dev/zero: not a regular file")


def test_index_reports_faults_and_sql_reads_rows(folder: Path) -> None:
    (folder / "broken.rbt").write_bytes(b"\x1b[2J no recording")
    (folder / "open.rbt.part").write_bytes(b"")
    result = run("index", folder, "--jobs", "1")
    assert result.exit_code == 0, result.output
    assert "indexed 3, unchanged 0, removed 0" in result.stdout
    assert "1 unfinished recording left out" in result.stdout
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


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip drawing, which is slow."""
    monkeypatch.setattr(page, "all_figures", lambda groups: {})


@pytest.mark.usefixtures("without_figures")
@pytest.mark.parametrize("command", quick_sample(["sql", "report", "export"]))
def test_commands_index_new_recordings_first(command: str, folder: Path, tmp_path: Path) -> None:
    def answer(name: str) -> Any:
        if command == "sql":
            return run("sql", "SELECT count(*) AS n FROM episodes", "--folder", folder)
        out = ["--out", tmp_path / name] if command == "report" else [tmp_path / name]
        return run(command, *out, "--folder", folder)

    first = answer("first")
    assert (first.exit_code, first.stderr) == (0, "indexed 3, removed 0\n"), first.output
    assert "3" in first.stdout.replace(str(tmp_path), "")
    assert answer("again").stderr == ""
    write_recordings(folder, 1, first=50)
    next(folder.glob("*random0*.rbt")).unlink()
    (folder / "broken.rbt").write_bytes(b"no recording")
    received = answer("last").stderr.splitlines()
    assert "broken.rbt: not a recording" in received[0]
    assert received[1:] == ["indexed 1, removed 1"]
    assert answer("unchanged").stderr == ""


@pytest.mark.usefixtures("without_figures")
@pytest.mark.parametrize("command", ["sql", "report", "export"])
def test_database_option_uses_the_catalogue_unchanged(
    command: str, folder: Path, tmp_path: Path
) -> None:
    database = tmp_path / "own.sqlite"
    run("index", folder, "--database", database)
    write_recordings(folder, 1, first=50)
    arguments = {
        "sql": ["SELECT count(*) FROM episodes"],
        "report": ["--out", tmp_path / "page.html"],
        "export": [tmp_path / "out"],
    }[command]
    result = run(command, *arguments, "--database", database, "--folder", folder)
    assert (result.exit_code, result.stderr) == (0, "")
    assert "3" in result.stdout.replace(str(tmp_path), "")
    assert not (folder / "catalogue.sqlite").exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_catalogue_is_used_with_a_warning(folder: Path) -> None:
    run("index", folder)
    write_recordings(folder, 1, first=50)
    folder.chmod(0o500)
    result = run("sql", "SELECT count(*) AS n FROM episodes", "--folder", folder)
    folder.chmod(0o700)
    assert (result.exit_code, result.stdout.split()[-1]) == (0, "3")
    assert "catalogue not updated" in result.stderr


def test_folder_without_recordings_gets_no_catalogue(tmp_path: Path) -> None:
    result = run("sql", "SELECT 1", "--folder", tmp_path)
    assert (result.exit_code, "no recordings" in result.stderr) == (1, True)
    assert not list(tmp_path.iterdir())


def test_errors_are_one_line_without_passwords(folder: Path) -> None:
    (folder.parent / "empty").mkdir()
    for arguments in (
        ["sql", "SELECT 1", "--folder", folder / "nowhere"],
        ["sql", "SELECT 1", "--folder", folder.parent / "empty"],
        ["sql", "SELECT 1", "--database", folder / "nothing.sqlite"],
        ["index", folder / "nowhere"],
        ["index", folder, "--database", "mysql://user:secret@host/name"],
        ["sql", "SELECT 1", "--database", "postgresql://user:secret@/x?host=/nowhere"],
    ):
        result = run(*arguments)
        assert result.exit_code == 1
        assert len(result.stderr.splitlines()) == 1
        assert "secret" not in result.output


def test_missing_library_names_the_extra(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("robotouille_data.database"):
            raise ModuleNotFoundError("No module named 'sqlalchemy'", name="sqlalchemy")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    result = run("index", folder)
    assert result.exit_code == 1
    assert "robotouille[data]" in result.stderr
