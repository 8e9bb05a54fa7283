"""Tables of how agents succeed and fail: plan lengths, errors, waiting and failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from statistics import fmean

from robotouille.html_report.page import Table, TableRow
from robotouille_evaluation.metrics import outcomes
from robotouille_evaluation.metrics.asynchrony import success_by_asynchronous_first
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.packs.published_figures import REACT
from robotouille_evaluation.report import published
from robotouille_evaluation.report.bins import (
    AWAY,
    FARTHER_AWAY,
    STEPS_TO_GO_BINS,
    bin_of_steps_to_go,
)
from robotouille_evaluation.report.cells import (
    NONE,
    mean_of_known,
    new_table,
    number_text,
    percent,
    percent_of,
    published_percent,
    reference_row,
)
from robotouille_evaluation.report.grouping import by_player_and_set, datasets, interval, named
from robotouille_evaluation.report.reference import Reference


def optimality(rows: Sequence[ResultRow], reference: Reference) -> Table:
    """Return the lengths of successes relative to the optimum (paper, finding 2)."""
    lines = []
    for name, dataset, episodes in by_player_and_set(rows):
        rates = [r for row in episodes if (r := outcomes.optimality_rate(row)) is not None]
        if rates:
            share = percent(interval(episodes, outcomes.is_optimal))
            cells = (
                number_text(fmean(rates), ".2f"),
                number_text(max(rates), ".2f"),
                str(len(rates)),
            )
            lines.append(TableRow((name, dataset, share, *cells)))
    for dataset, bins in reference.optimality.items():
        if any(row.dataset == dataset for row in rows):
            lines.append(
                reference_row(REACT, dataset, published_percent(bins.get("1")), NONE, NONE, NONE)
            )
    note = "Optimality rate: steps taken / fewest steps, of successes with a proven optimum."
    columns = ("player", "data set", "optimal", "mean rate", "largest", "successes")
    return new_table("optimality", "Optimality of successes", columns, lines, note)


def steps_to_go(rows: Sequence[ResultRow], reference: Reference) -> Table:
    """Return the distance of failures from the goal (paper, finding 3)."""
    lines = []
    for name, dataset, episodes in by_player_and_set(rows):
        bins = [bin_of_steps_to_go(r.measures) for r in episodes if not outcomes.succeeded(r)]
        counts = Counter(each for each in bins if each)
        if total := counts.total():
            shares = [percent_of(counts[each] / total) for each in STEPS_TO_GO_BINS]
            away = percent_of(sum(counts[each] for each in FARTHER_AWAY) / total)
            lines.append(
                TableRow((name, dataset, *shares, away, str(total), str(len(bins) - total)))
            )
    for dataset, known in reference.steps_to_go.items():
        if any(row.dataset == dataset for row in rows):
            shares = [published_percent(known.get(each)) for each in (*STEPS_TO_GO_BINS, AWAY)]
            lines.append(reference_row(REACT, dataset, *shares, NONE, NONE))
    note = (
        "Fewest steps from the last state to the goal / fewest steps from the first state, of "
        "failures. Below 0.5 is progress; above 1 is farther away than at the start. A bin "
        "contains its lower bound, as in the published histogram. "
        "`robotouille benchmark run --steps-to-go` computes it during a run, and `robotouille "
        "benchmark measure` adds it later."
    )
    columns = ("player", "data set", *STEPS_TO_GO_BINS, AWAY, "failures", "not known")
    return new_table("steps_to_go", "Steps to go of failures", columns, lines, note)


def behaviour(rows: Sequence[ResultRow], reference: Reference) -> Table:
    """Return repetition, invalid answers, recovery and waiting (paper, finding 5)."""
    lines = []
    for name, dataset, episodes in by_player_and_set(rows):
        measures = [row.measures for row in episodes]
        goals = outcomes.with_goal(episodes)
        won = [row.repetitions for row in goals if outcomes.succeeded(row)]
        lost = [row.repetitions for row in goals if not outcomes.succeeded(row)]
        stumbles = sum(each.stumbles for each in measures)
        recovered = sum(each.recovered for each in measures)
        cells = (
            number_text(mean_of_known(won)),
            number_text(mean_of_known(lost)),
            percent_of(outcomes.invalid_rate(episodes)),
            percent_of(outcomes.malformed_rate(episodes)),
            percent_of(recovered / stumbles if stumbles else None),
            number_text(mean_of_known(each.repeated_mistakes for each in measures)),
            percent_of(mean_of_known(each.waiting_share for each in measures)),
            percent_of(mean_of_known(each.idle_share for each in measures)),
        )
        lines.append(TableRow((name, dataset, *cells)))
    for dataset in datasets(rows) if reference.repetitions else ():
        repeated = (reference.mean_repetitions(dataset, each) for each in ("successes", "failures"))
        lines.append(reference_row(REACT, dataset, *map(number_text, repeated), *[NONE] * 6))
    columns = ("player", "data set", "repeated, successes", "repeated, failures", "invalid",
               "malformed", "recovered", "repeated mistakes", "waiting", "idle")  # fmt: skip
    note = (
        "Repeated: mean number of repeated transitions per episode. Invalid, malformed: share of "
        "model calls. Recovered: share of stumbles. Repeated mistakes: mean number per episode, "
        "after a recovery. Waiting, idle: share of the players' steps without an action, while "
        "asynchronous work runs and while none runs."
    )
    return new_table("behaviour", "Repetition, errors and waiting", columns, lines, note)


def asynchronous_first(rows: Sequence[ResultRow]) -> Table:
    """Return success with and without asynchronous work first (paper, finding 6)."""
    lines = []
    for name, group in named(rows).items():
        decided = [row for row in group if row.measures.asynchronous_first is not None]
        if decided:
            first, later = success_by_asynchronous_first(decided)
            share = interval(decided, lambda row: row.measures.asynchronous_first)
            cells = (percent(share), percent_of(first), percent_of(later), str(len(decided)))
            lines.append(TableRow((name, *cells)))
    if lines:
        known = map(published_percent, published.ASYNCHRONOUS_FIRST)
        lines.append(reference_row(REACT, NONE, *known, NONE))
    columns = ("player", "asynchronous first", "success if so", "success if not", "episodes")
    note = (
        "Asynchronous first: the first work of the episode cooks, fries, fills or boils. See "
        "docs/metrics.md."
    )
    return new_table("asynchronous_first", "Asynchronous work first", columns, lines, note)


def failures(rows: Sequence[ResultRow], reference: Reference) -> Table:
    """Return failures by category and subcategory (paper, finding 4)."""
    lines = []
    for name, dataset, episodes in by_player_and_set(rows):
        found = [row.measures.failure for row in episodes if row.measures.failure]
        kinds = Counter((each.category, each.subcategory) for each in found)
        for (category, subcategory), count in sorted(kinds.items()):
            cells = (percent_of(count / len(found)), str(count))
            lines.append(TableRow((name, dataset, category, subcategory, *cells)))
    for dataset, shares in reference.failures.items() if lines else ():
        if any(row.dataset == dataset for row in rows):
            for key, value in shares.items():
                kind, _, detail = key.partition(": ")
                share = published_percent(value)
                lines.append(
                    reference_row(REACT, dataset, kind, detail or "all of them", share, NONE)
                )
    columns = ("player", "data set", "category", "subcategory", "share", "failures")
    note = (
        "The classifier derives the category from the states of the world. In the paper, people "
        "annotated the failures."
    )
    return new_table("failures", "Why episodes failed", columns, lines, note)
