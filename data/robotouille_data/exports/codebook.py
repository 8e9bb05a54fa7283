"""What the columns of the catalogue mean, for those who do not have its documentation."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import sqlalchemy as sa

from robotouille_data.exports.part import Entry, Field

__all__ = ["UNITS", "table_entry"]

UNITS = {
    "seats.thinking_ms": "ms",
    "seats.delay_ms": "ms",
    "steps.t": "ms",
    "steps.ms": "ms",
    "events.t": "ms",
    "episodes.seconds": "s",
    "episodes.step_rate": "1/s",
    "episodes.max_steps": "steps",
    "episodes.steps": "steps",
    "measures.fewest_steps": "steps",
    "measures.steps_to_go_least": "steps",
    "measures.steps_to_go_most": "steps",
    "measures.repeated_transitions": "steps",
    "measures.blocking": "actions",
    "steps.staleness": "steps",
    "seats.staleness": "steps",
    "seats.lost": "actions",
    "seats.invalid": "requests",
    "seats.malformed": "requests",
    "seats.rejected": "requests",
    "seats.said": "messages",
    **{
        f"seats.{name}": "steps"
        for name in ("acted", "busy", "waiting", "idle", "away", "substituted")
    },
}
"""The units of numbers; those that are not here count nothing, or are shares."""

MEANINGS = {
    "episodes": "one row for each episode",
    "seats": "one row for each seat of an episode",
    "steps": "one row for each step and seat of an episode",
    "events": "what happened between the steps: who came and went, chat, requests in vain, pauses",
    "labels": "one row for each label of an episode",
    "measures": "one row for each episode: how well its team did",
}

LINK = re.compile(r"\[([^\]]+)\]\([^)]*\)")


def table_entry(table: sa.Table, columns: Iterable[sa.Column[Any]]) -> Entry:
    """What the codebook says of a table, of which these columns are left."""
    fields = tuple(
        Field(
            column.name,
            type(column.type).__name__.lower(),
            LINK.sub(r"\1", column.doc or ""),
            UNITS.get(f"{table.name}.{column.name}", ""),
            bool(column.nullable),
        )
        for column in columns
    )
    return Entry(table.name, MEANINGS[table.name], fields)
