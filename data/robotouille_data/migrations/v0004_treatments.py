"""What a study did to seats; times that compare with dates."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

__all__ = ["down_revision", "revision", "upgrade"]

revision = "0004"
down_revision = "0003"

CREATED = """
UPDATE episodes
SET created = substr(created, 1, 4) || '-' || substr(created, 5, 2) || '-' || substr(created, 7, 5)
              || ':' || substr(created, 12, 2) || ':' || substr(created, 14)
WHERE created LIKE '________T______Z'
"""
VIEW = """
CREATE VIEW episode_seats AS
SELECT e.id AS episode_id, e.episode, e.state, e.created, e.task, e.clock, e.reason, m.success,
       e.steps, e.seconds, s.seat, s.player, s.name, s.kind, s.participant,
       s.acted, s.busy, s.waiting, s.idle, s.away, s.substituted,
       s.lost, s.invalid, s.malformed, s.rejected, s.said, s.thinking_ms, s.staleness,
       s.contribution, s.shown_as, s.delay_ms,
       (SELECT CAST(avg(t.ms) AS DOUBLE PRECISION) FROM steps t
        WHERE t.episode_id = s.episode_id AND t.seat = s.seat AND t.activity = 'acted'
       ) AS decision_ms
FROM episodes e
JOIN seats s ON s.episode_id = e.id
JOIN measures m ON m.episode_id = e.id
"""


def upgrade() -> None:
    """Add the columns, and make the view anew.

    What was done to the seats of episodes that are there is read when they are indexed anew.
    """
    op.execute("DROP VIEW episode_seats")
    op.add_column("seats", sa.Column("shown_as", sa.Text(), nullable=False, server_default=""))
    op.add_column("seats", sa.Column("delay_ms", sa.Integer(), nullable=False, server_default="0"))
    op.execute(CREATED)
    op.execute(VIEW)
