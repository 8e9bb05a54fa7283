"""Read-only queries of a catalogue, and the selection of episodes.

Statements that write, attach a database or change a setting are refused.
"""

from __future__ import annotations

import re
import sqlite3
import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import sqlalchemy as sa
from sqlalchemy import Table
from sqlalchemy.engine import URL, Connection

from robotouille_data.database import (
    LOCK_SECONDS,
    CatalogueError,
    UnavailableError,
    check_version,
    database_errors,
    driver_errors,
    read_only_engine,
    read_only_uri,
)
from robotouille_data.schema import EPISODES, LABELS, METADATA, VIEWS
from robotouille_data.sqlite_process import sqlite_answer

TABLES = {**METADATA.tables, **VIEWS.tables}
UNKNOWN_TABLE = re.compile(r'no such table: (\S+)|relation "([^"]+)" does not exist')
UNKNOWN_COLUMN = re.compile(r'no such column: (\S+)|column "?([^\s"]+)"? does not exist')
UNKNOWN_SOURCE = re.compile(r'missing FROM-clause entry for table "([^"]+)"')
"""These three patterns match error messages of SQLite and PostgreSQL."""
SOURCE = re.compile(r"\b(?:from|join|,)\s+(\w+)(?:\s+(?:as\s+)?(\w+))?", re.IGNORECASE)
LABELS_HINT = " (labels are rows of the table labels)"
NEAR = 0.6


def explain_unknown(error: str, query: str) -> str | None:
    """Return a helpful message for an error about an unknown name, or None for other errors."""
    if found := UNKNOWN_TABLE.search(error):
        return _about_table(_name(found))
    if found := UNKNOWN_SOURCE.search(error):
        return _about_source(_name(found), dict(_sources(query)))
    if found := UNKNOWN_COLUMN.search(error):
        return _about_column(_name(found), query)
    return None


def _name(found: re.Match[str]) -> str:
    return next(group for group in found.groups() if group)


def _about_table(name: str) -> str:
    return f"no table `{name}`{_did_you_mean(name, TABLES)}. The tables: {_listed(TABLES)}"


def _about_column(name: str, query: str) -> str:
    """Explain an unknown column: of the table before the dot, or of all tables in the query."""
    sources = {alias: TABLES[table] for alias, table in _sources(query)}
    qualifier, _, column = name.rpartition(".")
    own = sources.get(qualifier.lower())
    if qualifier and own is None:
        return _about_source(qualifier, sources)
    asked = [own] if own is not None else list({t.name: t for t in sources.values()}.values())
    asked = asked or list(TABLES.values())
    where = f" in {_listed(table.name for table in asked)}" if len(asked) < len(TABLES) else ""
    near = LABELS_HINT + _did_you_mean(
        column, {name for table in asked for name in _columns(table)}
    )
    if others := [table.name for table in TABLES.values() if column in table.columns]:
        near = f"; it is in {_listed(others)}"
    columns = (f"{table.name} has {_listed(_columns(table))}" for table in _few(asked))
    known = "; ".join(columns) or f"The tables: {_listed(TABLES)}"
    return f"no column `{column}`{where}{near}. {known}"


def _about_source(name: str, sources: Collection[str]) -> str:
    known = f"; it has {_listed(sources)}" if sources else ""
    return f"the query has no table `{name}`{known}"


def _sources(query: str) -> Iterable[tuple[str, str]]:
    """Yield the names and aliases of the tables in a query."""
    for table, alias in SOURCE.findall(query):
        if table.lower() in TABLES:
            yield table.lower(), table.lower()
            if alias:
                yield alias.lower(), table.lower()


def _columns(table: Table) -> list[str]:
    return [column.name for column in table.columns]


def _few(tables: list[Table], most: int = 2) -> list[Table]:
    return tables if len(tables) <= most else []


def _did_you_mean(name: str, known: Collection[str]) -> str:
    near = get_close_matches(name.lower(), sorted(known), 1, NEAR)
    return f"; did you mean `{near[0]}`" if near else ""


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)


SECONDS = 60.0
"""Default time limit of a query."""
AT_ONCE = 1000
"""Rows fetched at once."""
AGAIN_SECONDS = 1.0
"""Seconds between two attempts to cancel a statement."""
MAX_TIMEOUT = 2**31 - 1
"""Longest `statement_timeout` of PostgreSQL, in milliseconds."""
QUOTED = re.compile(
    r"""'(?:[^']|'')*'|`(?:[^`]|``)*`|\[[^\]]*\]|--[^\n]*|/\*.*?(?:\*/|\Z)|"((?:[^"]|"")*)\"""",
    re.DOTALL,
)
"""String literals, quoted names and comments. The group matches text in double quotes."""
WRITES = "statements that write, attach or change a setting are refused"


@dataclass(frozen=True, slots=True)
class QueryAnswer:
    """Columns and rows of the answer to a query. The rows can be iterated once."""

    columns: tuple[str, ...]
    rows: Iterator[tuple[Any, ...]]


@contextmanager
def asking(url: URL, query: str, seconds: float = SECONDS) -> Iterator[QueryAnswer]:
    """Run a query in SQL.

    Args:
        seconds: Time limit.

    Raises:
        UnavailableError: The database cannot be read now, or the time limit is exceeded.
        CatalogueError: There is no catalogue of this version, or the query is invalid or writes.
    """
    query = query.strip().rstrip(";").strip()
    if not query:
        raise CatalogueError("the query is empty")
    engine = read_only_engine(url)
    with database_errors(url), engine.connect() as connection:
        check_version(connection)
        if url.drivername == "sqlite":
            with _asking_sqlite(url, query, seconds) as answer:
                yield answer
        else:
            with _asking_postgresql(connection, query, seconds) as answer:
                yield answer


@contextmanager
def reading(url: URL) -> Iterator[Connection]:
    """Open a connection that reads one snapshot of a catalogue, even while others write.

    Raises:
        UnavailableError: The database cannot be read now.
        CatalogueError: There is no catalogue of this version.
    """
    engine = read_only_engine(url)
    with database_errors(url), engine.connect() as connection:
        check_version(connection)
        # `check_version` has begun a transaction. A new one takes the snapshot.
        connection.rollback()
        if url.drivername == "sqlite":
            connection.exec_driver_sql("BEGIN")
        else:
            connection.execution_options(isolation_level="REPEATABLE READ")
        yield connection


@contextmanager
def _asking_sqlite(url: URL, query: str, seconds: float) -> Iterator[QueryAnswer]:
    try:
        with sqlite_answer(
            read_only_uri(url),
            _with_backticks(query),
            seconds=seconds,
            lock_seconds=LOCK_SECONDS,
        ) as (columns, rows):
            if not columns:
                raise CatalogueError("not a query: the statement returns no columns")
            yield QueryAnswer(_unlike(columns), rows)
    except (sqlite3.Warning, sqlite3.ProgrammingError) as error:  # The text has several statements.
        raise CatalogueError(f"expected one query: {error}") from None
    except sqlite3.DatabaseError as error:
        if words := explain_unknown(str(error), query):
            raise CatalogueError(words) from None
        if "not authorized" in str(error) or "prohibited" in str(error):
            raise CatalogueError(f"queries are read-only: {WRITES}") from None
        raise


def _with_backticks(query: str) -> str:
    """Replace the double quotes around names with backticks.

    SQLite reads an unknown name in double quotes as a string literal. A misspelled column would
    then make a condition true for all rows, instead of giving an error.
    """

    def in_backticks(found: re.Match[str]) -> str:
        name = found[1]
        if name is None:
            return found[0]
        return "`{}`".format(name.replace('""', '"').replace("`", "``"))

    return QUOTED.sub(in_backticks, query)


@contextmanager
def _asking_postgresql(connection: Connection, query: str, seconds: float) -> Iterator[QueryAnswer]:
    """Run a query with a cursor, which accepts only queries.

    A prepared statement is a single statement, so nothing can follow the query.
    """
    if connection.scalar(sa.text("SHOW is_superuser")) == "on":
        raise CatalogueError(
            "queries of a superuser could change files and settings of the database server; "
            "connect as a role that only reads (docs/data.md)"
        )
    # The query may change this limit with `set_config`, so `_cancelling` enforces it, too. This
    # limit is for queries whose client has died.
    most = min(int((seconds + AGAIN_SECONDS) * 1000), MAX_TIMEOUT)
    connection.exec_driver_sql(f"SET LOCAL statement_timeout = {most}")
    connection.exec_driver_sql("SET TRANSACTION READ ONLY")
    driver: Any = connection.connection.driver_connection
    with (
        driver_errors(connection),
        _cancelling(driver, seconds) as check,
        driver.cursor() as cursor,
    ):
        try:
            cursor.execute(f"DECLARE answer NO SCROLL CURSOR FOR {query}".encode(), prepare=True)
        except connection.dialect.loaded_dbapi.Error as error:
            if words := explain_unknown(str(error), query):
                raise CatalogueError(words) from None
            raise
        cursor.execute(f"FETCH {AT_ONCE} FROM answer")
        columns = _unlike([column.name for column in cursor.description])
        yield QueryAnswer(columns, _fetched(cursor, check))


@contextmanager
def _cancelling(driver: Any, seconds: float) -> Iterator[Callable[[], None]]:
    """Cancel the statements of a connection that still run after a time limit.

    Yields a function that raises UnavailableError after the limit. A cancellation between two
    statements has no effect, so call it before each statement.
    """
    late, ended = threading.Event(), threading.Event()

    def cancel() -> None:
        wait = min(seconds, threading.TIMEOUT_MAX)
        while not ended.wait(wait):
            late.set()
            with suppress(Exception):  # The connection may be lost, which its user notices.
                driver.cancel()
            wait = AGAIN_SECONDS

    def check() -> None:
        if late.is_set():
            message = f"interrupted: the query takes longer than {seconds:g} s"
            raise UnavailableError(message)

    thread = threading.Thread(target=cancel, daemon=True)
    thread.start()
    try:
        yield check
    except Exception:
        check()
        raise
    finally:
        ended.set()
        thread.join()


def _fetched(cursor: Any, check: Callable[[], None]) -> Iterator[tuple[Any, ...]]:
    while rows := cursor.fetchall():
        yield from rows
        check()
        cursor.execute(f"FETCH {AT_ONCE} FROM answer")


def _unlike(columns: list[str]) -> tuple[str, ...]:
    """Return distinct names for the columns. Repeated names get numbers."""
    found: list[str] = []
    for name in columns:
        number, own = 2, name
        while own in found:
            own, number = f"{name}_{number}", number + 1
        found.append(own)
    return tuple(found)


KEYS = ("episode_id", "id")
"""Columns that can select episodes. The first one in the answer is used."""

MAX_TOLD = 20
"""Maximum number of label names or values in a message."""


@dataclass(frozen=True, slots=True)
class Selection:
    """Selected episodes.

    Attributes:
        ids: The ids in order.
        left_out: Counts by reason. `unknown` counts ids of the query that are not in the
            catalogue, `label` and `consent` count episodes without these labels.
    """

    ids: tuple[int, ...]
    left_out: dict[str, int]


def select_episodes(
    connection: Connection,
    url: URL,
    query: str | None = None,
    labels: Mapping[str, str] | None = None,
    consent: tuple[str, str] | None = None,
    seconds: float = SECONDS,
) -> Selection:
    """Select the episodes that a query returns (without a query: all) and that have the labels.

    Args:
        connection: Connection from `reading`.
        url: URL of the same database. The query runs on its own, restricted connection.
        query: SQL with a column `episode_id` or `id`.
        consent: Name and value of a further label. Episodes without it are counted separately.
        seconds: Time limit of the query.

    Raises:
        UnavailableError: The database cannot be read now, or the time limit is exceeded.
        CatalogueError: The query is invalid or returns no ids, or no episode is left.
    """
    left_out: dict[str, int] = {}
    found = set(connection.scalars(sa.select(EPISODES.c.id)))
    if not found:
        raise CatalogueError(
            "the catalogue has no episodes; set --folder to a folder of recordings"
        )
    if query is not None:
        asked = _asked(url, query, seconds)
        left_out["unknown"] = len(asked - found)
        found &= asked
    wanted = [("label", each) for each in (labels or {}).items()]
    for reason, label in [*wanted, *([("consent", consent)] if consent else [])]:
        having = found & _labelled(connection, *label)
        left_out[reason] = left_out.get(reason, 0) + len(found) - len(having)
        found = having
    if not found:
        for name, value in (labels or {}).items():
            check_label(connection, name, value)
        reasons = ", ".join(f"{count} by {name}" for name, count in left_out.items() if count)
        raise CatalogueError(f"no episode is left{f'; removed {reasons}' if reasons else ''}")
    return Selection(tuple(sorted(found)), left_out)


def check_label(connection: Connection, name: str, value: str | None = None) -> None:
    """Check that an episode has a label with this name, and with this value if given.

    Raises:
        CatalogueError: No episode has the label. The message suggests the closest name.
    """
    names = set(connection.scalars(sa.select(LABELS.c.name).distinct()))
    if name not in names:
        raise CatalogueError(
            f"no episode has a label {name!r}; {_there_are('labels', name, names)}"
        )
    its = sa.select(LABELS.c.value).where(LABELS.c.name == name).distinct()
    values = set() if value is None else set(connection.scalars(its))
    if value is not None and value not in values:
        told = _there_are(f"values of {name!r}", value, values)
        raise CatalogueError(f"no episode has the label {name}={value}; {told}")


def _there_are(what: str, wanted: str, known: set[str]) -> str:
    """Return a suggestion and the known names."""
    near = get_close_matches(wanted, sorted(known), 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    listed = sorted(known)[:MAX_TOLD]
    more = f" and {len(known) - MAX_TOLD} more" if len(known) > MAX_TOLD else ""
    return f"{hint}the {what}: {', '.join(listed) or 'none'}{more}"


def _asked(url: URL, query: str, seconds: float) -> set[int]:
    """Return the ids in a query's answer, which may be unknown to the catalogue."""
    with asking(url, query, seconds) as answer:
        key = next((name for name in KEYS if name in answer.columns), None)
        if key is None:
            raise CatalogueError(
                "the query has no column `episode_id` or `id` that selects episodes"
            )
        place = answer.columns.index(key)
        return {_id(row[place]) for row in answer.rows if row[place] is not None}


def _id(value: Any) -> int:
    if not isinstance(value, int):
        raise CatalogueError(f"{str(value)[:60]!r} is not an episode id; ids are integers")
    return value


def _labelled(connection: Connection, name: str, value: str) -> set[int]:
    """Return the ids of the episodes with a label."""
    wanted = (LABELS.c.name == name) & (LABELS.c.value == value)
    return set(connection.scalars(sa.select(LABELS.c.episode_id).where(wanted)))
