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

import sqlalchemy as sa
from sqlalchemy.engine import URL

from robotouille.replay.container import compress
from robotouille_data import watching
from robotouille_data.answers.query import reading
from robotouille_data.database import database_url
from robotouille_data.errors import CatalogueError
from robotouille_data.indexing import Indexed, index
from robotouille_data.schema import METADATA
from robotouille_data.watching import watch
from tests.support.postgresql import missing, postgresql
from tests.support.random_play import random_stream, write_recordings

PATIENCE = 60.0
Told = Queue[Indexed | str]


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
        if isinstance(found, Indexed) and found.indexed + found.unchanged == count:
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


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_a_database_that_is_stopped_killed_and_comes_back_lacks_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """50 episodes end one after the other; the server stands still from the 5th to the 10th, is
    killed behind the 15th, and started again behind the 35th."""
    pytest.importorskip("psycopg", reason="needs the extra `data`")
    folder = tmp_path / "recordings"
    folder.mkdir()
    with postgresql() as server, watched(server.url, folder, monkeypatch) as told:
        for number in range(50):
            if number == 5:
                server.send_signal(signal.SIGSTOP)
            if number == 10:
                server.send_signal(signal.SIGCONT)
            if number == 15:
                until_known(told, number)
                server.kill()
            if number == 16:
                assert until_trouble(told)
            if number == 35:
                server.start()
            finish_recording(folder, number)
        until_known(told, 50)
        url = database_url(server.url, folder)
        assert index(url, [folder]) == Indexed(unchanged=50)
        anew = database_url(str(tmp_path / "anew.sqlite"), folder)
        index(anew, [folder])
        for table in METADATA.sorted_tables:
            assert rows_of(url, table) == rows_of(anew, table)


def finish_recording(folder: Path, number: int) -> None:
    """A recording grows, and is closed, as a server does it."""
    stream = random_stream(number, steps=10)
    part = folder / f"random{number}.rbt.part"
    part.write_bytes(stream[: len(stream) // 2])
    part.write_bytes(stream)
    closing = folder / f"random{number}.closing"
    closing.write_bytes(compress(stream))
    closing.rename(folder / f"random{number}.rbt")
    part.unlink()


def rows_of(url: URL, table: sa.Table) -> list[str]:
    with reading(url) as connection:
        return sorted(map(repr, connection.execute(sa.select(table))))


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
