"""Scores of shifts, also in the view `episode_seats`."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"

# PostgreSQL's avg() of an integer is a decimal. The cast gives both databases the same type.
VIEW = """
CREATE VIEW episode_seats AS
SELECT e.id AS episode_id, e.episode, e.state, e.created, e.started, e.ended, e.task, e.clock,
       e.reason, m.success, m.score, e.steps, e.seconds, e.active_seconds,
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
    """Add the columns, and create the view again."""
    for name in ("score", "served", "expired", "score_bound"):
        op.add_column("measures", sa.Column(name, sa.Integer()))
    op.execute("DROP VIEW episode_seats")
    op.execute(VIEW)
