"""The tables of the catalogue. What each column means is its `doc`, and in docs/data.md.

Migrations make them: a change here needs a new one in `migrations`.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Double,
    Index,
    Integer,
    MetaData,
    Table,
    Text,
)

__all__ = [
    "EPISODES",
    "EPISODE_SEATS",
    "EPISODE_TABLES",
    "EVENTS",
    "LABELS",
    "MEASURES",
    "METADATA",
    "RECORDINGS",
    "SEATS",
    "STEPS",
    "VIEWS",
]

METADATA = MetaData()

RECORDINGS = Table(
    "recordings",
    METADATA,
    Column("path", Text, primary_key=True, doc="the file"),
    Column("size", BigInteger, nullable=False, doc="its bytes"),
    Column("mtime_ns", BigInteger, nullable=False, doc="when it was changed, in ns since 1970"),
    Column("digest", Text, nullable=False, doc="SHA-256 of its content; empty: not read"),
    Column("episode_id", BigInteger, doc="its episode; null where there is a fault"),
    Column("fault", Text, nullable=False, doc="why it is not in the catalogue; empty: it is"),
    Index("recordings_episode", "episode_id"),
)

EPISODES = Table(
    "episodes",
    METADATA,
    Column("id", BigInteger, primary_key=True, autoincrement=False,
           doc="the first 63 bits of the recording's SHA-256: copies of a file are one episode"),
    Column("episode", Text, nullable=False, doc="the id that the server gave it"),
    Column("state", Text, nullable=False, doc="`ended`, or `unfinished`: the end is not recorded"),
    Column("created", Text, nullable=False, doc="when it was opened, ISO 8601 in UTC"),
    Column("software", Text, nullable=False, doc="the version that recorded it"),
    Column("task", Text, nullable=False, doc="the task's name"),
    Column("digest", Text, nullable=False, doc="the task's content hash"),
    Column("timing", Text, nullable=False, doc="`benchmark` or `people`"),
    Column("seed", BigInteger, nullable=False, doc="of what was random in the task"),
    Column("clock", Text, nullable=False, doc="`turn`, `lockstep` or `realtime`"),
    Column("step_rate", Double, doc="steps a second, in real time"),
    Column("max_steps", Integer, nullable=False, doc="the step limit"),
    Column("absence", Text, nullable=False, doc="what an absence does: `wait`, `pause`, …"),
    Column("seats", Integer, nullable=False, doc="how many seats there are"),
    Column("reason", Text, doc="why it ended: `goal`, `step_limit`, `abandoned`, …; or null"),
    Column("detail", Text, doc="the same in words, if there are any"),
    Column("steps", Integer, nullable=False, doc="steps taken"),
    Column("seconds", Double, nullable=False, doc="from the beginning to the end, pauses included"),
    Column("code", Text, nullable=False, doc="what one joined with"),
    Column("owner", Text, nullable=False, doc="the pseudonym of who opened it; or empty"),
    Index("episodes_task", "task"),
)  # fmt: skip

SEATS = Table(
    "seats",
    METADATA,
    Column("episode_id", BigInteger, primary_key=True, autoincrement=False, doc="`episodes.id`"),
    Column("seat", Integer, primary_key=True, autoincrement=False, doc="its number, from 0 on"),
    Column("player", Text, nullable=False, doc="the player's name in the task, as `robot1`"),
    Column("name", Text, nullable=False, doc="the last participant's name; empty: there was none"),
    Column("kind", Text, nullable=False, doc="what they are: `human`, `bot` or `model`"),
    Column("participant", Text, nullable=False, doc="their pseudonym; empty without a token"),
    Column("acted", Integer, nullable=False, doc="steps with an action of its participant"),
    Column("busy", Integer, nullable=False, doc="steps in which it walked or worked on"),
    Column("waiting", Integer, nullable=False, doc="steps in which it was refused, or not in turn"),
    Column("idle", Integer, nullable=False, doc="steps in which it could act, and did not"),
    Column("away", Integer, nullable=False, doc="steps in which nobody moved it"),
    Column("substituted", Integer, nullable=False, doc="steps in which a stand-in moved it"),
    Column("lost", Integer, nullable=False, doc="actions lost to another's in their step"),
    Column("invalid", Integer, nullable=False, doc="known actions that were not valid then"),
    Column("malformed", Integer, nullable=False, doc="requests that were no action at all"),
    Column("rejected", Integer, nullable=False, doc="all that was asked for and not done"),
    Column("said", Integer, nullable=False, doc="chat messages"),
    Column("thinking_ms", BigInteger, nullable=False, doc="milliseconds that its actions took"),
    Column("staleness", Double, doc="mean `steps.staleness`; null where no basis is recorded"),
    Column("contribution", Double, nullable=False, doc="its share of the [work](metrics.md) done"),
    Column("shown_as", Text, nullable=False, server_default="",
           doc="what others [saw](studies.md#what-a-study-does-to-a-seat) it as; empty: its kind"),
    Column("delay_ms", Integer, nullable=False, server_default="0",
           doc="by how much a study held its actions back; a part of `steps.ms`"),
    Index("seats_participant", "participant"),
)  # fmt: skip

STEPS = Table(
    "steps",
    METADATA,
    Column("episode_id", BigInteger, primary_key=True, autoincrement=False, doc="`episodes.id`"),
    Column("step", Integer, primary_key=True, autoincrement=False, doc="its number, from 1 on"),
    Column("seat", Integer, primary_key=True, autoincrement=False, doc="`seats.seat`"),
    Column("t", BigInteger, nullable=False, doc="when it was taken, in ms since the game began"),
    Column("activity", Text, nullable=False,
           doc="`acted`, `busy`, `waiting`, `idle`, `away` or `substituted`"),
    Column("controller", Text, nullable=False,
           doc="who moved it: `human`, `bot`, `model`, `absent`, `stand-in`; empty: free"),
    Column("action", Text, doc="the action's name; null without one"),
    Column("arguments", Text, doc="its objects, in order, with spaces between them"),
    Column("applied", Boolean, doc="false: lost to what others did in the step"),
    Column("ms", BigInteger, doc="milliseconds from being asked to acting"),
    Column("staleness", Integer, doc="how many steps old the state was that it was based on"),
    sqlite_with_rowid=False,
)  # fmt: skip

EVENTS = Table(
    "events",
    METADATA,
    Column("episode_id", BigInteger, primary_key=True, autoincrement=False, doc="`episodes.id`"),
    Column("number", Integer, primary_key=True, autoincrement=False, doc="its place, from 0 on"),
    Column("step", Integer, nullable=False, doc="the step after which it happened"),
    Column("t", BigInteger, nullable=False, doc="when, in milliseconds since the game began"),
    Column("kind", Text, nullable=False,
           doc="the [note](recordings.md#the-frames): `said`, `rejected`, `roster`, …"),
    Column("seat", Integer, doc="whose; null: nobody's, or a spectator's"),
    Column("name", Text, nullable=False, doc="who said it, or came or went; or empty"),
    Column("text", Text, nullable=False, doc="what was said, asked for or noted; or empty"),
    Column("details", Text, nullable=False, doc="all other fields of the note, as a JSON object"),
    Index("events_kind", "kind"),
    sqlite_with_rowid=False,
)  # fmt: skip

LABELS = Table(
    "labels",
    METADATA,
    Column("episode_id", BigInteger, primary_key=True, autoincrement=False, doc="`episodes.id`"),
    Column("name", Text, primary_key=True, doc="as `study` or `condition`"),
    Column("value", Text, nullable=False, doc="what the episode has for it"),
    Index("labels_value", "name", "value"),
    sqlite_with_rowid=False,
)

MEASURES = Table(
    "measures",
    METADATA,
    Column("episode_id", BigInteger, primary_key=True, autoincrement=False, doc="`episodes.id`"),
    Column("success", Boolean, doc="whether the goal was reached; null while that is open"),
    Column("fewest_steps", Integer, doc="those of a shipped certificate's shortest plan"),
    Column("optimality_rate", Double, doc="of a success: steps taken / fewest steps; 1 is best"),
    Column("repeated_transitions", Integer, nullable=False,
           doc="steps that repeat an earlier one: same state, same actions"),
    Column("blocking", Integer, nullable=False,
           doc="actions refused or lost because of another player"),
    Column("steps_to_go_least", Integer, doc="steps from its end to the goal, at least; or null"),
    Column("steps_to_go_most", Integer, doc="the same at most; null: not known, or nobody asked"),
    Column("out_of_reach", Boolean, doc="whether no plan leads to the goal; null: nobody asked"),
)  # fmt: skip

VIEWS = MetaData()
"""What is made of the tables, and holds nothing of its own."""


def _same(table: Table, *names: str) -> list[Column[Any]]:
    """Columns as a table has them."""
    columns = [table.c[name] for name in names]
    return [Column(its.name, its.type, nullable=its.nullable, doc=its.doc) for its in columns]


EPISODE_SEATS = Table(
    "episode_seats",
    VIEWS,
    Column("episode_id", BigInteger, nullable=False, doc="`episodes.id`"),
    *_same(EPISODES, "episode", "state", "created", "task", "clock", "reason"),
    *_same(MEASURES, "success"),
    *_same(EPISODES, "steps", "seconds"),
    *_same(SEATS, "seat", "player", "name", "kind", "participant", "acted", "busy", "waiting",
           "idle", "away", "substituted", "lost", "invalid", "malformed", "rejected", "said",
           "thinking_ms", "staleness", "contribution", "shown_as", "delay_ms"),
    Column("decision_ms", Double, doc="mean `steps.ms` of the steps with an action of its own"),
)  # fmt: skip

EPISODE_TABLES = (EPISODES, SEATS, STEPS, EVENTS, LABELS, MEASURES)
"""The tables that hold rows of episodes, by which everything about one is deleted."""
