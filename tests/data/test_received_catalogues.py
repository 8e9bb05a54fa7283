"""Catalogues in folders from other people."""

from __future__ import annotations

import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille_client.cli.main import app
from robotouille_data import own_catalogues
from tests.support.random_play import write_recordings
from tests.support.samples import quick_sample

COUNT = "SELECT count(*) AS n FROM episodes"


def run(*arguments: str | Path) -> Any:
    return CliRunner().invoke(app, ["data", *map(str, arguments)])


def words(result: Any) -> str:
    return " ".join(result.output.split())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = tmp_path / "recordings"
    write_recordings(found, 2)
    assert run("index", found, "--jobs", "1").exit_code == 0
    return found


@pytest.fixture
def received(folder: Path, tmp_path: Path) -> Path:
    """Return a folder of another person, whose catalogue tells of three times as many steps."""
    with closing(sqlite3.connect(folder / "catalogue.sqlite")) as theirs:
        theirs.execute("UPDATE episodes SET steps = 3 * steps")
        theirs.commit()
    return shutil.copytree(folder, tmp_path / "received")


@pytest.mark.parametrize(
    "command",
    [("sql", COUNT, "--folder"), ("report", "--folder"), ("index",)],
    ids=lambda command: command[0],
)
def test_received_catalogue_is_refused(received: Path, command: tuple[str, ...]) -> None:
    result = run(*command, received)
    assert result.exit_code == 1
    assert "catalogue.sqlite: you have not made it on this computer" in words(result)


@pytest.mark.slow
def test_deleting_a_received_catalogue_indexes_again(received: Path) -> None:
    (received / "catalogue.sqlite").unlink()
    assert run("sql", COUNT, "--folder", received).exit_code == 0
    again = run("sql", COUNT, "--folder", received)
    assert (again.exit_code, again.stderr) == (0, "")


def test_received_catalogue_can_be_trusted_by_name(received: Path) -> None:
    result = run("sql", COUNT, "--database", received / "catalogue.sqlite")
    assert (result.exit_code, result.stdout.split()[-1]) == (0, "2")


def test_catalogue_of_another_database_program_is_not_ones_own(folder: Path) -> None:
    with closing(sqlite3.connect(folder / "catalogue.sqlite")) as connection:
        connection.execute("PRAGMA user_version=7")
    assert run("sql", COUNT, "--folder", folder).exit_code == 1


def test_only_the_newest_catalogues_are_remembered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(own_catalogues, "MAX_REMEMBERED", 3)
    paths = [tmp_path / f"{number}.sqlite" for number in range(5)]
    for path in paths:
        own_catalogues.create(path)
    assert own_catalogues.is_own(paths[-1])
    assert sum(map(own_catalogues.is_own, paths)) == 3


def test_catalogue_that_cannot_be_remembered_is_not_created(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "state").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    write_recordings(tmp_path / "recordings", 1)
    result = run("index", tmp_path / "recordings")
    assert result.exit_code == 1
    assert "state/robotouille/catalogues" in words(result).replace(" ", "")
    assert not (tmp_path / "recordings/catalogue.sqlite").exists()


@pytest.mark.parametrize("ending", quick_sample(["-wal", "-shm", "-journal"]))
def test_links_next_to_a_catalogue_are_refused(folder: Path, tmp_path: Path, ending: str) -> None:
    precious = tmp_path / "precious"
    precious.write_text("precious")
    (folder / f"catalogue.sqlite{ending}").unlink(missing_ok=True)
    (folder / f"catalogue.sqlite{ending}").symlink_to(precious)
    for command in (("index",), ("sql", COUNT, "--folder")):
        result = run(*command, folder)
        assert result.exit_code == 1
        assert "it is a symbolic link" in words(result)
    assert precious.read_text() == "precious"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
@pytest.mark.parametrize("ending", quick_sample(["-journal", "-wal", "-shm"]))
def test_named_pipes_next_to_a_catalogue_are_refused(folder: Path, ending: str) -> None:
    (folder / f"catalogue.sqlite{ending}").unlink(missing_ok=True)
    os.mkfifo(folder / f"catalogue.sqlite{ending}")
    for command in (("index",), ("sql", COUNT, "--folder")):
        result = run(*command, folder)
        assert result.exit_code == 1
        assert f"catalogue.sqlite{ending}: it is not a regular file" in words(result)


def test_files_of_a_missing_catalogue_are_not_read(folder: Path) -> None:
    (folder / "catalogue.sqlite").replace(folder / "catalogue.sqlite-wal")
    result = run("index", folder)
    assert result.exit_code == 1
    assert "catalogue.sqlite-wal: its database is missing" in words(result)


CHANGES = {
    "trigger": "CREATE TRIGGER more AFTER INSERT ON episodes BEGIN DELETE FROM seats; END",
    "view": "DROP VIEW episode_seats; CREATE VIEW episode_seats AS SELECT 1 AS success",
    "column": "ALTER TABLE measures ADD COLUMN twice AS (2 * score)",
}


@pytest.mark.parametrize("change", quick_sample(CHANGES.values()), ids=list(CHANGES))
def test_changed_schema_is_refused(received: Path, change: str) -> None:
    named = received / "catalogue.sqlite"
    with closing(sqlite3.connect(named)) as connection:
        connection.executescript(change)
    for command in (("sql", COUNT), ("index", received)):
        result = run(*command, "--database", named)
        assert result.exit_code == 1
        assert "is not as Robotouille makes it" in words(result)
