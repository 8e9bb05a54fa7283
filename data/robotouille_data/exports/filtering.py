"""Which episodes of a catalogue are exported, and how many are left out why."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import URL, Connection

from robotouille_data.answers.selection import asked_episodes, in_pieces, labelled_episodes
from robotouille_data.errors import CatalogueError
from robotouille_data.exports.request import Request
from robotouille_data.schema import EPISODES

__all__ = ["Filtered", "filter_episodes", "task_slugs"]

UNUSUAL = re.compile(r"[^A-Za-z0-9_]+")
MAX_SLUG = 80


@dataclass(frozen=True, slots=True)
class Filtered:
    """The ids of the episodes, in order, and how many were left out for what reason."""

    ids: tuple[int, ...]
    left_out: dict[str, int]


def filter_episodes(connection: Connection, url: URL, request: Request) -> Filtered:
    """The episodes that a request is about.

    Raises:
        CatalogueError: There is none, or the query has no ids.
    """
    left_out: dict[str, int] = {}
    found = set(connection.scalars(sa.select(EPISODES.c.id)))
    if not found:
        raise CatalogueError("the catalogue has no episodes: --folder says where recordings are")
    if request.query:
        asked = asked_episodes(url, request.query, request.seconds)
        left_out["unknown"] = len(asked - found)
        found &= asked
    for name, value in request.labels.items():
        labelled = found & labelled_episodes(connection, name, value)
        left_out["label"] = left_out.get("label", 0) + len(found) - len(labelled)
        found = labelled
    if request.consent is not None:
        consenting = found & labelled_episodes(connection, *request.consent)
        left_out["consent"] = len(found) - len(consenting)
        found = consenting
    if not found:
        reasons = ", ".join(f"{count} by {name}" for name, count in left_out.items() if count)
        raise CatalogueError(f"no episode is left{f': left out {reasons}' if reasons else ''}")
    return Filtered(tuple(sorted(found)), left_out)


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
