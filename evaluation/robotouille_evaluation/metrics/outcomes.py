"""Success and optimality, from rows; tokens, cost and latency."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import fmean, median

from robotouille_evaluation.metrics.rows import EpisodeRow
from robotouille_evaluation.metrics.trajectory import Trajectory

__all__ = [
    "cost",
    "cost_per_success",
    "invalid_rate",
    "is_optimal",
    "malformed_rate",
    "mean_steps",
    "optimality_rate",
    "seconds_per_call",
    "succeeded",
    "success_rate",
    "success_within",
    "tokens",
]


def success_within(trajectory: Trajectory, budget: int) -> bool:
    """Whether the goal held after at most `budget` steps (paper, section 4.2.2)."""
    return trajectory.goal_step is not None and trajectory.goal_step <= budget


def succeeded(row: EpisodeRow) -> bool:
    """Whether an episode reached the goal within its budget (paper, section 4.2.2).

    The paper's budget is 1.5 times the optimum; the row says which rule its budget follows. An
    episode that an error ended counts as failed.
    """
    return row.outcome.success and row.outcome.steps <= row.budget.steps


def success_rate(rows: Sequence[EpisodeRow]) -> float | None:
    """Episodes that succeeded / episodes; None if there are none (paper, table "successes")."""
    return fmean(map(succeeded, rows)) if rows else None


def optimality_rate(row: EpisodeRow) -> float | None:
    """Steps taken / fewest steps, of a success; 1 is best (paper, section 4.2.2, finding 2).

    None for failures, and where the optimum is not proven.
    """
    optimum = row.optimum
    if not succeeded(row) or not optimum.proven or not optimum.steps:
        return None
    return row.outcome.steps / optimum.steps


def is_optimal(row: EpisodeRow) -> bool | None:
    """Whether a success took the fewest steps; None where `optimality_rate` is."""
    rate = optimality_rate(row)
    return None if rate is None else rate <= 1


def mean_steps(rows: Sequence[EpisodeRow]) -> float | None:
    """The mean number of steps, of successes and failures (paper, table "ablations")."""
    return fmean(row.outcome.steps for row in rows) if rows else None


def invalid_rate(rows: Iterable[EpisodeRow]) -> float | None:
    """Answers that name an action that does not apply / calls of the model; None without calls.

    PlanBench and AgentBench report the like; the paper counts such answers among its action and
    transition failures.
    """
    return _per_call([(row.counts.invalid, row.counts.calls) for row in rows])


def malformed_rate(rows: Iterable[EpisodeRow]) -> float | None:
    """Answers that name no action of the task / calls of the model; None without calls.

    AgentBench calls this "invalid format".
    """
    return _per_call([(row.counts.malformed, row.counts.calls) for row in rows])


def _per_call(pairs: list[tuple[int, int]]) -> float | None:
    calls = sum(count for _, count in pairs)
    return sum(count for count, _ in pairs) / calls if calls else None


def tokens(rows: Iterable[EpisodeRow]) -> tuple[int, int]:
    """Tokens of all prompts, and of all completions."""
    spent = [row.usage for row in rows]
    return sum(u.prompt_tokens for u in spent), sum(u.completion_tokens for u in spent)


def cost(rows: Iterable[EpisodeRow]) -> float | None:
    """What all calls cost together, in US dollars; None where a price is not known."""
    costs = [row.usage.cost for row in rows]
    known = [each for each in costs if each is not None]
    return sum(known) if known and len(known) == len(costs) else None


def cost_per_success(rows: Sequence[EpisodeRow]) -> float | None:
    """The cost of all episodes / successes: what one success costs, failures included."""
    total, successes = cost(rows), sum(map(succeeded, rows))
    return total / successes if total is not None and successes else None


def seconds_per_call(rows: Iterable[EpisodeRow]) -> float | None:
    """The median over episodes of wall seconds / calls: what one answer takes."""
    each = [row.seconds / row.counts.calls for row in rows if row.counts.calls]
    return median(each) if each else None
