"""Tables of cost, variants of tasks, and players compared in pairs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from statistics import fmean

from robotouille.html_report.page import Table, TableRow
from robotouille_evaluation.metrics import outcomes
from robotouille_evaluation.metrics.rows import Pair, ResultRow
from robotouille_evaluation.metrics.statistics import by_pair, success_test
from robotouille_evaluation.packs.published_figures import REACT
from robotouille_evaluation.report import published
from robotouille_evaluation.report.cells import (
    NONE,
    left_out,
    new_table,
    number_text,
    percent,
    published_percent,
    reference_row,
)
from robotouille_evaluation.report.grouping import (
    SETTINGS_OF_VARIANTS,
    by,
    by_player_and_set,
    datasets,
    interval,
    is_ablation,
    named,
    task_number,
    tasks,
)

STOCHASTIC = ("stochastic", "stochastic-paper")
MAX_COMPARED = 30
"""Players compared in pairs. The table has a row for each pair, so it grows quadratically."""


def ablations(rows: Sequence[ResultRow]) -> Table:
    """Return successes, steps and cost by player and data set (paper, table "ablation1")."""
    lines = []
    for name, dataset, group in by_player_and_set(rows):
        goals = outcomes.with_goal(group)
        prompt, completion = outcomes.tokens(group)
        calls = sum(row.counts.calls for row in group)
        cells = (
            f"{len(tasks(group))}",
            f"{sum(map(outcomes.succeeded, goals))}/{len(goals)}" if goals else NONE,
            number_text(outcomes.mean_steps(group), ".2f"),
            f"{calls:,}",
            f"{prompt:,}",
            f"{completion:,}",
            number_text(outcomes.cost(group), ".2f"),
            number_text(outcomes.cost_per_success(group), ".2f"),
            number_text(outcomes.seconds_per_call(group)),
        )
        lines.append(TableRow((name, dataset, *cells)))
    if any(is_ablation(row) and row.dataset == published.ABLATION_DATASET for row in rows):
        lines += map(_published_ablation, published.ABLATIONS)
    columns = ("player", "data set", "tasks", "solved", "mean steps", "calls", "prompt tokens",
               "completion tokens", "cost ($)", "$ per success", "s per call")  # fmt: skip
    return new_table("ablations", "Steps, tokens and cost", columns, lines)


def _published_ablation(each: published.PublishedAblation) -> TableRow:
    cells = (
        f"gpt-4o, {each.name}",
        published.ABLATION_DATASET,
        f"{published.ABLATION_TASKS}",
        f"{each.solved}/{published.ABLATION_EPISODES}",
        number_text(each.steps, ".2f"),
    )
    costs = (number_text(each.cost, ".2f"), number_text(each.cost / each.solved, ".2f"))
    return reference_row(*cells, NONE, NONE, NONE, *costs, NONE)


def variants(rows: Sequence[ResultRow]) -> Table:
    """Return success with and without random reversals and delays, by task.

    The paper has the tables "stochastic-results" and "dataset-comparison".
    """
    names = ("", *STOCHASTIC, "delay-free")
    lines = []
    for player, own in named(rows, SETTINGS_OF_VARIANTS).items():
        for kind, group in sorted(by(own, lambda row: row.kind).items()):
            for dataset, in_set in datasets(group).items():
                for task, episodes in tasks(in_set).items():
                    by_name = by(episodes, lambda row: row.variant)
                    if by_name.keys() - {""}:
                        cells = [percent(interval(by_name.get(name, ()), outcomes.succeeded))
                                 for name in names]  # fmt: skip
                        place = (player, kind, dataset, task.rpartition("/")[2])
                        lines.append(TableRow((*place, *cells)))
    if lines:
        lines += _published_variants(rows)
    columns = ("player", "kind", "data set", "task", "original", "stochastic",
               "stochastic-paper", "delay-free")  # fmt: skip
    note = (
        "Stochastic: one cut item at most reverts to uncut in each episode, in each step with the "
        "probability 0.1 of the published code. The paper's text says 0.33, and stochastic-paper "
        "uses that; the published numbers are next to the code. Delay-free: nothing takes "
        "time, and the step budgets are for kitchens without delays."
    )
    return new_table("variants", "Variants", columns, lines, note)


def _published_variants(rows: Sequence[ResultRow]) -> Iterator[TableRow]:
    """Yield published results of the variants that were played, by the names of own tasks."""
    stochastic = {n: (plain, less, None, None) for n, (plain, less) in published.STOCHASTIC.items()}
    delay_free = {
        n: (delayed, None, None, free)
        for n, (free, delayed) in published.SYNCHRONOUS_VARIANTS.items()
    }
    for dataset, variants, known in (
        ("synchronous", STOCHASTIC, stochastic),
        ("asynchronous", ("delay-free",), delay_free),
    ):
        own = datasets(rows).get(dataset, [])
        if not any(row.variant in variants for row in own):
            continue
        names = {task_number(task): task.rpartition("/")[2] for task in tasks(own)}
        for number, values in known.items():
            task = names.get(number, f"the paper's task {number}")
            yield reference_row(REACT, NONE, dataset, task, *map(published_percent, values))


def comparisons(rows: Sequence[ResultRow]) -> Table:
    """Compare every two players on their common episodes, by mean if they have several results."""
    results: Mapping[str, dict[Pair, float]] = {
        name: {pair: fmean(map(outcomes.succeeded, own)) for pair, own in by_pair(group).items()}
        for name, group in named(rows).items()
    }
    lines = []
    names = sorted(sorted(results, key=lambda name: -len(results[name]))[:MAX_COMPARED])
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            both = sorted(results[one].keys() & results[other].keys(), key=str)
            if not both:
                continue
            mine, theirs = ([results[name][pair] for pair in both] for name in (one, other))
            p, _ = success_test(mine, theirs)
            counts = (f"{sum(mine):.10g}", f"{sum(theirs):.10g}", str(len(both)))
            lines.append(TableRow((one, other, *counts, "< 0.001" if p < 0.001 else f"{p:.3f}")))
    columns = ("one", "other", "one solves", "other solves", "of", "p")
    note = (
        "McNemar's exact test on episodes with the same instance and seed, without correction for "
        "multiple comparisons. An episode that was played several times counts with its mean, and "
        "then a permutation test replaces McNemar's."
    )
    note += left_out("players", results, names)
    return new_table("comparisons", "Players compared in pairs", columns, lines, note)
