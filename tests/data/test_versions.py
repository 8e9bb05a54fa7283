"""Migrations create the schema, upgrade older catalogues and refuse newer ones."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")

from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext

from robotouille_data.database import (
    MIGRATIONS,
    CatalogueError,
    check_version,
    database_url,
    migrate,
    writing_engine,
)
from robotouille_data.schema import METADATA

LATER = """
import sqlalchemy as sa
from alembic import op

revision = "later"
down_revision = "0002"

def upgrade():
    op.add_column("episodes", sa.Column("later", sa.Text()))
"""


def later_version(folder: Path) -> Path:
    """Copy the migrations, with one more."""
    copied = folder / "migrations"
    shutil.copytree(MIGRATIONS, copied, ignore=shutil.ignore_patterns("__pycache__"))
    (copied / "later.py").write_text(LATER)
    return copied


def test_migrations_create_the_tables_of_the_schema(database: str) -> None:
    engine = writing_engine(database_url(database, Path()))
    with engine.connect() as connection, pytest.raises(CatalogueError, match="missing"):
        check_version(connection)
    with engine.begin() as connection:
        migrate(connection)
    with engine.connect() as connection:
        check_version(connection)
        assert compare_metadata(MigrationContext.configure(connection), METADATA) == []


def test_earlier_version_is_migrated_and_later_version_refused(
    database: str, tmp_path: Path
) -> None:
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


def test_catalogue_without_scores_keeps_its_rows(database: str, tmp_path: Path) -> None:
    first, engine = tmp_path / "first", writing_engine(database_url(database, Path()))
    shutil.copytree(MIGRATIONS, first, ignore=shutil.ignore_patterns("__pycache__", "v0002*"))
    with engine.begin() as connection:
        migrate(connection, first)
        connection.exec_driver_sql(
            "INSERT INTO measures (episode_id, repeated_transitions, blocking) VALUES (7, 2, 1)"
        )
    with engine.begin() as connection:
        migrate(connection)
    with engine.connect() as connection:
        rows = connection.exec_driver_sql("SELECT episode_id, blocking, score FROM measures")
        assert rows.all() == [(7, 1, None)]
        assert connection.exec_driver_sql("SELECT score FROM episode_seats").all() == []


def test_failed_migration_is_rolled_back(database: str, tmp_path: Path) -> None:
    later, engine = later_version(tmp_path), writing_engine(database_url(database, Path()))
    (later / "later.py").write_text(
        LATER + '    op.add_column("nowhere", sa.Column("x", sa.Text()))\n'
    )
    with pytest.raises(Exception, match="nowhere"), engine.begin() as connection:
        migrate(connection, later)
    with engine.begin() as connection:
        migrate(connection)
        assert compare_metadata(MigrationContext.configure(connection), METADATA) == []
