"""Watching survives failures of the database and misses nothing."""

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

from robotouille.replay.compression import compress
from robotouille_data import indexing as watching
from robotouille_data.database import CatalogueError, database_url
from robotouille_data.indexing import IndexResult, index, watch
from robotouille_data.query import reading
from robotouille_data.schema import METADATA
from tests.support.postgresql import missing, postgresql
from tests.support.random_play import random_stream, write_recordings

PATIENCE = 60.0
Reports = Queue[IndexResult | str]


@contextmanager
def watched(database: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Reports]:
    """Watch a folder in a thread, and yield the queue of reports."""
    monkeypatch.setattr(watching, "MAX_PAUSE", 0.05)
    reports: Reports = Queue()
    stop = threading.Event()

    def run() -> None:
        url = database_url(database, folder)
        watch(url, [folder], stop, interval=0.02, report=reports.put,
              trouble=lambda words, _: reports.put(words))  # fmt: skip

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield reports
    finally:
        stop.set()
        thread.join(PATIENCE)
        assert not thread.is_alive()


def until_known(reports: Reports, count: int) -> None:
    """Wait until the catalogue has `count` recordings."""
    while True:
        found = reports.get(timeout=PATIENCE)
        if isinstance(found, IndexResult) and found.indexed + found.unchanged == count:
            return


def until_trouble(reports: Reports) -> str:
    while True:
        found = reports.get(timeout=PATIENCE)
        if isinstance(found, str):
            return found


def test_watch_indexes_new_recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, database = tmp_path / "recordings", str(tmp_path / "c.sqlite")
    write_recordings(folder, 2)
    with watched(database, folder, monkeypatch) as reports:
        until_known(reports, 2)
        write_recordings(folder, 2, first=2)
        until_known(reports, 4)


def test_watch_waits_for_a_missing_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, database = tmp_path / "recordings", str(tmp_path / "c.sqlite")
    write_recordings(folder, 2)
    with watched(database, folder, monkeypatch) as reports:
        until_known(reports, 2)
        folder.rename(tmp_path / "away")
        assert "recordings" in until_trouble(reports)
        (tmp_path / "away").rename(folder)
        until_known(reports, 2)


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_watch_misses_nothing_while_the_database_is_down(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The database is stopped from recording 5 to 10 and down from recording 15 to 35."""
    pytest.importorskip("psycopg", reason="needs the extra `data`")
    folder = tmp_path / "recordings"
    folder.mkdir()
    with postgresql() as server, watched(server.url, folder, monkeypatch) as reports:
        for number in range(50):
            if number == 5:
                server.send_signal(signal.SIGSTOP)
            if number == 10:
                server.send_signal(signal.SIGCONT)
            if number == 15:
                until_known(reports, number)
                server.kill()
            if number == 16:
                assert until_trouble(reports)
            if number == 35:
                server.start()
            finish_recording(folder, number)
        until_known(reports, 50)
        url = database_url(server.url, folder)
        assert index(url, [folder]) == IndexResult(unchanged=50)
        other = database_url(str(tmp_path / "other.sqlite"), folder)
        index(other, [folder])
        for table in METADATA.sorted_tables:
            assert rows_of(url, table) == rows_of(other, table)


def finish_recording(folder: Path, number: int) -> None:
    """Write a recording in the way a server does."""
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


def test_watch_raises_errors_that_a_retry_cannot_fix(tmp_path: Path) -> None:
    database = tmp_path / "c.sqlite"
    database.write_text("this is something else than a database, and long enough" * 20)
    with pytest.raises(CatalogueError, match="not a database"):
        watch(
            database_url(str(database), tmp_path), [tmp_path], threading.Event(),
            report=lambda _: None, trouble=lambda words, _: None,
        )  # fmt: skip


@pytest.mark.process
def test_watch_command_ends_on_sigterm(tmp_path: Path) -> None:
    write_recordings(tmp_path, 2)
    program = "from robotouille_client.cli.main import main; main()"
    command = [sys.executable, "-c", program, "data", "watch", str(tmp_path), "--interval", "60"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "indexed 2, removed 0\n"
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
