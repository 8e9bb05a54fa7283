"""Indexing recordings into both kinds of database."""

from __future__ import annotations

import multiprocessing
import os
import resource
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

import sqlalchemy as sa

from robotouille.planning.plan import Limits
from robotouille.planning.steps_to_go import StepsToGo
from robotouille.replay import read_recording
from robotouille.replay.compression import compress
from robotouille.replay.container import MAGIC, MAX_FILE, pack_frame, read_frames
from robotouille_data import indexing
from robotouille_data import recording_rows as reading
from robotouille_data.database import (
    CatalogueError,
    UnavailableError,
    database_url,
    writing_engine,
)
from robotouille_data.indexing import IndexResult, index
from robotouille_data.query import asking
from robotouille_data.recording_rows import Searches
from robotouille_data.schema import METADATA
from tests.support.postgresql import PostgreSQL
from tests.support.random_play import random_stream, write_recordings

Dump = dict[str, list[tuple[Any, ...]]]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    found = tmp_path / "recordings"
    write_recordings(found, 6)
    return found


def dump(database: str) -> Dump:
    """Return all rows of all tables in a fixed order."""
    engine, found = writing_engine(database_url(database, Path())), Dump()
    with engine.connect() as connection:
        for table in METADATA.sorted_tables:
            rows = [tuple(row) for row in connection.execute(sa.select(table))]
            found[table.name] = sorted(rows, key=repr)
    return found


def indexed(database: str, folder: Path, **options: Any) -> IndexResult:
    return index(database_url(database, folder), [folder], **options)


def ask(database: str, query: str) -> list[tuple[Any, ...]]:
    with asking(database_url(database, Path()), query) as answer:
        return [tuple(row) for row in answer.rows]


def test_incremental_indexing_gives_the_same_rows_as_a_new_catalogue(
    database: str, folder: Path, tmp_path: Path
) -> None:
    """Files are added, changed, copied and deleted."""
    other = str(tmp_path / "other.sqlite")
    (folder / "random6.rbt.part").write_bytes(random_stream(6)[:-30])
    assert indexed(database, folder) == IndexResult(indexed=6, unfinished=1)
    assert indexed(database, folder) == IndexResult(unchanged=6, unfinished=1)
    write_recordings(folder / "below", 3, first=7)
    (folder / "random0.rbt").unlink()
    (folder / "random1.rbt").write_bytes(compress(random_stream(20)))
    (folder / "copy.rbt").write_bytes((folder / "random2.rbt").read_bytes())
    (folder / "random2.rbt").unlink()
    (folder / "random3.rbt").write_bytes(b"no recording")
    (folder / "link.rbt").symlink_to(folder / "random4.rbt")
    report = indexed(database, folder)
    assert (report.indexed, report.unchanged, report.removed) == (5, 2, 2)
    assert list(report.faults) == [str(folder / "random3.rbt")]
    indexed(other, folder)
    assert dump(database) == dump(other)
    indexed(database, folder, reindex=True)
    assert dump(database) == dump(other)
    assert ask(database, "SELECT count(*) FROM episodes") == [(7,)]


def test_unfinished_recordings_are_indexed_on_request(database: str, folder: Path) -> None:
    stream = random_stream(6)
    part = folder / "random6.rbt.part"
    part.write_bytes(stream[:-30])
    assert indexed(database, folder, unfinished=True).indexed == 7
    query = "SELECT state, count(*) FROM episodes GROUP BY state ORDER BY state"
    assert ask(database, query) == [("ended", 6), ("unfinished", 1)]
    part.write_bytes(stream[:-20])
    assert indexed(database, folder) == IndexResult(indexed=1, unchanged=6)
    (folder / "random6.rbt").write_bytes(compress(stream))
    assert indexed(database, folder, unfinished=True) == IndexResult(
        indexed=1, unchanged=6, removed=1
    )
    part.unlink()
    assert ask(database, query) == [("ended", 7)]


@pytest.mark.slow
@pytest.mark.process
def test_two_processes_give_the_same_rows(
    database: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The files include damaged ones, whose faults must be equal, too."""
    write_recordings(folder / "below", 3, first=7)
    (folder / "random3.rbt").write_bytes(b"no recording")
    stream = bytearray(random_stream(10))
    stream[-10] ^= 1
    (folder / "below/random10.rbt.part").write_bytes(stream)
    other, received = str(tmp_path / "other.sqlite"), list[tuple[int, int]]()
    alone = indexed(other, folder, unfinished=True)
    monkeypatch.setattr(indexing, "FILES_AT_ONCE", 2)
    both = indexed(
        database, folder, unfinished=True, jobs=2, progress=lambda *done: received.append(done)
    )
    assert both == alone
    assert (both.indexed, len(both.faults)) == (8, 2)
    assert received[0] == (0, 10)
    assert received[-1] == (10, 10)
    assert len(received) == 6
    assert dump(database) == dump(other)


@pytest.mark.slow
@pytest.mark.process
def test_two_indexers_at_once(database: str, folder: Path, tmp_path: Path) -> None:
    other = str(tmp_path / "other.sqlite")
    indexed(other, folder)
    spawn = multiprocessing.get_context("spawn")
    both = [spawn.Process(target=indexed, args=(database, folder)) for _ in range(2)]
    for process in both:
        process.start()
    for process in both:
        process.join()
    assert [process.exitcode for process in both] == [0, 0]
    assert dump(database) == dump(other)


@pytest.mark.slow
def test_late_damage_leaves_no_rows(
    database: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first rows of a long recording are written before its end is read."""
    monkeypatch.setattr(reading, "MAX_ROWS", 10)
    stream = bytearray(random_stream(9))
    stream[-10] ^= 1
    (folder / "random9.rbt.part").write_bytes(stream)
    report = indexed(database, folder, unfinished=True)
    assert report.indexed == 6
    assert "checksum" in report.faults[str(folder / "random9.rbt.part")]
    assert ask(database, "SELECT count(*) FROM episodes") == [(6,)]
    assert ask(database, "SELECT count(DISTINCT episode_id) FROM steps") == [(6,)]
    assert indexed(database, folder, unfinished=True).unchanged == 7


@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), 2**64 - 1, -1.5])
def test_number_out_of_range_is_a_fault_of_its_recording_only(
    database: str, folder: Path, seconds: float
) -> None:
    frames = list(read_frames(random_stream(7)))
    frames[-1]["outcome"]["seconds"] = seconds
    strange = folder / "strange.rbt.part"
    strange.write_bytes(MAGIC + b"".join(map(pack_frame, frames)))
    report = indexed(database, folder, unfinished=True)
    assert report.indexed + len(report.faults) == 7
    assert ask(database, "SELECT count(*) FROM episodes") == [(report.indexed,)]
    assert indexed(database, folder, unfinished=True).unchanged == 7


@pytest.mark.slow
def test_small_files_that_expand_are_not_held_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = list(map(pack_frame, read_frames(random_stream(0))))
    noted = {"note": "noted", "t": 0, "player": "robot1", "topic": "x"}
    for number in range(6):
        notes = {"kind": "notes", "notes": [{**noted, "text": f"{number}" + "x" * 400_000}] * 8}
        stream = MAGIC + b"".join([*frames[:-1], *[pack_frame(notes)] * 5, frames[-1]])
        (tmp_path / f"large{number}.rbt").write_bytes(compress(stream))
    monkeypatch.setattr(indexing, "MAX_HELD_BYTES", 1024 * 1024)
    # A buffer of this size is reserved for each file, and only its used part takes memory.
    monkeypatch.setattr(reading, "MAX_FILE", 1024 * 1024)
    tracemalloc.start()
    try:
        report = indexed(str(tmp_path / "c.sqlite"), tmp_path, jobs=1)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert report == IndexResult(indexed=6)
    assert most < 3 * len(stream)


@pytest.mark.slow
def test_small_files_of_many_rows_are_not_held_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = list(read_frames(random_stream(0)))
    first = next(place for place, frame in enumerate(frames) if frame["kind"] == "step")
    steps = [{"kind": "step", "step": n, "t": n, "moves": []} for n in range(1, 2001)]
    frames[-1]["outcome"]["steps"] = len(steps)
    for number in range(5):
        folder = tmp_path / ("many" if number else "one")
        folder.mkdir(exist_ok=True)
        frames[0]["episode"] = f"e{number}"
        stream = MAGIC + b"".join(map(pack_frame, [*frames[:first], *steps, frames[-1]]))
        (folder / f"{number}.rbt").write_bytes(compress(stream))
    monkeypatch.setattr(indexing, "MAX_HELD_BYTES", 1024 * 1024, raising=False)
    monkeypatch.setattr(reading, "MAX_FILE", 1024 * 1024)
    indexed(str(tmp_path / "imports.sqlite"), tmp_path / "one", jobs=1)
    most = {}
    for name, count in (("one", 1), ("many", 4)):
        tracemalloc.start()
        try:
            report = indexed(str(tmp_path / f"{name}.sqlite"), tmp_path / name, jobs=1)
            _, most[name] = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        assert report == IndexResult(indexed=count)
    assert most["many"] < 2 * most["one"]


@pytest.mark.skipif(sys.platform != "linux", reason="file names are text elsewhere")
def test_file_name_that_is_not_utf8_is_a_fault(database: str, folder: Path) -> None:
    strange = os.fsdecode(os.fsencode(folder) + b"/\xff.rbt")
    Path(strange).write_bytes((folder / "random0.rbt").read_bytes())
    assert indexed(database, folder) == IndexResult(
        indexed=6, faults={strange: "the name is not UTF-8, so a database cannot store it"}
    )


@pytest.mark.slow
def test_oversized_file_is_not_read_into_memory(folder: Path, tmp_path: Path) -> None:
    huge = folder / "huge.rbt"
    with huge.open("wb") as file:
        file.truncate(1024**3)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    report = indexed(str(tmp_path / "c.sqlite"), folder)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    assert "larger than" in report.faults[str(huge)]
    assert grown < 1.5 * MAX_FILE


def test_missing_folder_is_an_error_and_removes_nothing(database: str, folder: Path) -> None:
    indexed(database, folder)
    folder.rename(folder.with_name("away"))
    with pytest.raises(UnavailableError, match="recordings"):
        indexed(database, folder)
    folder.with_name("away").rename(folder)
    assert indexed(database, folder) == IndexResult(unchanged=6)


def test_chat_with_control_characters_is_stored(database: str, folder: Path) -> None:
    indexed(database, folder)
    said = {text for (text,) in ask(database, "SELECT text FROM events WHERE kind = 'said'")}
    assert said == {"hello", "\x1b[2J", "=1+1", "\ufffd"}


@pytest.mark.slow
def test_full_disk_is_an_error_and_keeps_the_catalogue(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    database = str(tmp_path / "c.sqlite")
    indexed(database, folder)
    before = dump(database)
    write_recordings(folder, 10, first=100)

    def limited(url: str) -> sa.Engine:
        engine = writing_engine(sa.make_url(url))
        # SQLite reports this limit like a full disk.
        sa.event.listen(engine, "connect", lambda c, _: c.execute("PRAGMA max_page_count=1"))
        return engine

    monkeypatch.setattr(indexing, "_engine", limited)
    with pytest.raises(UnavailableError, match="full"):
        indexed(database, folder)
    assert dump(database) == before
    monkeypatch.undo()
    assert indexed(database, folder) == IndexResult(indexed=10, unchanged=6)


def test_unwritable_database_is_an_error_without_the_password(folder: Path, tmp_path: Path) -> None:
    database = tmp_path / "c.sqlite"
    database.mkdir()
    with pytest.raises(UnavailableError, match=r"c\.sqlite"):
        indexed(str(database), folder)
    gone = "postgresql://nobody:secret@/x?host=/nowhere"
    with pytest.raises(UnavailableError) as received:
        indexed(gone, folder)
    assert "secret" not in str(received.value)
    with pytest.raises(UnavailableError) as received:
        indexed("postgresql:///x?host=/nowhere&user=nobody&password=secret", folder)
    assert "secret" not in str(received.value)


@pytest.mark.process
def test_read_only_database_is_an_error(server: PostgreSQL, folder: Path) -> None:
    options = "options=-c%20default_transaction_read_only%3Don"
    with pytest.raises(UnavailableError, match="read-only"):
        indexed(f"{server.url}&{options}", folder)


@pytest.mark.parametrize("database_name", ["mysql://x/y", "://", "oracle://"])
def test_other_databases_are_refused(database_name: str) -> None:
    with pytest.raises(CatalogueError):
        database_url(database_name, Path())


@pytest.mark.slow
def test_steps_to_go_can_be_computed_later(database: str, folder: Path, tmp_path: Path) -> None:
    for number in range(3, 6):
        (folder / f"random{number}.rbt").unlink()
    query = """SELECT e.episode, m.success, m.steps_to_go_least, m.steps_to_go_most, m.out_of_reach
               FROM measures m JOIN episodes e ON e.id = m.episode_id ORDER BY e.episode"""
    other = str(tmp_path / "other.sqlite")
    indexed(database, folder)
    assert {row[2:] for row in ask(database, query)} == {(None, None, None)}
    to_go = Searches(steps_to_go=True, useful=True)
    assert indexed(database, folder, searches=to_go) == IndexResult(indexed=3)
    assert indexed(database, folder, searches=to_go) == IndexResult(unchanged=3)
    indexed(other, folder, searches=to_go)
    assert dump(database) == dump(other)
    for episode, success, least, most, dead in ask(database, query)[:2]:
        assert not success
        *_, (_, last) = read_recording(folder / f"{episode}.rbt").states()
        left = StepsToGo(last.world)(last, Limits(expansions=500))
        assert bool(dead) == left.dead
        assert least <= (left.steps or least)
        assert most is None or most >= left.bound
