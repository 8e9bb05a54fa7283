"""Metrics: pure functions of a trajectory, or of rows. docs/metrics.md defines each."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille_evaluation.metrics.failures import Failure, classify
    from robotouille_evaluation.metrics.measuring import measure
    from robotouille_evaluation.metrics.outcomes import optimality_rate, succeeded, success_rate
    from robotouille_evaluation.metrics.progress import repeated_transitions, steps_to_go
    from robotouille_evaluation.metrics.rows import (
        BudgetRow,
        Category,
        Counts,
        EpisodeRow,
        Measures,
        Optimum,
        PackId,
        Result,
        Spent,
        read_rows,
        write_rows,
    )
    from robotouille_evaluation.metrics.trajectory import Answer, Move, Trajectory, Verdict
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille_evaluation.metrics.rows",
        "robotouille_evaluation.metrics.trajectory",
        "robotouille_evaluation.metrics.outcomes",
        "robotouille_evaluation.metrics.progress",
        "robotouille_evaluation.metrics.failures",
        "robotouille_evaluation.metrics.measuring",
    )

__all__ = [
    "Answer",
    "BudgetRow",
    "Category",
    "Counts",
    "EpisodeRow",
    "Failure",
    "Measures",
    "Move",
    "Optimum",
    "PackId",
    "Result",
    "Spent",
    "Trajectory",
    "Verdict",
    "classify",
    "measure",
    "optimality_rate",
    "read_rows",
    "repeated_transitions",
    "steps_to_go",
    "succeeded",
    "success_rate",
    "write_rows",
]
