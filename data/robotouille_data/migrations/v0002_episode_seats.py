"""A view with a row for each episode and seat, so that the commonest query is short."""

from __future__ import annotations

from alembic import op

__all__ = ["down_revision", "revision", "upgrade"]

revision = "0002"
down_revision = "0001"

VIEW = """
CREATE VIEW episode_seats AS
SELECT e.id AS episode_id, e.episode, e.state, e.created, e.task, e.clock, e.reason, m.success,
       e.steps, e.seconds, s.seat, s.player, s.name, s.kind, s.participant,
       s.acted, s.busy, s.waiting, s.idle, s.away, s.substituted,
       s.lost, s.invalid, s.malformed, s.rejected, s.said, s.thinking_ms, s.staleness,
       s.contribution,
       (SELECT CAST(avg(t.ms) AS DOUBLE PRECISION) FROM steps t
        WHERE t.episode_id = s.episode_id AND t.seat = s.seat AND t.activity = 'acted'
       ) AS decision_ms
FROM episodes e
JOIN seats s ON s.episode_id = e.id
JOIN measures m ON m.episode_id = e.id
"""


def upgrade() -> None:
    """Make the view."""
    op.execute(VIEW)
