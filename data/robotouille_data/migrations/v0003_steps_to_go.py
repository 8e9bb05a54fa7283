"""How far from the goal episodes ended."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

__all__ = ["down_revision", "revision", "upgrade"]

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Add the columns; of a success all is known."""
    op.add_column("measures", sa.Column("steps_to_go_least", sa.Integer()))
    op.add_column("measures", sa.Column("steps_to_go_most", sa.Integer()))
    op.add_column("measures", sa.Column("out_of_reach", sa.Boolean()))
    success = sa.table(
        "measures",
        sa.column("success", sa.Boolean()),
        sa.column("steps_to_go_least", sa.Integer()),
        sa.column("steps_to_go_most", sa.Integer()),
        sa.column("out_of_reach", sa.Boolean()),
    )
    op.execute(
        success.update()
        .where(success.c.success == sa.true())
        .values(steps_to_go_least=0, steps_to_go_most=0, out_of_reach=sa.false())
    )
