"""What files and data sets are called after tasks."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille_data.database import in_pieces
from robotouille_data.schema import EPISODES

__all__ = ["task_slugs"]

UNUSUAL = re.compile(r"[^A-Za-z0-9_]+")
MAX_SLUG = 80


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
