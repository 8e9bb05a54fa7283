"""Tables of the catalogue. docs/data.md lists the `doc` of each column.

Migrations create the tables: a change here needs a new migration.
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

METADATA = MetaData()

RECORDINGS = Table(
    "recordings",
    METADATA,
    Column("path", Text, primary_key=True, doc="path of the file"),
    Column("size", BigInteger, nullable=False, doc="file size in bytes"),
    Column("mtime_ns", BigInteger, nullable=False, doc="modification time, in ns since 1970"),
    Column("digest", Text, nullable=False, doc="SHA-256 of the content; empty if it was not read"),
    Column("episode_id", BigInteger, doc="`episodes.id`; null if there is a fault"),
    Column("fault", Text, nullable=False, doc="why it has no episode; empty if it has one"),
    Index("recordings_episode", "episode_id"),
)

# Ids come from the content and not from a sequence: several indexers may write, and an index made
# again must keep the ids that a researcher has written down.
EPISODES = Table(
    "episodes",
    METADATA,
    Column("id", BigInteger, primary_key=True, autoincrement=False,
           doc="first 63 bits of the recording's SHA-256; copies of a file are one episode"),
    Column("episode", Text, nullable=False, doc="id assigned by the server"),
    Column("state", Text, nullable=False, doc="`ended`, or `unfinished` if no end is recorded"),
    Column("created", Text, nullable=False, doc="when it was opened (ISO 8601, UTC)"),
    Column("started", Text, doc="start of the game (ISO 8601, UTC); null if unknown"),
    Column("ended", Text, doc="end of the episode (ISO 8601, UTC); null if unknown"),
    Column("software", Text, nullable=False, doc="version that recorded it"),
    Column("task", Text, nullable=False, doc="task name"),
    Column("digest", Text, nullable=False, doc="content hash of the task"),
    Column("timing", Text, nullable=False, doc="`benchmark` or `people`"),
    Column("seed", BigInteger, nullable=False, doc="random seed of the task"),
    Column("clock", Text, nullable=False, doc="`turn`, `lockstep` or `realtime`"),
    Column("step_rate", Double, doc="steps per second; null unless in real time"),
    Column("max_steps", Integer, nullable=False, doc="step limit"),
    Column("absence", Text, nullable=False, doc="absence rule: `wait`, `pause`, …"),
    Column("grace", Double, doc="seconds for which an absent participant's seat is kept"),
    Column("chat", Text, nullable=False, doc="`free`, `phrases` or `off`"),
    Column("phrases", Text, nullable=False, doc="permitted phrases, as a JSON list"),
    Column("seats", Integer, nullable=False, doc="number of seats"),
    Column("reason", Text, doc="why it ended: `goal`, `step_limit`, `abandoned`, …"),
    Column("detail", Text, doc="the reason in words; may be empty"),
    Column("steps", Integer, nullable=False, doc="number of steps"),
    Column("seconds", Double, nullable=False, doc="duration in seconds, pauses included"),
    Column("active_seconds", Double, nullable=False, doc="duration in seconds, without pauses"),
    Column("code", Text, nullable=False, doc="code to join it"),
    Column("owner", Text, nullable=False, doc="pseudonym of the owner; may be empty"),
    Index("episodes_task", "task"),
)  # fmt: skip

SEATS = Table(
    "seats",
    METADATA,
    Column("episode_id", BigInteger, primary_key=True, autoincrement=False, doc="`episodes.id`"),
    Column("seat", Integer, primary_key=True, autoincrement=False, doc="seat number, from 0"),
    Column("player", Text, nullable=False, doc="player name in the task, such as `robot1`"),
    Column("name", Text, nullable=False, doc="name of the last participant; may be empty"),
    Column("kind", Text, nullable=False, doc="`human`, `bot` or `model`"),
    Column("participant", Text, nullable=False, doc="pseudonym; empty without a token"),
    Column("acted", Integer, nullable=False, doc="steps with an action of the participant"),
    Column("busy", Integer, nullable=False, doc="steps of walking or working"),
    Column("waiting", Integer, nullable=False, doc="steps after a rejection, or out of turn"),
    Column("idle", Integer, nullable=False, doc="steps in which it could act but did not"),
    Column("away", Integer, nullable=False, doc="steps without anyone in control"),
    Column("substituted", Integer, nullable=False, doc="steps with a substitute in control"),
    Column("waits", Integer, nullable=False,
           doc="steps in which it declared that it waits; people cannot declare it"),
    Column("unused", Integer, doc="inactive steps in which it could act usefully; may be null"),
    Column("hindered", Integer, doc="inactive steps in which it could not; may be null"),
    Column("lost", Integer, nullable=False, doc="actions that failed in their step"),
    Column("invalid", Integer, nullable=False, doc="requests for actions that were invalid"),
    Column("malformed", Integer, nullable=False, doc="requests that were not actions"),
    Column("rejected", Integer, nullable=False, doc="all rejected requests and lost actions"),
    Column("said", Integer, nullable=False, doc="chat messages"),
    Column("thinking_ms", BigInteger, nullable=False, doc="sum of `steps.ms` of its own actions"),
    Column("staleness", Double, doc="mean `steps.staleness` of its own actions"),
    Column("contribution", Double, nullable=False, doc="share of the team's [work](metrics.md)"),
    Column("shown_as", Text, nullable=False, server_default="",
           doc="kind [shown to all](run_a_study.md#disguise-or-delay-a-partner); may be empty"),
    Column("delay_ms", Integer, nullable=False, server_default="0",
           doc="ms added to each action; included in `steps.ms`"),
    Column("agent", Text, nullable=False, server_default="",
           doc="what played, in its own words: program, settings, skill; empty for people"),
    Index("seats_participant", "participant"),
)  # fmt: skip

STEPS = Table(
    "steps",
    METADATA,
    Column("episode_id", BigInteger, primary_key=True, autoincrement=False, doc="`episodes.id`"),
    Column("step", Integer, primary_key=True, autoincrement=False, doc="step number, from 1"),
    Column("seat", Integer, primary_key=True, autoincrement=False, doc="`seats.seat`"),
    Column("t", BigInteger, nullable=False, doc="ms from the start until the step was due"),
    Column("late_ms", BigInteger, nullable=False,
           doc="ms from then until the step was taken; 0 except in real time"),
    Column("activity", Text, nullable=False,
           doc="`acted`, `busy`, `waiting`, `idle`, `away` or `substituted`"),
    Column("waits", Boolean, nullable=False, doc="whether the seat declared that it waits"),
    Column("useful", Boolean,
           doc="whether an inactive seat could act usefully; null for others, or if not computed"),
    Column("controller", Text, nullable=False,
           doc="`human`, `bot`, `model`, `absent` or `substitute`; empty if the seat was free"),
    Column("action", Text, doc="action name; null without an action"),
    Column("arguments", Text, doc="objects of the action, separated by spaces"),
    Column("applied", Boolean, doc="false if another action of the step prevented it"),
    Column("ms", BigInteger, doc="ms from when the seat could act until it acted"),
    Column("staleness", Integer, doc="age in steps of the state that the action was based on"),
    sqlite_with_rowid=False,
)  # fmt: skip

EVENTS = Table(
    "events",
    METADATA,
    Column("episode_id", BigInteger, primary_key=True, autoincrement=False, doc="`episodes.id`"),
    Column("number", Integer, primary_key=True, autoincrement=False, doc="position, from 0"),
    Column("step", Integer, nullable=False, doc="step after which it happened"),
    Column("t", BigInteger, nullable=False, doc="ms since the start"),
    Column("kind", Text, nullable=False,
           doc="[type of note](recording_format.md): `said`, `rejected`, `roster`, …"),
    Column("seat", Integer, doc="seat number; null if no seat is concerned"),
    Column("name", Text, nullable=False, doc="who spoke, joined or left; may be empty"),
    Column("text", Text, nullable=False, doc="text said, requested or noted; may be empty"),
    Column("details", Text, nullable=False, doc="all other fields of the note, as a JSON object"),
    Index("events_kind", "kind"),
    sqlite_with_rowid=False,
)  # fmt: skip

LABELS = Table(
    "labels",
    METADATA,
    Column("episode_id", BigInteger, primary_key=True, autoincrement=False, doc="`episodes.id`"),
    Column("name", Text, primary_key=True, doc="label name, such as `condition`"),
    Column("value", Text, nullable=False, doc="label value"),
    Index("labels_value", "name", "value"),
    sqlite_with_rowid=False,
)

MEASURES = Table(
    "measures",
    METADATA,
    Column("episode_id", BigInteger, primary_key=True, autoincrement=False, doc="`episodes.id`"),
    Column("success", Boolean, doc="whether the goal was reached; null if unfinished or a shift"),
    Column("fewest_steps", Integer, doc="length of the shortest plan, from a shipped certificate"),
    Column("optimality_rate", Double, doc="for a success: steps / fewest steps; 1 is best"),
    Column("repeated_transitions", Integer, nullable=False,
           doc="steps that repeat an earlier one: same state, same actions"),
    Column("blocking", Integer, nullable=False,
           doc="actions rejected because of another player"),
    Column("steps_to_go_least", Integer, doc="lower bound on the steps from the end to the goal"),
    Column("steps_to_go_most", Integer, doc="upper bound on the same; null if unknown"),
    Column("out_of_reach", Boolean, doc="whether no plan reaches the goal; null if not computed"),
    Column("score", Integer, doc="points of a [shift](shifts.md); null if unfinished or no shift"),
    Column("served", Integer, doc="orders served in a shift; null like `score`"),
    Column("expired", Integer, doc="orders that expired in a shift; null like `score`"),
    Column("score_bound", Integer,
           doc="points that nobody can exceed in a shift: each order is served a step after its "
               "arrival; null if no shift"),
)  # fmt: skip

VIEWS = MetaData()
"""Views on the tables."""


def _same(table: Table, *names: str) -> list[Column[Any]]:
    """Return copies of columns of a table."""
    columns = [table.c[name] for name in names]
    return [Column(its.name, its.type, nullable=its.nullable, doc=its.doc) for its in columns]


EPISODE_SEATS = Table(
    "episode_seats",
    VIEWS,
    Column("episode_id", BigInteger, nullable=False, doc="`episodes.id`"),
    *_same(EPISODES, "episode", "state", "created", "started", "ended", "task", "clock", "reason"),
    *_same(MEASURES, "success", "score"),
    *_same(EPISODES, "steps", "seconds", "active_seconds"),
    *_same(SEATS, "seat", "player", "name", "kind", "participant", "acted", "busy", "waiting",
           "idle", "away", "substituted", "waits", "unused", "hindered", "lost", "invalid",
           "malformed", "rejected", "said", "thinking_ms", "staleness", "contribution",
           "shown_as", "delay_ms", "agent"),
    Column("decision_ms", Double, doc="mean `steps.ms` of the steps in which it acted"),
)  # fmt: skip

EPISODE_TABLES = (EPISODES, SEATS, STEPS, EVENTS, LABELS, MEASURES)
"""Tables with rows of episodes. Deleting an episode deletes its rows from all of them."""
