"""Which episodes of a catalogue are exported."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import URL, Connection

from robotouille_data.answers.query import asking
from robotouille_data.errors import CatalogueError
from robotouille_data.exports.request import Request
from robotouille_data.schema import EPISODES, LABELS

__all__ = ["Selection", "in_pieces", "select_episodes", "task_slugs"]

UNUSUAL = re.compile(r"[^A-Za-z0-9_]+")
MAX_SLUG = 80
COLUMNS = ("episode_id", "id")
AT_ONCE = 50
"""Episodes of one statement."""


@dataclass(frozen=True, slots=True)
class Selection:
    """The ids of the episodes, in order, and how many were left out for what reason."""

    ids: tuple[int, ...]
    left_out: dict[str, int]


def select_episodes(connection: Connection, url: URL, request: Request) -> Selection:
    """The episodes that a request is about.

    Raises:
        CatalogueError: There is none, or the query has no ids.
    """
    left_out: dict[str, int] = {}
    found = set(connection.scalars(sa.select(EPISODES.c.id)))
    if not found:
        raise CatalogueError("the catalogue has no episodes: --folder says where recordings are")
    if request.query:
        asked = _asked(url, request.query, request.seconds)
        left_out["unknown"] = len(asked - found)
        found &= asked
    for name, value in request.labels.items():
        labelled = found & _labelled(connection, name, value)
        left_out["label"] = left_out.get("label", 0) + len(found) - len(labelled)
        found = labelled
    if request.consent is not None:
        consenting = found & _labelled(connection, *request.consent)
        left_out["consent"] = len(found) - len(consenting)
        found = consenting
    if not found:
        reasons = ", ".join(f"{count} by {name}" for name, count in left_out.items() if count)
        raise CatalogueError(f"no episode is left{f': left out {reasons}' if reasons else ''}")
    return Selection(tuple(sorted(found)), left_out)


def in_pieces(ids: Sequence[int]) -> Iterator[Sequence[int]]:
    """Ids in their order, as many as a statement takes at once."""
    for at in range(0, len(ids), AT_ONCE):
        yield ids[at : at + AT_ONCE]


def task_slugs(connection: Connection, ids: Sequence[int]) -> dict[str, str]:
    """What files and data sets are called after the tasks of some episodes, by the tasks' digests:
    by their names, with some of the digest where several tasks have one name."""
    names: dict[str, str] = {}
    for piece in in_pieces(ids):
        query = sa.select(EPISODES.c.digest, EPISODES.c.task).where(EPISODES.c.id.in_(piece))
        for digest, task in connection.execute(query.distinct()):
            names[digest] = UNUSUAL.sub("-", task).strip("-")[:MAX_SLUG] or "task"
    often = Counter(name.lower() for name in names.values())
    return {
        digest: f"{name}-{digest[:8]}" if often[name.lower()] > 1 else name
        for digest, name in names.items()
    }


def _asked(url: URL, query: str, seconds: float) -> set[int]:
    """The ids of a query's answer."""
    with asking(url, query, seconds) as answer:
        place = next((answer.columns.index(c) for c in COLUMNS if c in answer.columns), None)
        if place is None:
            columns = ", ".join(answer.columns)
            raise CatalogueError(
                f"the query needs a column `id` or `episode_id` with ids of episodes, not {columns}"
            )
        found = {row[place] for row in answer.rows} - {None}
    if strange := next((value for value in found if not isinstance(value, int)), None):
        raise CatalogueError(f"{strange!r} in the query's answer is no id of an episode")
    return found


def _labelled(connection: Connection, name: str, value: str) -> set[int]:
    wanted = (LABELS.c.name == name) & (LABELS.c.value == value)
    return set(connection.scalars(sa.select(LABELS.c.episode_id).where(wanted)))
