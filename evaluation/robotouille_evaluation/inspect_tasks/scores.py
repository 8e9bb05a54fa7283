"""What a played episode is worth, in Inspect's words."""

from __future__ import annotations

from math import nan

from inspect_ai.scorer import Metric, Score, Scorer, Target, accuracy, mean, scorer, stderr
from inspect_ai.solver import TaskState

from robotouille_evaluation.inspect_tasks.naming import of_distribution
from robotouille_evaluation.metrics.outcomes import optimality_rate, succeeded
from robotouille_evaluation.metrics.rows import EpisodeRow

__all__ = ["METRICS", "STEPS_TO_GO_METRICS", "keep_row", "outcome"]

ROW = "robotouille_row"

METRICS: dict[str, list[Metric]] = {
    "success": [accuracy(), stderr()],
    "optimality_rate": [mean(), stderr()],
    "invalid": [mean()],
    "malformed": [mean()],
}
STEPS_TO_GO_METRICS: dict[str, list[Metric]] = {
    "steps_to_go_least": [mean()],
    "steps_to_go_most": [mean()],
}


def keep_row(state: TaskState, row: EpisodeRow) -> None:
    """Keep what was played where the scorer, and readers of the log, find it."""
    state.store.set(ROW, row.model_dump(mode="json"))


@scorer(metrics=METRICS)
@of_distribution
def outcome() -> Scorer:
    """Success within the budget, and what docs/metrics.md says of one episode.

    What is not defined for an episode is NaN, which Inspect's metrics leave out: the optimality
    rate of a failure, steps to go where they were not asked for.
    """

    async def score(state: TaskState, target: Target) -> Score:
        raw = state.store.get(ROW)
        if raw is None:
            none = dict.fromkeys([*METRICS, *STEPS_TO_GO_METRICS], nan)
            why = "the episode was broken off before there was a row of it"
            return Score(value={**none, "success": 0}, answer="broken off", explanation=why)
        row = EpisodeRow.model_validate(raw)
        return Score(
            value=_values(row),
            answer=row.outcome.ended_by,
            explanation=_explanation(row),
            metadata=raw,
        )

    return score


def _values(row: EpisodeRow) -> dict[str, str | int | float | bool | None]:
    found: dict[str, str | int | float | bool | None] = {
        "success": int(succeeded(row)),
        "invalid": row.counts.invalid,
        "malformed": row.counts.malformed,
    }
    undefined = {
        "optimality_rate": optimality_rate(row),
        "steps_to_go_least": row.measures.to_go_least,
        "steps_to_go_most": row.measures.to_go_most,
    }
    return found | {name: nan if value is None else value for name, value in undefined.items()}


def _explanation(row: EpisodeRow) -> str:
    best = row.optimum.steps
    optimum = (
        "" if best is None else f", {'optimum' if row.optimum.proven else 'best known'} {best}"
    )
    lines = [
        f"{row.outcome.ended_by} after {row.outcome.steps} of {row.budget.steps} steps{optimum}",
        f"{row.counts.calls} calls, {row.counts.invalid} invalid and "
        f"{row.counts.malformed} malformed answers",
        f"error: {row.error}" if row.error else "",
    ]
    return "\n\n".join(filter(None, lines))
