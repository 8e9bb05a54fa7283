"""Metrics: pure functions of trajectories or rows, which docs/metrics.md defines."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotouille_evaluation.metrics.failures import Failure, classify
    from robotouille_evaluation.metrics.measuring import measure
    from robotouille_evaluation.metrics.outcomes import (
        optimality_rate,
        repeated_transitions,
        score,
        score_share,
        steps_to_go,
        succeeded,
        success_rate,
    )
    from robotouille_evaluation.metrics.rows import (
        BudgetRow,
        Category,
        Counts,
        EpisodeMeasures,
        Optimum,
        PackId,
        Result,
        ResultRow,
        ScoreRow,
        TotalUsage,
        read_rows,
        write_rows,
    )
    from robotouille_evaluation.metrics.trajectory import (
        AnswerVerdict,
        Move,
        StepAnswer,
        Trajectory,
    )
else:
    from robotouille.lazy_exports import lazy_exports

    __getattr__ = lazy_exports(
        __name__,
        "robotouille_evaluation.metrics.rows",
        "robotouille_evaluation.metrics.trajectory",
        "robotouille_evaluation.metrics.outcomes",
        "robotouille_evaluation.metrics.failures",
        "robotouille_evaluation.metrics.measuring",
    )

__all__ = [
    "AnswerVerdict",
    "BudgetRow",
    "Category",
    "Counts",
    "EpisodeMeasures",
    "Failure",
    "Move",
    "Optimum",
    "PackId",
    "Result",
    "ResultRow",
    "ScoreRow",
    "StepAnswer",
    "TotalUsage",
    "Trajectory",
    "classify",
    "measure",
    "optimality_rate",
    "read_rows",
    "repeated_transitions",
    "score",
    "score_share",
    "steps_to_go",
    "succeeded",
    "success_rate",
    "write_rows",
]
