"""Databases of catalogues: SQLite files and PostgreSQL.

A writer holds the catalogue's only lock from the start of its transaction, so two indexers take
turns instead of failing.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import sqlalchemy as sa
from alembic.config import Config
from alembic.runtime.environment import EnvironmentContext
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import event, exc
from sqlalchemy.engine import URL, Connection, Engine, make_url
from sqlalchemy.pool import NullPool

from robotouille.errors import RobotouilleError
from robotouille.files.writing import LINK
from robotouille_data.own_catalogues import create, is_own


class CatalogueError(RobotouilleError):
    """Invalid catalogue, query or export."""


class UnavailableError(CatalogueError):
    """Database that is unreachable, full, locked or read-only. A retry may succeed."""


T = TypeVar("T")

DEFAULT_FILE = "catalogue.sqlite"
COMPANIONS = ("-wal", "-shm", "-journal")
"""Endings of the files that SQLite keeps next to a database."""
LOCK_SECONDS = 60
"""Time to wait for another writer."""
CONNECT_SECONDS = 10
MAX_VALUES = 500
"""Values in one `IN` list. SQLite limits the parameters of a statement."""
LOCK = 0x526F626F
"""Key of the advisory lock that writers hold in PostgreSQL (`Robo` in ASCII)."""


def database_url(database: str | None, folder: Path) -> URL:
    """Return the URL of a catalogue, given as a URL, as an SQLite file, or by its folder.

    Raises:
        CatalogueError: The URL is invalid or names another kind of database, or the folder's
            catalogue is a link or was not made here.
    """
    if database is None:
        database = str(folder / DEFAULT_FILE)
        _check_own(Path(database))
    if "://" not in database:
        return URL.create("sqlite", database=str(Path(database).absolute()))
    try:
        url = make_url(database)
    except exc.ArgumentError:
        raise CatalogueError("invalid database URL; expected postgresql://USER@HOST/NAME") from None
    match url.get_backend_name():
        case "sqlite":
            return url.set(drivername="sqlite")
        case "postgresql" | "postgres":
            return url.set(drivername="postgresql+psycopg")
    raise CatalogueError(f"{url.get_backend_name()} is not supported; use SQLite or PostgreSQL")


def _check_own(path: Path) -> None:
    """Raise CatalogueError if a folder's catalogue may be that of another person."""
    # A folder from other people could make the index change any database of the user.
    if path.is_symlink():
        raise CatalogueError(f"{path}: it is a symbolic link; name its file by --database")
    if path.exists() and not is_own(path):
        raise CatalogueError(
            f"{path}: you have not made it on this computer, or have moved it, so it may be wrong."
            " Delete it, and the recordings are indexed again. If you trust it, name it by"
            " --database"
        )


def _check_companions(path: Path) -> None:
    """Raise CatalogueError if files next to a database cannot be those of this database.

    SQLite reads these files before it reads the database, and copies their content into it. It
    would write through a link, and wait for ever for a program that writes to a named pipe.
    """
    place = os.path.realpath(path)
    for ending in COMPANIONS:
        companion = Path(f"{place}{ending}")
        if companion.is_symlink():
            raise CatalogueError(f"{companion}: {LINK}")
        if not companion.exists():
            continue
        if not companion.is_file():
            raise CatalogueError(f"{companion}: it is not a regular file; delete it")
        if not path.exists():
            raise CatalogueError(f"{companion}: its database is missing; delete this file, too")


def create_file(url: URL) -> None:
    """Create the file of an SQLite catalogue, if it is missing.

    Raises:
        CatalogueError: Files of another database are next to it.
        UnavailableError: The file cannot be written.
    """
    if url.drivername != "sqlite" or not url.database:
        return
    path = Path(url.database)
    _check_companions(path)
    try:
        create(path)
    except OSError as error:
        why = f"cannot be written: {error.strerror or error}"
        raise UnavailableError(f"{error.filename or path}: {why}") from None


def _shown(url: URL) -> str:
    """Return the URL for messages, without passwords, which may also be in its query."""
    return url.database or "memory" if url.drivername == "sqlite" else str(url.set(query={}))


@contextmanager
def database_errors(url: URL) -> Iterator[None]:
    """Convert errors of the database.

    Raises:
        UnavailableError: The database is unreachable, full, locked or read-only.
        CatalogueError: Any other error.
    """
    try:
        yield
    except (exc.DBAPIError, sqlite3.Error) as error:
        original = getattr(error, "orig", error)
        words = " ".join(str(original).split()) or type(original).__name__
        passing = isinstance(
            error, exc.OperationalError | exc.InternalError | sqlite3.OperationalError
        )
        # SQLAlchemy marks lost connections, which drivers report as several kinds of error.
        lost = getattr(error, "connection_invalidated", False)
        kind = UnavailableError if passing or lost else CatalogueError
        raise kind(f"{_shown(url)}: {words}") from None
    except OSError as error:
        if error.filename is not None:  # Another file, such as an output file.
            raise
        raise UnavailableError(f"{_shown(url)}: {error.strerror or error}") from None


def writing_engine(url: URL) -> Engine:
    """Return an engine whose transactions write, one at a time."""
    if url.drivername == "sqlite":
        engine = sa.create_engine(url, poolclass=NullPool, connect_args={"timeout": LOCK_SECONDS})
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(
            engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN IMMEDIATE")
        )
        return engine
    # There is no pool: indexing opens a connection for each group of files, and a pooled connection
    # would not survive a restart of the database.
    engine = sa.create_engine(
        url, poolclass=NullPool, connect_args={"connect_timeout": CONNECT_SECONDS}
    )
    event.listen(engine, "begin", _lock_postgresql)
    return engine


def read_only_engine(url: URL) -> Engine:
    """Return an engine that cannot write.

    In PostgreSQL a role could still switch its transaction back, so give it only read rights.
    """
    if url.drivername != "sqlite":
        options = {
            "connect_timeout": CONNECT_SECONDS,
            "options": "-c default_transaction_read_only=on",
        }
        return sa.create_engine(url, poolclass=NullPool, connect_args=options)
    uri = read_only_uri(url)

    def connect() -> sqlite3.Connection:
        # A URI and not SQLAlchemy's URL, because only a URI can open a file read-only.
        connection = sqlite3.connect(uri, uri=True, timeout=LOCK_SECONDS)
        connection.execute("PRAGMA trusted_schema=OFF")
        return connection

    return sa.create_engine("sqlite://", creator=connect, poolclass=NullPool)


def read_only_uri(url: URL) -> str:
    """Return the URI that opens an SQLite catalogue read-only.

    Raises:
        CatalogueError: There is no such file, or files of another database are next to it.
    """
    path = Path(url.database or "")
    if not path.is_file():
        raise CatalogueError(
            f"{path}: no catalogue; create it with `robotouille data index FOLDER`, or set --folder"
            " or --database"
        )
    _check_companions(path)
    mode = "mode=ro"
    if not os.access(path.parent, os.W_OK) and not Path(f"{path}-wal").exists():
        mode = "immutable=1"  # SQLite cannot create its WAL files next to it.
    return f"{path.as_uri()}?{mode}"


def insert(connection: Connection, table: sa.Table, rows: Sequence[tuple[Any, ...]]) -> None:
    """Insert rows, each with the values of all columns in order.

    Drivers' own bulk inserts are several times faster than SQLAlchemy's for millions of steps.
    """
    if not rows:
        return
    if connection.dialect.name == "sqlite":
        places = ", ".join("?" * len(table.columns))
        statement = f"INSERT INTO {table.name} VALUES ({places})"  # noqa: S608
        connection.exec_driver_sql(statement, list(rows))
        return
    driver: Any = connection.connection.driver_connection
    # COPY has no parameters, whose number PostgreSQL limits, and sends rows without a statement for
    # each.
    statement = f"COPY {table.name} FROM STDIN"
    with driver_errors(connection), driver.cursor() as cursor, cursor.copy(statement) as copy:
        for row in rows:
            copy.write_row(row)


def in_pieces(values: Collection[T]) -> Iterator[list[T]]:
    """Split values into lists that fit into one statement."""
    everything = list(values)
    for at in range(0, len(everything), MAX_VALUES):
        yield everything[at : at + MAX_VALUES]


@contextmanager
def driver_errors(connection: Connection) -> Iterator[None]:
    """Convert errors of a database driver into those of SQLAlchemy."""
    base: type[Exception] = connection.dialect.loaded_dbapi.Error
    try:
        yield
    except base as error:
        raise exc.DBAPIError.instance(None, None, error, base) from None


def _prepare_sqlite(connection: sqlite3.Connection, _: object) -> None:
    connection.isolation_level = None  # SQLAlchemy begins transactions, with a lock.
    # With a write-ahead log, queries read while an indexer writes. A crash of the machine may lose
    # the last transactions but never damages the file, and indexing repeats them.
    connection.execute("PRAGMA trusted_schema=OFF")
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=NORMAL")
    connection.execute("PRAGMA cache_size=-65536")


def _lock_postgresql(connection: Connection) -> None:
    connection.exec_driver_sql(f"SET LOCAL lock_timeout = '{LOCK_SECONDS}s'")
    connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({LOCK})")


MIGRATIONS = Path(__file__).with_name("migrations")


def migrate(connection: Connection, folder: Path = MIGRATIONS) -> None:
    """Create the tables, or migrate them from an earlier version.

    Raises:
        CatalogueError: The catalogue has a later version.
    """
    if not _is_current(connection, folder):
        _upgrade(connection, folder, "head")


def _upgrade(connection: Connection, folder: Path, target: str) -> None:
    script = _script(folder)

    def upgrade(revision: Any, _: Any) -> Any:
        return script._upgrade_revs(target, revision)

    with EnvironmentContext(Config(), script, fn=upgrade) as environment:
        environment.configure(connection=connection, transactional_ddl=True)
        environment.run_migrations()


def check_version(connection: Connection, folder: Path = MIGRATIONS) -> None:
    """Check that the catalogue has this version.

    Raises:
        CatalogueError: The catalogue has another version or does not exist.
    """
    if not _is_current(connection, folder):
        raise CatalogueError(
            "the catalogue is missing or has an earlier version;"
            " run `robotouille data index FOLDER`"
        )


def catalogue_version(connection: Connection) -> str:
    """Return the version of a catalogue's tables, or an empty text without tables."""
    return MigrationContext.configure(connection).get_current_revision() or ""


def _script(folder: Path) -> ScriptDirectory:
    return ScriptDirectory(str(MIGRATIONS), version_locations=[str(folder)])


def _is_current(connection: Connection, folder: Path) -> bool:
    script = _script(folder)
    found = MigrationContext.configure(connection).get_current_revision()
    known = {each.revision for each in script.walk_revisions()}
    if found is not None and found not in known:
        raise CatalogueError(f"the catalogue has a later version ({found}); update robotouille")
    if connection.dialect.name == "sqlite":
        _check_objects(connection, _made_objects(folder, found))
    return found == script.get_current_head()


def _check_objects(connection: Connection, expected: Mapping[str, str]) -> None:
    """Check that tables and views are as migrations make them, and that there are no triggers.

    A view or a generated column could show other values, and a trigger change them.
    """
    found = _objects(connection)
    wrong = {name for name, made in expected.items() if found.get(name) != made}
    wrong |= {name for name in found if name.startswith("trigger ")}
    if not expected:  # Without a version, there should be no tables yet.
        wrong |= found.keys() - {"table alembic_version"}
    if wrong:
        message = f"{min(wrong)} is not as Robotouille makes it; index into a new catalogue"
        raise CatalogueError(f"the catalogue was changed: {message}")


def _objects(connection: Connection) -> dict[str, str]:
    """Return the definitions of an SQLite file's tables, indices, views and triggers."""
    # A hostile file may have many and long ones.
    query = "SELECT type, name, substr(sql, 1, 20000) FROM sqlite_master LIMIT 10000"
    rows = connection.exec_driver_sql(query)
    return {
        f"{kind} {name}": " ".join((sql or "").split())
        for kind, name, sql in rows
        if not name.startswith("sqlite_")
    }


@cache
def _made_objects(folder: Path, revision: str | None) -> dict[str, str]:
    """Return what `_objects` returns for a catalogue of a version."""
    if revision is None:
        return {}
    with sa.create_engine("sqlite://").begin() as connection:
        _upgrade(connection, folder, revision)
        return _objects(connection)
