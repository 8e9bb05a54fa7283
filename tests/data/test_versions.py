"""An older catalogue is migrated, a newer one is told, and migrations make what the schema says."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext

from robotouille_data.answers.query import reading
from robotouille_data.database import database_url, writing_engine
from robotouille_data.errors import CatalogueError
from robotouille_data.indexing import Indexed, index
from robotouille_data.recordings.reading import content_digest, episode_id, recorded_rows
from robotouille_data.schema import MEASURES, METADATA, SEATS
from robotouille_data.store import ReadFile, Stamp, store
from robotouille_data.versions import MIGRATIONS, check_version, migrate
from tests.support.random_play import write_recordings

LATER = """
import sqlalchemy as sa
from alembic import op

revision = "later"
down_revision = "0004"

def upgrade():
    op.add_column("episodes", sa.Column("later", sa.Text()))
"""


def later_version(folder: Path) -> Path:
    """The migrations, with one that is still to come."""
    copied = folder / "migrations"
    shutil.copytree(MIGRATIONS, copied, ignore=shutil.ignore_patterns("__pycache__"))
    (copied / "later.py").write_text(LATER)
    return copied


def test_migrations_make_the_tables_of_the_schema(database: str) -> None:
    engine = writing_engine(database_url(database, Path()))
    with engine.begin() as connection:
        migrate(connection)
    with engine.connect() as connection:
        check_version(connection)
        assert compare_metadata(MigrationContext.configure(connection), METADATA) == []


def test_an_earlier_version_is_migrated_and_a_later_one_told(database: str, tmp_path: Path) -> None:
    later, engine = later_version(tmp_path), writing_engine(database_url(database, Path()))
    with engine.begin() as connection:
        migrate(connection)
    with engine.connect() as connection, pytest.raises(CatalogueError, match="earlier version"):
        check_version(connection, later)
    with engine.begin() as connection:
        migrate(connection, later)
        connection.exec_driver_sql("SELECT later FROM episodes")
    with engine.connect() as connection, pytest.raises(CatalogueError, match="later version"):
        check_version(connection)
    with pytest.raises(CatalogueError, match="later version"), engine.begin() as connection:
        migrate(connection)


def test_rows_of_the_first_version_are_there_in_the_present_one(
    database: str, tmp_path: Path
) -> None:
    first = tmp_path / "first"
    first.mkdir()
    shutil.copy(MIGRATIONS / "v0001_tables.py", first)
    folder, url = tmp_path / "recordings", database_url(database, tmp_path)
    write_recordings(folder, 3)
    with writing_engine(url).begin() as connection:
        migrate(connection, first)
        store(connection, [read_file(path) for path in sorted(folder.glob("*.rbt"))[:2]])
    assert index(url, [folder]) == Indexed(indexed=1, unchanged=2)
    with reading(url) as connection:
        query = "SELECT count(*), count(DISTINCT episode_id), sum(steps) FROM episode_seats"
        count, episodes, steps = connection.exec_driver_sql(query).one()
        both = connection.exec_driver_sql("SELECT 2 * sum(steps) FROM episodes").scalar()
        left = connection.exec_driver_sql("SELECT steps_to_go_least FROM measures").all()
    assert (count, episodes, steps) == (6, 3, both)
    assert {each for (each,) in left} <= {0, None}


def read_file(path: Path) -> ReadFile:
    """A recording, with the rows that it had in the first version."""
    content, status = path.read_bytes(), path.stat()
    digest = content_digest(content)
    first = {
        table: sa.Table(table.name, sa.MetaData(), *(sa.Column(str(n)) for n in range(count)))
        for table, count in ((MEASURES, 6), (SEATS, 20))
    }
    parts = [
        [(old, [row[: len(old.columns)] for row in rows])
         for table, rows in part for old in [first.get(table, table)]]
        for part in recorded_rows(content, episode_id(digest))
    ]  # fmt: skip
    return ReadFile(str(path), Stamp(status.st_size, status.st_mtime_ns), digest, parts=parts)


def test_a_migration_that_fails_leaves_nothing_behind(database: str, tmp_path: Path) -> None:
    later, engine = later_version(tmp_path), writing_engine(database_url(database, Path()))
    (later / "later.py").write_text(
        LATER + '    op.add_column("nowhere", sa.Column("x", sa.Text()))\n'
    )
    with pytest.raises(Exception, match="nowhere"), engine.begin() as connection:
        migrate(connection, later)
    with engine.begin() as connection:
        migrate(connection)
        assert compare_metadata(MigrationContext.configure(connection), METADATA) == []


def test_what_is_no_catalogue_is_told(database: str) -> None:
    engine = writing_engine(database_url(database, Path()))
    with engine.connect() as connection, pytest.raises(CatalogueError, match="missing"):
        check_version(connection)
