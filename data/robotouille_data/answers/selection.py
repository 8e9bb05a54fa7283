"""Which episodes something is made of: all, those of a query, those with some labels."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import URL, Connection

from robotouille_data.answers.query import SECONDS, asking, reading
from robotouille_data.errors import CatalogueError
from robotouille_data.schema import EPISODES, LABELS

__all__ = [
    "Selection",
    "asked_episodes",
    "in_pieces",
    "labelled_episodes",
    "select_episodes",
]

KEYS = ("episode_id", "id")
"""The columns of a query that can say which episodes are meant, the first that it has."""
AT_ONCE = 500
"""Ids in one list of a statement."""


@dataclass(frozen=True, slots=True)
class Selection:
    """The ids of episodes, in order, and how many of those asked for the catalogue has not."""

    ids: tuple[int, ...]
    unknown: int = 0


def select_episodes(
    url: URL,
    query: str | None = None,
    labels: Mapping[str, str] | None = None,
    seconds: float = SECONDS,
) -> Selection:
    """The episodes of a query, or all, that have all of some labels.

    Args:
        query: In SQL; a column `episode_id` or `id` has the ids.
        seconds: After these the query is given up.

    Raises:
        UnavailableError: The database cannot be read now, or the time is over.
        CatalogueError: There is no catalogue of this version, or the query is none, or has no ids.
    """
    asked = None if query is None else asked_episodes(url, query, seconds)
    with reading(url) as connection:
        known = {number for (number,) in connection.execute(sa.select(EPISODES.c.id))}
        found = known if asked is None else known & asked
        for name, value in (labels or {}).items():
            found = found & labelled_episodes(connection, name, value)
    return Selection(tuple(sorted(found)), len(asked - known) if asked is not None else 0)


def in_pieces(ids: Collection[int]) -> Iterator[list[int]]:
    """So many ids as one statement takes at once."""
    everything = list(ids)
    for at in range(0, len(everything), AT_ONCE):
        yield everything[at : at + AT_ONCE]


def asked_episodes(url: URL, query: str, seconds: float) -> set[int]:
    """The ids in a query's answer, which may be unknown to the catalogue.

    Raises:
        UnavailableError: The database cannot be read now, or the time is over.
        CatalogueError: There is no catalogue of this version, or the query is none, or has no ids.
    """
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


def labelled_episodes(connection: Connection, name: str, value: str) -> set[int]:
    """The ids of the episodes that have a label."""
    wanted = (LABELS.c.name == name) & (LABELS.c.value == value)
    return {
        number for (number,) in connection.execute(sa.select(LABELS.c.episode_id).where(wanted))
    }
