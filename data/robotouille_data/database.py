"""The database of a catalogue: SQLite in a file, or PostgreSQL by its URL.

Who writes holds the one lock of the catalogue from the beginning of a transaction on, so that two
indexers at once take turns.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import sqlalchemy as sa
from sqlalchemy import event, exc
from sqlalchemy.engine import URL, Connection, Engine, make_url
from sqlalchemy.pool import NullPool

from robotouille_data.errors import CatalogueError, UnavailableError

__all__ = [
    "DEFAULT_FILE",
    "database_errors",
    "database_url",
    "driver_errors",
    "in_pieces",
    "insert",
    "read_only_engine",
    "writing_engine",
]

T = TypeVar("T")

DEFAULT_FILE = "catalogue.sqlite"
LOCK_SECONDS = 60
"""How long one waits for who writes at present."""
CONNECT_SECONDS = 10
MAX_VALUES = 500
"""In one list of a statement."""
LOCK = 0x526F626F
"""The advisory lock of PostgreSQL that who writes holds."""


def database_url(database: str | None, folder: Path) -> URL:
    """Where a catalogue is: a URL, or an SQLite file; if nothing is said, one in a folder.

    Raises:
        CatalogueError: It is neither.
    """
    if database is None:
        database = str(folder / DEFAULT_FILE)
    if "://" not in database:
        return URL.create("sqlite", database=str(Path(database).absolute()))
    try:
        url = make_url(database)
    except exc.ArgumentError:
        raise CatalogueError("the database's URL cannot be read") from None
    match url.get_backend_name():
        case "sqlite":
            return url.set(drivername="sqlite")
        case "postgresql" | "postgres":
            return url.set(drivername="postgresql+psycopg")
    raise CatalogueError(f"no catalogue in {url.get_backend_name()}: SQLite and PostgreSQL can be")


def _shown(url: URL) -> str:
    """A database as messages call it, without its password, also where that is an option."""
    return url.database or "memory" if url.drivername == "sqlite" else str(url.set(query={}))


@contextmanager
def database_errors(url: URL) -> Iterator[None]:
    """Errors of a database become ours.

    Raises:
        UnavailableError: It is gone, full, locked or read-only: later it may be there again.
        CatalogueError: Anything else.
    """
    try:
        yield
    except (exc.DBAPIError, sqlite3.Error) as error:
        original = getattr(error, "orig", error)
        words = " ".join(str(original).split()) or type(original).__name__
        passing = isinstance(
            error, exc.OperationalError | exc.InternalError | sqlite3.OperationalError
        )
        lost = getattr(error, "connection_invalidated", False)
        kind = UnavailableError if passing or lost else CatalogueError
        raise kind(f"{_shown(url)}: {words}") from None
    except OSError as error:
        if error.filename is not None:  # Another file, as one that an answer is written to.
            raise
        raise UnavailableError(f"{_shown(url)}: {error.strerror or error}") from None


def writing_engine(url: URL) -> Engine:
    """An engine whose transactions may write; one at a time does."""
    if url.drivername == "sqlite":
        engine = sa.create_engine(url, poolclass=NullPool, connect_args={"timeout": LOCK_SECONDS})
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(
            engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN IMMEDIATE")
        )
        return engine
    engine = sa.create_engine(
        url, poolclass=NullPool, connect_args={"connect_timeout": CONNECT_SECONDS}
    )
    event.listen(engine, "begin", _lock_postgresql)
    return engine


def read_only_engine(url: URL) -> Engine:
    """An engine that nobody can write with, for PostgreSQL as far as the role's rights go."""
    if url.drivername != "sqlite":
        options = {
            "connect_timeout": CONNECT_SECONDS,
            "options": "-c default_transaction_read_only=on",
        }
        return sa.create_engine(url, poolclass=NullPool, connect_args=options)
    path = Path(url.database or "")
    if not path.is_file():
        raise CatalogueError(
            f"{path}: there is no catalogue: `robotouille data index FOLDER` makes one of the"
            " recordings in a folder, --folder or --database says where it is"
        )

    mode = "mode=ro"
    if not os.access(path.parent, os.W_OK) and not Path(f"{path}-wal").exists():
        mode = "immutable=1"  # Else SQLite would make files beside it.

    def connect() -> sqlite3.Connection:
        return sqlite3.connect(f"{path.as_uri()}?{mode}", uri=True, timeout=LOCK_SECONDS)

    return sa.create_engine("sqlite://", creator=connect, poolclass=NullPool)


def insert(connection: Connection, table: sa.Table, rows: Sequence[tuple[Any, ...]]) -> None:
    """Add rows, each with the values of all columns in order."""
    if not rows:
        return
    if connection.dialect.name == "sqlite":
        places = ", ".join("?" * len(table.columns))
        statement = f"INSERT INTO {table.name} VALUES ({places})"  # noqa: S608
        connection.exec_driver_sql(statement, list(rows))
        return
    driver: Any = connection.connection.driver_connection
    statement = f"COPY {table.name} FROM STDIN"
    with driver_errors(connection), driver.cursor() as cursor, cursor.copy(statement) as copy:
        for row in rows:
            copy.write_row(row)


def in_pieces(values: Collection[T]) -> Iterator[list[T]]:
    """So many values as one statement takes at once."""
    everything = list(values)
    for at in range(0, len(everything), MAX_VALUES):
        yield everything[at : at + MAX_VALUES]


@contextmanager
def driver_errors(connection: Connection) -> Iterator[None]:
    """What a database's own driver raises becomes what SQLAlchemy makes of it."""
    base: type[Exception] = connection.dialect.loaded_dbapi.Error
    try:
        yield
    except base as error:
        raise exc.DBAPIError.instance(None, None, error, base) from None


def _prepare_sqlite(connection: sqlite3.Connection, _: object) -> None:
    connection.isolation_level = None  # Transactions begin where SQLAlchemy says so, with a lock.
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=NORMAL")
    connection.execute("PRAGMA cache_size=-65536")


def _lock_postgresql(connection: Connection) -> None:
    connection.exec_driver_sql(f"SET LOCAL lock_timeout = '{LOCK_SECONDS}s'")
    connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({LOCK})")
