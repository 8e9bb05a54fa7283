"""Writing recordings and the rows of their episodes into a catalogue."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille_data.database import in_pieces, insert
from robotouille_data.recording_rows import Part, Searches, episode_id
from robotouille_data.schema import EPISODE_TABLES, EPISODES, MEASURES, RECORDINGS, SEATS


@dataclass(frozen=True, slots=True)
class Stamp:
    """Size and modification time of a file. Equal stamps mean an unchanged file."""

    size: int
    mtime_ns: int


@dataclass(frozen=True, slots=True)
class ReadFile:
    """Recording with the rows of its episode, or with the fault that prevented reading.

    `size`: bytes of memory that its first parts take at most.
    """

    path: str
    stamp: Stamp
    digest: str
    fault: str = ""
    parts: Iterable[Part] = ()
    size: int = 0


def known_files(connection: Connection, folder: str) -> dict[str, Stamp]:
    """Return the files below a folder that are in the catalogue."""
    columns = RECORDINGS.c.path, RECORDINGS.c.size, RECORDINGS.c.mtime_ns
    below = RECORDINGS.c.path.startswith(folder.rstrip("/") + "/", autoescape=True)
    found = connection.execute(sa.select(*columns).where(below))
    return {path: Stamp(size, mtime_ns) for path, size, mtime_ns in found}


def lacking_measures(connection: Connection, searches: Searches) -> set[str]:
    """Return the files of episodes for which a search was not made."""
    its, found = MEASURES.c, set[str]()
    failed = (its.success == sa.false()) & its.out_of_reach.is_(None)
    for asked, table, lacks in (
        (searches.steps_to_go, MEASURES, failed),
        (searches.useful, SEATS, SEATS.c.unused.is_(None)),
    ):
        joined = RECORDINGS.join(table, table.c.episode_id == RECORDINGS.c.episode_id)
        if asked:
            query = sa.select(RECORDINGS.c.path).select_from(joined).where(lacks)
            found.update(connection.scalars(query))
    return found


def forget(connection: Connection, paths: Collection[str]) -> None:
    """Delete recordings, and the episodes without any other recording."""
    mine = RECORDINGS.c.episode_id
    orphans = {
        number
        for (number,) in _matching(connection, sa.select(mine), RECORDINGS.c.path, paths)
        if number is not None
    }
    # An episode remains as long as any copy of its recording does.
    for some in in_pieces(paths):
        connection.execute(sa.delete(RECORDINGS).where(RECORDINGS.c.path.in_(some)))
    orphans -= {number for (number,) in _matching(connection, sa.select(mine), mine, orphans)}
    for some in in_pieces(orphans):
        for table in EPISODE_TABLES:
            key = table.c.id if table is EPISODES else table.c.episode_id
            connection.execute(sa.delete(table).where(key.in_(some)))


def store(connection: Connection, files: Sequence[ReadFile]) -> None:
    """Write recordings, replacing earlier rows of their files.

    Raises:
        RecordingError: A long recording is damaged further on. The caller must roll back.
    """
    # Deleting first makes indexing idempotent: a changed file replaces its old rows.
    forget(connection, [file.path for file in files])
    ids = {file.path: None if file.fault else episode_id(file.digest) for file in files}
    rows = [(f.path, f.stamp.size, f.stamp.mtime_ns, f.digest, ids[f.path], f.fault) for f in files]
    insert(connection, RECORDINGS, rows)
    # Copies of a recording have the same id and are stored once.
    present = {
        number
        for (number,) in _matching(
            connection,
            sa.select(EPISODES.c.id),
            EPISODES.c.id,
            [number for number in ids.values() if number is not None],
        )
    }
    gathered: dict[sa.Table, list[Any]] = {}
    for file in files:
        number = ids[file.path]
        if number is None or number in present:
            continue
        present.add(number)
        for place, part in enumerate(file.parts):
            if place:  # A long recording: write these rows before reading more.
                _insert_all(connection, gathered)
            for table, more in part.tables:
                gathered.setdefault(table, []).extend(more)
    _insert_all(connection, gathered)


def _insert_all(connection: Connection, gathered: dict[sa.Table, list[Any]]) -> None:
    for table, rows in gathered.items():
        insert(connection, table, rows)
    gathered.clear()


def _matching(
    connection: Connection, query: sa.Select[Any], column: sa.Column[Any], values: Collection[Any]
) -> Iterator[sa.Row[Any]]:
    """Yield the rows whose column has one of the values."""
    for some in in_pieces(values):
        yield from connection.execute(query.where(column.in_(some))).all()
