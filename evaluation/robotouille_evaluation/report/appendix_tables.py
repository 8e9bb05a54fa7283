"""Tables of results that the paper's appendix discusses: horizons and recovery."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import fmean

from robotouille.html_report.page import Table, TableRow
from robotouille_evaluation.metrics import outcomes
from robotouille_evaluation.metrics.rows import Category, ResultRow
from robotouille_evaluation.metrics.statistics import rank_correlation
from robotouille_evaluation.packs.published_figures import REACT
from robotouille_evaluation.report import published
from robotouille_evaluation.report.cells import (
    mean_of_known,
    new_table,
    number_text,
    percent_of,
    published_percent,
    reference_row,
)
from robotouille_evaluation.report.grouping import by_player_and_set, tasks

MIN_TASKS = 3
"""Fewest tasks for a correlation."""


def horizons(rows: Sequence[ResultRow]) -> Table:
    """Return how success falls with the horizon (appendix "Differences in Horizon Performance")."""
    lines = []
    played = set()
    for name, dataset, episodes in by_player_and_set(rows):
        points = list(_horizon_and_success(episodes))
        if len(points) >= MIN_TASKS:
            played.add(dataset)
            found = number_text(rank_correlation(*zip(*points, strict=True)), ".2f")
            lines.append(TableRow((name, dataset, str(len(points)), found)))
    for dataset, horizon in published.HORIZONS.items():
        for strategy, rates in published.SUCCESS_BY_TASK[dataset].items():
            if dataset in played:
                theirs = number_text(rank_correlation(horizon, rates), ".2f")
                lines.append(reference_row(f"gpt-4o, {strategy}", dataset, "10", theirs))
    note = (
        "Spearman's rank correlation of the tasks' success rates with their mean fewest steps: -1 "
        "if longer tasks always fail more often, undefined if all rates are equal. Published: "
        "computed from the rates and horizons that the paper prints. With ten tasks, values "
        "between -0.65 and 0.65 are not significant (5 %)."
    )
    columns = ("player", "data set", "tasks", "rank correlation")
    return new_table("horizons", "Success and horizon", columns, lines, note)


def _horizon_and_success(rows: Sequence[ResultRow]) -> Iterator[tuple[float, float]]:
    """Yield the mean fewest steps and the success rate of each task with known plans."""
    for episodes in tasks(rows).values():
        horizon = mean_of_known(row.optimum.steps for row in episodes)
        if horizon is not None:
            yield horizon, fmean(map(outcomes.succeeded, episodes))


def recovery(rows: Sequence[ResultRow]) -> Table:
    """Return recovery in failures (appendix "Transition Failure Recovery Analysis")."""
    lines = []
    played = set()
    for name, dataset, episodes in by_player_and_set(rows):
        found = [row.measures for row in episodes if _is_transition_failure(row)]
        recovered = [each for each in found if each.recovered]
        kept = [each for each in recovered if not each.repeated_mistakes]
        if found:
            played.add(dataset)
            shares = (
                percent_of(len(recovered) / len(found)),
                percent_of(len(kept) / len(recovered) if recovered else None),
            )
            lines.append(TableRow((name, dataset, str(len(found)), *shares)))
    for dataset, (failures, overcome, learnt) in published.RECOVERY.items():
        if dataset in played:
            shares = (published_percent(overcome), published_percent(learnt))
            lines.append(reference_row(REACT, dataset, str(failures), *shares))
    note = (
        "Of the transition failures: share that recovered from a mistake, and share of these that "
        "did not repeat one. In the paper, people judged both. Here, a failure recovered if an "
        "action was applied after a rejected answer. That is easier, so compare players with each "
        "other rather than with the published shares."
    )
    columns = ("player", "data set", "transition failures", "recovered", "not repeated")
    return new_table("recovery", "Recovery in transition failures", columns, lines, note)


def _is_transition_failure(row: ResultRow) -> bool:
    failure = row.measures.failure
    return failure is not None and failure.category is Category.TRANSITION
