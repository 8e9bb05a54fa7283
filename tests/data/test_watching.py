"""Watching goes on whatever becomes of the database, and nothing is missing afterwards."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Queue

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from robotouille_data import watching
from robotouille_data.database import database_url
from robotouille_data.errors import CatalogueError
from robotouille_data.indexing import Report, index
from robotouille_data.watching import watch
from tests.support.postgresql import missing, postgresql
from tests.support.random_play import write_recordings

PATIENCE = 60.0
Told = Queue[Report | str]


@contextmanager
def watched(database: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Told]:
    """What is told while a folder is watched."""
    monkeypatch.setattr(watching, "MAX_PAUSE", 0.05)
    told: Told = Queue()
    stop = threading.Event()

    def run() -> None:
        url = database_url(database, folder)
        watch(url, [folder], stop, interval=0.02, report=told.put,
              trouble=lambda words, _: told.put(words))  # fmt: skip

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield told
    finally:
        stop.set()
        thread.join(PATIENCE)
        assert not thread.is_alive()


def until_known(told: Told, count: int) -> None:
    """Wait until the catalogue has so many recordings."""
    while True:
        found = told.get(timeout=PATIENCE)
        if isinstance(found, Report) and found.indexed + found.unchanged == count:
            return


def until_trouble(told: Told) -> str:
    while True:
        found = told.get(timeout=PATIENCE)
        if isinstance(found, str):
            return found


def test_what_is_finished_later_is_indexed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, database = tmp_path / "recordings", str(tmp_path / "c.sqlite")
    write_recordings(folder, 2)
    with watched(database, folder, monkeypatch) as told:
        until_known(told, 2)
        write_recordings(folder, 2, first=2)
        until_known(told, 4)


def test_a_folder_that_is_away_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, database = tmp_path / "recordings", str(tmp_path / "c.sqlite")
    write_recordings(folder, 2)
    with watched(database, folder, monkeypatch) as told:
        until_known(told, 2)
        folder.rename(tmp_path / "away")
        assert "recordings" in until_trouble(told)
        (tmp_path / "away").rename(folder)
        until_known(told, 2)


@pytest.mark.process
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_a_database_that_is_killed_and_comes_back_lacks_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("psycopg", reason="needs the extra `data`")
    folder = tmp_path / "recordings"
    write_recordings(folder, 2)
    with postgresql() as server, watched(server.url, folder, monkeypatch) as told:
        until_known(told, 2)
        server.stop()
        write_recordings(folder, 3, first=2)
        assert until_trouble(told)
        server.start()
        until_known(told, 5)
        found = index(database_url(server.url, folder), [folder])
        assert found == Report(unchanged=5)


def test_what_waiting_does_not_mend_is_an_error(tmp_path: Path) -> None:
    database = tmp_path / "c.sqlite"
    database.write_text("this is something else than a database, and long enough" * 20)
    with pytest.raises(CatalogueError, match="not a database"):
        watch(
            database_url(str(database), tmp_path), [tmp_path], threading.Event(),
            report=lambda _: None, trouble=lambda words, _: None,
        )  # fmt: skip


@pytest.mark.process
def test_the_command_ends_when_it_is_told_to(tmp_path: Path) -> None:
    write_recordings(tmp_path, 2)
    program = "from robotouille_client.cli.main import main; main()"
    command = [sys.executable, "-c", program, "data", "watch", str(tmp_path), "--interval", "60"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "indexed 2, forgotten 0\n"
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
