"""Read-only queries of a catalogue: what would write, attach or configure is refused."""

from __future__ import annotations

import re
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from sqlalchemy.engine import URL, Connection

from robotouille_data.answers.unknown_names import explain_unknown
from robotouille_data.database import database_errors, driver_errors, read_only_engine
from robotouille_data.errors import CatalogueError
from robotouille_data.versions import check_version

__all__ = ["SECONDS", "Answer", "asking", "reading"]

SECONDS = 60.0
"""How long a query may take, if nothing else is said."""
AT_ONCE = 1000
"""Rows that are fetched at once."""
INSTRUCTIONS = 10_000
"""Instructions of SQLite's machine between two looks at the clock."""
QUOTED = re.compile(
    r"""'(?:[^']|'')*'|`(?:[^`]|``)*`|\[[^\]]*\]|--[^\n]*|/\*.*?(?:\*/|\Z)|"((?:[^"]|"")*)\"""",
    re.DOTALL,
)
"""Texts, names and remarks; the group has what is in double quotes."""
WRITES = "what would write, attach or change a setting is refused"
ALLOWED = frozenset({
    sqlite3.SQLITE_SELECT, sqlite3.SQLITE_READ, sqlite3.SQLITE_FUNCTION, sqlite3.SQLITE_RECURSIVE
})  # fmt: skip


@dataclass(frozen=True, slots=True)
class Answer:
    """The columns of an answer, and its rows as they come; they may be gone through once."""

    columns: tuple[str, ...]
    rows: Iterator[tuple[Any, ...]]


@contextmanager
def asking(url: URL, query: str, seconds: float = SECONDS) -> Iterator[Answer]:
    """The answer to a query in SQL.

    Args:
        seconds: After these it is given up.

    Raises:
        UnavailableError: The database cannot be read now, or the time is over.
        CatalogueError: There is no catalogue of this version, or the query is none that only reads.
    """
    query = query.strip().rstrip(";").strip()
    if not query:
        raise CatalogueError("the query is empty")
    engine = read_only_engine(url)
    with database_errors(url), engine.connect() as connection:
        check_version(connection)
        if url.drivername == "sqlite":
            yield _ask_sqlite(connection, query, seconds)
        else:
            with _asking_postgresql(connection, query, seconds) as answer:
                yield answer


@contextmanager
def reading(url: URL) -> Iterator[Connection]:
    """A connection that reads one state of a catalogue, whatever is written meanwhile.

    Raises:
        UnavailableError: The database cannot be read now.
        CatalogueError: There is no catalogue of this version.
    """
    engine = read_only_engine(url)
    with database_errors(url), engine.connect() as connection:
        check_version(connection)
        connection.rollback()
        if url.drivername == "sqlite":
            connection.exec_driver_sql("BEGIN")
        else:
            connection.execution_options(isolation_level="REPEATABLE READ")
        yield connection


def _ask_sqlite(connection: Connection, query: str, seconds: float) -> Answer:
    driver: Any = connection.connection.driver_connection
    driver.execute("PRAGMA query_only=ON")
    driver.set_authorizer(_authorize)
    deadline = time.monotonic() + seconds
    driver.set_progress_handler(lambda: time.monotonic() > deadline, INSTRUCTIONS)
    try:
        cursor = driver.execute(_with_backticks(query))
    except sqlite3.DatabaseError as error:
        if words := explain_unknown(str(error), query):
            raise CatalogueError(words) from None
        if "not authorized" in str(error) or "prohibited" in str(error):
            raise CatalogueError(f"a query only reads: {WRITES}") from None
        raise
    except (sqlite3.Warning, sqlite3.ProgrammingError) as error:  # Several statements.
        raise CatalogueError(f"one query at a time: {error}") from None
    if cursor.description is None:
        raise CatalogueError("not a query: it has no columns")
    return Answer(_unlike([column[0] for column in cursor.description]), cursor)


def _with_backticks(query: str) -> str:
    """A query whose names in double quotes are in backticks: SQLite takes what it does not know in
    double quotes for a text, so that a condition holds of all rows."""

    def in_backticks(found: re.Match[str]) -> str:
        name = found[1]
        if name is None:
            return found[0]
        return "`{}`".format(name.replace('""', '"').replace("`", "``"))

    return QUOTED.sub(in_backticks, query)


def _authorize(action: int, *_: str | None) -> int:
    return sqlite3.SQLITE_OK if action in ALLOWED else sqlite3.SQLITE_DENY


@contextmanager
def _asking_postgresql(connection: Connection, query: str, seconds: float) -> Iterator[Answer]:
    """By a cursor, which takes nothing but queries; prepared, which takes one statement alone."""
    connection.exec_driver_sql(f"SET LOCAL statement_timeout = {max(1, int(seconds * 1000))}")
    connection.exec_driver_sql("SET TRANSACTION READ ONLY")
    driver: Any = connection.connection.driver_connection
    with driver_errors(connection), driver.cursor() as cursor:
        try:
            cursor.execute(f"DECLARE answer NO SCROLL CURSOR FOR {query}".encode(), prepare=True)
        except connection.dialect.loaded_dbapi.Error as error:
            if words := explain_unknown(str(error), query):
                raise CatalogueError(words) from None
            raise
        cursor.execute(f"FETCH {AT_ONCE} FROM answer")
        columns = _unlike([column.name for column in cursor.description])
        yield Answer(columns, _fetched(cursor))


def _fetched(cursor: Any) -> Iterator[tuple[Any, ...]]:
    while rows := cursor.fetchall():
        yield from rows
        cursor.execute(f"FETCH {AT_ONCE} FROM answer")


def _unlike(columns: list[str]) -> tuple[str, ...]:
    """Names of columns, of which those that are alike have a number behind them."""
    found: list[str] = []
    for name in columns:
        number, own = 2, name
        while own in found:
            own, number = f"{name}_{number}", number + 1
        found.append(own)
    return tuple(found)
