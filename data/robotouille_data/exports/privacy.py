"""Tables without names, or without what people and models have written."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille_data.exports.people import Person, sittings
from robotouille_data.schema import EPISODES, EVENTS, SEATS

__all__ = ["Privacy", "RowChange"]

RowChange = Callable[[tuple[Any, ...]], tuple[Any, ...]]

NAMING = {EPISODES.c.code, EPISODES.c.owner}
WRITTEN = {EVENTS.c.text, EPISODES.c.detail}
"""Columns that are left out with the names, and with what was written."""

UNWRITTEN = frozenset((
    "basis", "code", "controller", "generation", "heard", "holds", "kind", "more", "ms",
    "participant", "present", "ready", "seq", "session", "taken", "utc_ms", "what",
))  # fmt: skip
"""Fields of events that nobody words freely. All others are left out with what was written, so
that one that is new is, too."""


class Privacy:
    """What is left out of the rows of some episodes, and what stands in its place."""

    def __init__(
        self, connection: Connection, ids: Sequence[int], *, names: bool, texts: bool
    ) -> None:
        self._names, self._texts = names, texts
        self._numbers: dict[Person, str] = {}
        self._people: dict[tuple[int, str], Person] = {}
        if not names:
            for sitting in sittings(connection, ids):
                self._people[sitting.episode_id, sitting.name] = sitting.person
                self._pseudonym(sitting.person)

    def columns(self, table: sa.Table) -> list[sa.Column[Any]]:
        """The columns of a table that are left."""
        gone = (set() if self._names else NAMING) | (set() if self._texts else WRITTEN)
        return [column for column in table.columns if column not in gone]

    def change(self, table: sa.Table) -> RowChange | None:
        """What is done to each row of these columns; None if nothing is."""
        if table is SEATS and not self._names:
            return self._seat
        if table is EVENTS and not (self._names and self._texts):
            return self._event
        return None

    def _seat(self, row: tuple[Any, ...]) -> tuple[Any, ...]:
        episode_id, seat, player, name, kind, participant, *rest = row
        person = self._new_name(episode_id, name, participant)
        return episode_id, seat, player, person, kind, person if participant else "", *rest

    def _event(self, row: tuple[Any, ...]) -> tuple[Any, ...]:
        *begin, name = row[:7]
        written = row[7:-1]  # The text, if it is left.
        details = json.loads(row[-1])
        if not self._texts:
            details = {key: value for key, value in details.items() if key in UNWRITTEN}
        if not self._names:
            details.pop("session", None)
            pseudonym = details.get("participant", "")
            name = self._new_name(row[0], name, pseudonym)
            if pseudonym:
                details["participant"] = self._pseudonym(Person.of("", pseudonym))
        told = json.dumps(details, ensure_ascii=False, sort_keys=True, separators=(",", ":"))
        return *begin, name, *written, told

    def _new_name(self, episode_id: int, name: str, pseudonym: str) -> str:
        if not name:
            return ""
        known = self._people.get((episode_id, name))
        return self._pseudonym(Person.of(name, pseudonym) if pseudonym or not known else known)

    def _pseudonym(self, person: Person) -> str:
        return self._numbers.setdefault(person, f"p{len(self._numbers) + 1}")
