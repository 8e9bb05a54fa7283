"""Names and free text in exported rows: columns to leave out, and pseudonyms for names."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from enum import Flag, auto
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille_data.exports.people import Person, participations
from robotouille_data.schema import EVENTS, SEATS

RowChange = Callable[[tuple[Any, ...]], tuple[Any, ...]]


class Content(Flag):
    """Personal data that a text may contain."""

    NOTHING = 0
    NAMES = auto()
    WORDS = auto()
    BOTH = NAMES | WORDS


COLUMNS: Mapping[str, Mapping[str, Content]] = {
    "episodes": {
        **dict.fromkeys(
            ("episode", "state", "created", "started", "ended", "software", "task", "digest",
             "timing", "clock", "absence", "chat", "reason"),
            Content.NOTHING,
        ),
        "phrases": Content.WORDS,
        "detail": Content.BOTH,
        "code": Content.NAMES,
        "owner": Content.NAMES,
    },
    # `Privacy.change` replaces names, pseudonyms and details, so their columns remain.
    "seats": {
        **dict.fromkeys(("player", "name", "kind", "participant", "shown_as"), Content.NOTHING),
        # A client writes it, so it may say anything.
        "agent": Content.BOTH,
    },
    "steps": dict.fromkeys(("activity", "controller", "action", "arguments"), Content.NOTHING),
    "events": {
        **dict.fromkeys(("kind", "name", "details"), Content.NOTHING),
        "text": Content.WORDS,
    },
    "labels": dict.fromkeys(("name", "value"), Content.NOTHING),
    "measures": {},
}  # fmt: skip
"""Content of the columns of text. A column that is missing here counts as `BOTH`: it is left out
with the names and with the texts until its content is declared."""


PLAIN_FIELDS = frozenset((
    "basis", "clock_ms", "code", "controller", "generation", "heard", "holds", "intent", "kind",
    "more", "ms", "participant", "present", "ready", "seq", "session", "taken", "target", "utc_ms",
    "what",
))  # fmt: skip
"""Fields of events without free text."""


WRITTEN_FIELDS = frozenset(("reasoning", "reasons", "topic", "why"))
"""Fields of events with free text, left out with the texts. Fields in neither list are left out
with the names and with the texts."""


class Privacy:
    """Rules for leaving out or replacing personal data in the rows of episodes."""

    def __init__(
        self, connection: Connection, ids: Sequence[int], *, names: bool, texts: bool
    ) -> None:
        self._names, self._texts = names, texts
        left_out = (names, Content.NAMES), (texts, Content.WORDS)
        self._gone = Content(sum(content.value for kept, content in left_out if not kept))
        self._numbers: dict[Person, str] = {}
        self._people: dict[tuple[int, str], Person] = {}
        if not names:
            for participation in participations(connection, ids):
                self._people[participation.episode_id, participation.name] = participation.person
                self._pseudonym(participation.person)

    def columns(self, table: sa.Table) -> list[sa.Column[Any]]:
        """Return the columns of a table that remain."""
        known = COLUMNS.get(table.name, {})
        return [
            column
            for column in table.columns
            # Numbers identify nobody. Only text can contain names and words.
            if not isinstance(column.type, sa.Text)
            or not known.get(column.name, Content.BOTH) & self._gone
        ]

    def change(self, table: sa.Table) -> RowChange | None:
        """Return the function that changes rows of these columns; None if they stay the same."""
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
        written = row[7:-1]  # The column `text`, if it remains.
        fields = PLAIN_FIELDS | WRITTEN_FIELDS if self._texts else PLAIN_FIELDS
        details = {key: value for key, value in json.loads(row[-1]).items() if key in fields}
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
        # A message has the sender's name but no pseudonym. Names are distinct within an episode, so
        # the name finds the person who had a seat.
        known = self._people.get((episode_id, name))
        return self._pseudonym(Person.of(name, pseudonym) if pseudonym or not known else known)

    def _pseudonym(self, person: Person) -> str:
        return self._numbers.setdefault(person, f"p{len(self._numbers) + 1}")
