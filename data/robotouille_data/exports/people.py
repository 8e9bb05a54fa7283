"""Who took part in which episode: by pseudonym, or by name where there is none."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille_data.database import in_pieces
from robotouille_data.schema import EVENTS

__all__ = ["Person", "Sitting", "sittings", "spectators_heard"]


@dataclass(frozen=True, slots=True)
class Person:
    """Somebody, the same in all episodes; without a token two of one name are held for one."""

    name: str
    by_pseudonym: bool

    @classmethod
    def of(cls, name: str, pseudonym: str) -> Person:
        """Who goes by a name, and by a pseudonym if there is one."""
        return cls(pseudonym, True) if pseudonym else cls(name, False)


@dataclass(frozen=True, slots=True)
class Sitting:
    """Somebody who had a seat of an episode, by the name and kind that they had there."""

    episode_id: int
    name: str
    kind: str
    person: Person


def sittings(connection: Connection, ids: Sequence[int]) -> Iterator[Sitting]:
    """All who had a seat of some episodes, also those whose seat somebody else had later. Who came
    back is told again."""
    columns = EVENTS.c.episode_id, EVENTS.c.name, EVENTS.c.details
    query = sa.select(*columns).where(EVENTS.c.kind == "roster", EVENTS.c.name != "")
    order = EVENTS.c.episode_id, EVENTS.c.number
    for piece in in_pieces(ids):
        its = query.where(EVENTS.c.episode_id.in_(piece)).order_by(*order)
        for episode_id, name, details in connection.execute(its):
            told = json.loads(details)
            person = Person.of(name, told.get("participant", ""))
            yield Sitting(episode_id, name, told["kind"], person)


def spectators_heard(connection: Connection, ids: Sequence[int]) -> Iterator[tuple[int, str]]:
    """The episodes in which somebody without a seat has said something, and their names."""
    said = (EVENTS.c.kind == "said") & EVENTS.c.seat.is_(None) & (EVENTS.c.name != "")
    query = sa.select(EVENTS.c.episode_id, EVENTS.c.name).where(said).distinct()
    for piece in in_pieces(ids):
        found = connection.execute(query.where(EVENTS.c.episode_id.in_(piece)))
        yield from ((episode_id, name) for episode_id, name in found)
