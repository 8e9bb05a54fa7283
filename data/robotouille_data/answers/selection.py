"""Which episodes something is made of: all, those of a query, those with some labels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import URL, Connection

from robotouille_data.answers.query import SECONDS, asking
from robotouille_data.errors import CatalogueError
from robotouille_data.schema import EPISODES, LABELS

__all__ = ["Selection", "check_label", "select_episodes"]

KEYS = ("episode_id", "id")
"""The columns of a query that can say which episodes are meant, the first that it has."""

MAX_TOLD = 20
"""Names or values of labels that a message lists."""


@dataclass(frozen=True, slots=True)
class Selection:
    """The ids of episodes, in order, and how many were left out for what reason: `unknown` are ids
    of the query that the catalogue has not, `label` and `consent` episodes without these."""

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
    """The episodes of a query, or all, that have all of some labels.

    Args:
        connection: Of `reading`.
        url: Of the same database: the query has a connection of its own, which may do less.
        query: In SQL; a column `episode_id` or `id` has the ids.
        consent: The name and value of a label that is counted apart from the others.
        seconds: After these the query is given up.

    Raises:
        UnavailableError: The database cannot be read now, or the time is over.
        CatalogueError: The query is none, or has no ids; or no episode is left.
    """
    left_out: dict[str, int] = {}
    found = set(connection.scalars(sa.select(EPISODES.c.id)))
    if not found:
        raise CatalogueError("the catalogue has no episodes: --folder says where recordings are")
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
        raise CatalogueError(f"no episode is left{f': left out {reasons}' if reasons else ''}")
    return Selection(tuple(sorted(found)), left_out)


def check_label(connection: Connection, name: str, value: str | None = None) -> None:
    """Nothing is done.

    Raises:
        CatalogueError: No episode of the catalogue has a label of this name, or this value of it;
            those that there are are told, the nearest first.
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
    """What is known, at most some of it."""
    near = get_close_matches(wanted, sorted(known), 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    listed = sorted(known)[:MAX_TOLD]
    more = f" and {len(known) - MAX_TOLD} more" if len(known) > MAX_TOLD else ""
    return f"{hint}the {what}: {', '.join(listed) or 'none'}{more}"


def _asked(url: URL, query: str, seconds: float) -> set[int]:
    """The ids in a query's answer, which may be unknown to the catalogue."""
    with asking(url, query, seconds) as answer:
        key = next((name for name in KEYS if name in answer.columns), None)
        if key is None:
            raise CatalogueError(
                "the query has no column `episode_id` or `id` to say which episodes"
            )
        place = answer.columns.index(key)
        return {_id(row[place]) for row in answer.rows if row[place] is not None}


def _id(value: Any) -> int:
    if not isinstance(value, int):
        raise CatalogueError(f"{str(value)[:60]!r} is no id of an episode: those are numbers")
    return value


def _labelled(connection: Connection, name: str, value: str) -> set[int]:
    """The ids of the episodes that have a label."""
    wanted = (LABELS.c.name == name) & (LABELS.c.value == value)
    return set(connection.scalars(sa.select(LABELS.c.episode_id).where(wanted)))
