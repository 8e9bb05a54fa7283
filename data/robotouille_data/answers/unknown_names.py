"""What to say where a query names a table or a column that is not there: the nearest there is."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from difflib import get_close_matches

from sqlalchemy import Table

from robotouille_data.schema import METADATA, VIEWS

__all__ = ["explain_unknown"]

TABLES = {**METADATA.tables, **VIEWS.tables}
UNKNOWN_TABLE = re.compile(r'no such table: (\S+)|relation "([^"]+)" does not exist')
UNKNOWN_COLUMN = re.compile(r'no such column: (\S+)|column "?([^\s"]+)"? does not exist')
UNKNOWN_SOURCE = re.compile(r'missing FROM-clause entry for table "([^"]+)"')
"""As SQLite and PostgreSQL say it."""
SOURCE = re.compile(r"\b(?:from|join|,)\s+(\w+)(?:\s+(?:as\s+)?(\w+))?", re.IGNORECASE)
LABELS_HINT = " (labels are rows of the table labels)"
NEAR = 0.6


def explain_unknown(error: str, query: str) -> str | None:
    """A database's error as words that help, if it is about an unknown name; else None."""
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
    """Of the table that the name is qualified with, or of those that the query is about."""
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
        near = f"; there is one in {_listed(others)}"
    columns = (f"{table.name} has {_listed(_columns(table))}" for table in _few(asked))
    told = "; ".join(columns) or f"The tables: {_listed(TABLES)}"
    return f"no column `{column}`{where}{near}. {told}"


def _about_source(name: str, sources: Collection[str]) -> str:
    known = f"; it has {_listed(sources)}" if sources else ""
    return f"no table of the query is called `{name}`{known}"


def _sources(query: str) -> Iterable[tuple[str, str]]:
    """The tables of a query by what it calls them."""
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
