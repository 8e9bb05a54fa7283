"""Which version of the schema a database has, and how it is brought to this one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from alembic.config import Config
from alembic.runtime.environment import EnvironmentContext
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy.engine import Connection

from robotouille_data.errors import CatalogueError

__all__ = ["MIGRATIONS", "catalogue_version", "check_version", "migrate"]

MIGRATIONS = Path(__file__).with_name("migrations")


def migrate(connection: Connection, folder: Path = MIGRATIONS) -> None:
    """Bring the database to this version, from nothing or from an earlier one.

    Raises:
        CatalogueError: It is of a later version of this software.
    """
    script = _script(folder)
    if _is_current(connection, script):
        return

    def upgrade(revision: Any, _: Any) -> Any:
        return script._upgrade_revs("head", revision)

    with EnvironmentContext(Config(), script, fn=upgrade) as environment:
        environment.configure(connection=connection, transactional_ddl=True)
        environment.run_migrations()


def check_version(connection: Connection, folder: Path = MIGRATIONS) -> None:
    """Nothing is done.

    Raises:
        CatalogueError: The database is of another version, or no catalogue.
    """
    if not _is_current(connection, _script(folder)):
        message = (
            "the catalogue is missing or of an earlier version: `robotouille data index FOLDER`"
            " mends it"
        )
        raise CatalogueError(message)


def catalogue_version(connection: Connection) -> str:
    """The version that a catalogue's tables have; empty: it has none."""
    return MigrationContext.configure(connection).get_current_revision() or ""


def _script(folder: Path) -> ScriptDirectory:
    return ScriptDirectory(str(MIGRATIONS), version_locations=[str(folder)])


def _is_current(connection: Connection, script: ScriptDirectory) -> bool:
    found = MigrationContext.configure(connection).get_current_revision()
    known = {each.revision for each in script.walk_revisions()}
    if found is not None and found not in known:
        raise CatalogueError(f"the catalogue is of a later version ({found}): update this software")
    return found == script.get_current_head()
