"""First version of the schema: all tables, and the view `episode_seats`."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

# PostgreSQL's avg() of an integer is a decimal. The cast gives both databases the same type.
VIEW = """
CREATE VIEW episode_seats AS
SELECT e.id AS episode_id, e.episode, e.state, e.created, e.started, e.ended, e.task, e.clock,
       e.reason, m.success, e.steps, e.seconds, e.active_seconds,
       s.seat, s.player, s.name, s.kind, s.participant,
       s.acted, s.busy, s.waiting, s.idle, s.away, s.substituted, s.waits, s.unused, s.hindered,
       s.lost, s.invalid, s.malformed, s.rejected, s.said, s.thinking_ms, s.staleness,
       s.contribution, s.shown_as, s.delay_ms, s.agent,
       (SELECT CAST(avg(t.ms) AS DOUBLE PRECISION) FROM steps t
        WHERE t.episode_id = s.episode_id AND t.seat = s.seat AND t.activity = 'acted'
       ) AS decision_ms
FROM episodes e
JOIN seats s ON s.episode_id = e.id
JOIN measures m ON m.episode_id = e.id
"""


def upgrade() -> None:
    """Create all tables and the view."""
    op.create_table(
        "episodes",
        sa.Column("id", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("episode", sa.Text(), nullable=False),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("created", sa.Text(), nullable=False),
        sa.Column("started", sa.Text()),
        sa.Column("ended", sa.Text()),
        sa.Column("software", sa.Text(), nullable=False),
        sa.Column("task", sa.Text(), nullable=False),
        sa.Column("digest", sa.Text(), nullable=False),
        sa.Column("timing", sa.Text(), nullable=False),
        sa.Column("seed", sa.BigInteger(), nullable=False),
        sa.Column("clock", sa.Text(), nullable=False),
        sa.Column("step_rate", sa.Double()),
        sa.Column("max_steps", sa.Integer(), nullable=False),
        sa.Column("absence", sa.Text(), nullable=False),
        sa.Column("grace", sa.Double()),
        sa.Column("chat", sa.Text(), nullable=False),
        sa.Column("phrases", sa.Text(), nullable=False),
        sa.Column("seats", sa.Integer(), nullable=False),
        sa.Column("reason", sa.Text()),
        sa.Column("detail", sa.Text()),
        sa.Column("steps", sa.Integer(), nullable=False),
        sa.Column("seconds", sa.Double(), nullable=False),
        sa.Column("active_seconds", sa.Double(), nullable=False),
        sa.Column("code", sa.Text(), nullable=False),
        sa.Column("owner", sa.Text(), nullable=False),
    )
    op.create_index("episodes_task", "episodes", ["task"])
    op.create_table(
        "events",
        sa.Column("episode_id", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("number", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("step", sa.Integer(), nullable=False),
        sa.Column("t", sa.BigInteger(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("seat", sa.Integer()),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("details", sa.Text(), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_index("events_kind", "events", ["kind"])
    op.create_table(
        "labels",
        sa.Column("episode_id", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("name", sa.Text(), primary_key=True),
        sa.Column("value", sa.Text(), nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_index("labels_value", "labels", ["name", "value"])
    op.create_table(
        "measures",
        sa.Column("episode_id", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("success", sa.Boolean()),
        sa.Column("fewest_steps", sa.Integer()),
        sa.Column("optimality_rate", sa.Double()),
        sa.Column("repeated_transitions", sa.Integer(), nullable=False),
        sa.Column("blocking", sa.Integer(), nullable=False),
        sa.Column("steps_to_go_least", sa.Integer()),
        sa.Column("steps_to_go_most", sa.Integer()),
        sa.Column("out_of_reach", sa.Boolean()),
    )
    op.create_table(
        "recordings",
        sa.Column("path", sa.Text(), primary_key=True),
        sa.Column("size", sa.BigInteger(), nullable=False),
        sa.Column("mtime_ns", sa.BigInteger(), nullable=False),
        sa.Column("digest", sa.Text(), nullable=False),
        sa.Column("episode_id", sa.BigInteger()),
        sa.Column("fault", sa.Text(), nullable=False),
    )
    op.create_index("recordings_episode", "recordings", ["episode_id"])
    op.create_table(
        "seats",
        sa.Column("episode_id", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("seat", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("player", sa.Text(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("participant", sa.Text(), nullable=False),
        sa.Column("acted", sa.Integer(), nullable=False),
        sa.Column("busy", sa.Integer(), nullable=False),
        sa.Column("waiting", sa.Integer(), nullable=False),
        sa.Column("idle", sa.Integer(), nullable=False),
        sa.Column("away", sa.Integer(), nullable=False),
        sa.Column("substituted", sa.Integer(), nullable=False),
        sa.Column("waits", sa.Integer(), nullable=False),
        sa.Column("unused", sa.Integer()),
        sa.Column("hindered", sa.Integer()),
        sa.Column("lost", sa.Integer(), nullable=False),
        sa.Column("invalid", sa.Integer(), nullable=False),
        sa.Column("malformed", sa.Integer(), nullable=False),
        sa.Column("rejected", sa.Integer(), nullable=False),
        sa.Column("said", sa.Integer(), nullable=False),
        sa.Column("thinking_ms", sa.BigInteger(), nullable=False),
        sa.Column("staleness", sa.Double()),
        sa.Column("contribution", sa.Double(), nullable=False),
        sa.Column("shown_as", sa.Text(), nullable=False, server_default=""),
        sa.Column("delay_ms", sa.Integer(), nullable=False, server_default="0"),
        sa.Column("agent", sa.Text(), nullable=False, server_default=""),
    )
    op.create_index("seats_participant", "seats", ["participant"])
    op.create_table(
        "steps",
        sa.Column("episode_id", sa.BigInteger(), primary_key=True, autoincrement=False),
        sa.Column("step", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("seat", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("t", sa.BigInteger(), nullable=False),
        sa.Column("late_ms", sa.BigInteger(), nullable=False),
        sa.Column("activity", sa.Text(), nullable=False),
        sa.Column("waits", sa.Boolean(), nullable=False),
        sa.Column("useful", sa.Boolean()),
        sa.Column("controller", sa.Text(), nullable=False),
        sa.Column("action", sa.Text()),
        sa.Column("arguments", sa.Text()),
        sa.Column("applied", sa.Boolean()),
        sa.Column("ms", sa.BigInteger()),
        sa.Column("staleness", sa.Integer()),
        sqlite_with_rowid=False,
    )
    op.execute(VIEW)
