"""The tables of a report, as values: own results first, published ones after them and marked."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from statistics import fmean

from robotouille_evaluation.metrics import outcomes
from robotouille_evaluation.metrics.asynchrony import success_by_asynchronous_first
from robotouille_evaluation.metrics.intervals import Interval, mcnemar_test
from robotouille_evaluation.metrics.rows import EpisodeRow, Measures
from robotouille_evaluation.report import published
from robotouille_evaluation.report.grouping import (
    by,
    datasets,
    interval,
    named,
    part_played,
    task_number,
    tasks,
)

__all__ = ["Line", "Table", "all_tables", "csv_text"]

NONE = "–"
MAX_COMPARED = 30
"""Players that are compared pair by pair; those with most episodes."""


@dataclass(frozen=True, slots=True)
class Line:
    """A line of a table; `reference` marks what others have published."""

    cells: tuple[str, ...]
    reference: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A table: `name` is that of its file, `note` says what its numbers are."""

    name: str
    title: str
    columns: tuple[str, ...]
    lines: tuple[Line, ...]
    note: str = ""


def csv_text(table: Table) -> str:
    """A table as CSV, with a last column that says which lines are published ones."""
    output = StringIO()
    writer = csv.writer(output, lineterminator="\n")
    writer.writerow(map(_inert, (*table.columns, "source")))
    for line in table.lines:
        source = published.SOURCE if line.reference else "own"
        writer.writerow([_inert(cell) for cell in (*line.cells, source)])
    return output.getvalue()


def _inert(cell: str) -> str:
    """A cell that no spreadsheet takes for a formula, or for several lines."""
    cell = cell.replace("\r", " ").replace("\n", " ")
    formula = cell[:1] == "\t" or cell.lstrip()[:1] in ("=", "+", "-", "@")
    return f"'{cell}" if formula else cell


def all_tables(rows: Sequence[EpisodeRow]) -> list[Table]:
    """Every table for which there are rows."""
    found = [
        success_by_dataset(rows),
        *success_by_task(rows),
        optimality(rows),
        steps_to_go(rows),
        behaviour(rows),
        asynchronous_first(rows),
        failures(rows),
        teams(rows),
        real_time(rows),
        ablations(rows),
        variants(rows),
        comparisons(rows),
    ]
    return [table for table in found if table.lines]


def percent(interval: Interval | None) -> str:
    """A rate with its interval, if one is known: `47 % (37–57)`."""
    if interval is None or interval.low is None or interval.high is None:
        return _percent(interval.mean if interval else None)
    low, high = round(100 * interval.low), round(100 * interval.high)
    return f"{_percent(interval.mean)} ({low}–{high})"


def _percent(share: float | None) -> str:
    return NONE if share is None else f"{100 * share:.3g} %"


def _published(value: float | None) -> str:
    return NONE if value is None else f"{value:g} %"


def _number(value: float | None, form: str = ".2f") -> str:
    return NONE if value is None else format(value, form)


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return fmean(known) if known else None


def success_by_dataset(rows: Sequence[EpisodeRow]) -> Table:
    """Success by data set (paper, table "successes")."""
    sets = list(datasets(rows))
    lines = []
    for name, group in named(rows).items():
        own = datasets(group)
        cells = [_success_and_part(each, own.get(each, ())) for each in sets]
        lines.append(Line((name, *cells, str(len(group)))))
    for each in published.SUCCESS:
        known = {"synchronous": each.synchronous, "asynchronous": each.asynchronous}
        if any(known.get(one) is not None for one in sets):
            cells = [_published(known.get(one)) for one in sets]
            lines.append(Line((f"{each.model}, {each.strategy}", *cells, NONE), reference=True))
    note = (
        "Episodes that reached the goal within their budget, with 95 % bootstrap intervals over "
        "instances. Published ones: 100 episodes each. A part of a data set does not compare with "
        "the whole: its tasks differ in how hard they are."
    )
    columns = ("player", *sets, "episodes")
    return Table("success", "Success by data set", columns, tuple(lines), note)


def _success_and_part(dataset: str, rows: Sequence[EpisodeRow]) -> str:
    rate, part = percent(interval(rows, outcomes.succeeded)), part_played(dataset, rows)
    return f"{rate}, {part}" if rows and part else rate


def success_by_task(rows: Sequence[EpisodeRow]) -> Iterator[Table]:
    """Success by task, a table a data set (paper, table "tasks-results")."""
    for dataset, group in datasets(rows).items():
        names = list(named(rows))
        theirs = published.SUCCESS_BY_TASK.get(dataset, {})
        lines = []
        for task, episodes in tasks(group).items():
            own = _named_as(rows, episodes)
            cells = [percent(interval(own.get(n, ()), outcomes.succeeded)) for n in names]
            optimum = _mean(row.optimum.steps for row in episodes)
            number = task_number(task)
            known = number is not None and 1 <= number <= 10
            other = [_published(each[number - 1]) if known and number else NONE
                     for each in theirs.values()]  # fmt: skip
            lines.append(Line((task.rpartition("/")[2], _number(optimum, ".3g"), *cells, *other)))
        columns = ("task", "optimum", *names, *(f"gpt-4o, {s} (published)" for s in theirs))
        title = f"Success by task: {dataset.replace('_', '-')}"
        note = "The optimum is the mean of the fewest steps of the instances played."
        yield Table(f"success_{dataset}", title, columns, tuple(lines), note)


def _named_as(
    rows: Sequence[EpisodeRow], some: Sequence[EpisodeRow]
) -> dict[str, list[EpisodeRow]]:
    """Some rows by the names that they have among all rows."""
    chosen = set(map(id, some))
    found = {
        name: [row for row in group if id(row) in chosen] for name, group in named(rows).items()
    }
    return {name: group for name, group in found.items() if group}


def _by_player_and_set(
    rows: Sequence[EpisodeRow],
) -> Iterator[tuple[str, str, list[EpisodeRow]]]:
    for name, group in named(rows).items():
        for dataset, episodes in datasets(group).items():
            yield name, dataset, episodes


def optimality(rows: Sequence[EpisodeRow]) -> Table:
    """How long successes took beside the optimum (paper, finding 2)."""
    lines = []
    for name, dataset, episodes in _by_player_and_set(rows):
        rates = [r for row in episodes if (r := outcomes.optimality_rate(row)) is not None]
        if rates:
            share = interval(episodes, outcomes.is_optimal)
            lines.append(Line((name, dataset, percent(share), _number(fmean(rates)),
                               _number(max(rates)), str(len(rates)))))  # fmt: skip
    for dataset, bins in published.OPTIMALITY.items():
        if any(row.dataset == dataset for row in rows):
            cells = ("gpt-4o, ReAct", dataset, _published(bins["1"]), NONE, NONE, NONE)
            lines.append(Line(cells, reference=True))
    note = "Optimality rate: steps taken / fewest steps, of successes whose optimum is proven."
    columns = ("player", "data set", "optimal", "mean rate", "largest", "successes")
    return Table("optimality", "Optimality of successes", columns, tuple(lines), note)


def bin_of_steps_to_go(measures: Measures) -> str | None:
    """The bin of the paper's histogram; None where the steps to go are not known well enough."""
    if measures.out_of_reach:
        return "out of reach"
    least, most = measures.to_go_least, measures.to_go_most
    if least is None or most is None:
        return None
    found = {_bin(least), _bin(most)}
    return found.pop() if len(found) == 1 else None


def _bin(value: float) -> str:
    return "0 to 0.5" if value <= 0.5 else "0.5 to 1" if value <= 1 else "more than 1"


STEPS_TO_GO_BINS = ("0 to 0.5", "0.5 to 1", "more than 1", "out of reach")


def steps_to_go(rows: Sequence[EpisodeRow]) -> Table:
    """How far failures were from the goal at their end (paper, finding 3)."""
    lines = []
    for name, dataset, episodes in _by_player_and_set(rows):
        bins = [bin_of_steps_to_go(r.measures) for r in episodes if not outcomes.succeeded(r)]
        counts = Counter(each for each in bins if each)
        if total := counts.total():
            shares = [_percent(counts[each] / total) for each in STEPS_TO_GO_BINS]
            lines.append(Line((name, dataset, *shares, str(total), str(len(bins) - total))))
    for dataset, shares_known in published.STEPS_TO_GO.items():
        if any(row.dataset == dataset for row in rows):
            shares = [_published(shares_known.get(each)) for each in STEPS_TO_GO_BINS]
            lines.append(Line(("gpt-4o, ReAct", dataset, *shares, NONE, NONE), reference=True))
    note = (
        "Fewest steps from the last state to the goal / fewest from the first, of failures. Up to "
        "0.5 is progress; more than 1 is farther away than at first. It is measured by "
        "`robotouille benchmark run --steps-to-go`, while a run is played and not afterwards."
    )
    columns = ("player", "data set", *STEPS_TO_GO_BINS, "failures", "not known")
    return Table("steps_to_go", "Steps to go of failures", columns, tuple(lines), note)


def behaviour(rows: Sequence[EpisodeRow]) -> Table:
    """Repetition, wrong answers, recovery, waiting (paper, finding 5)."""
    lines = []
    for name, dataset, episodes in _by_player_and_set(rows):
        won = [row for row in episodes if outcomes.succeeded(row)]
        lost = [row for row in episodes if not outcomes.succeeded(row)]
        stumbles = sum(row.measures.stumbles for row in episodes)
        recovered = sum(row.measures.recovered for row in episodes)
        cells = (
            _number(_mean(row.repetitions for row in won), ".3g"),
            _number(_mean(row.repetitions for row in lost), ".3g"),
            _percent(outcomes.invalid_rate(episodes)),
            _percent(outcomes.malformed_rate(episodes)),
            _percent(recovered / stumbles if stumbles else None),
            _number(_mean(row.measures.repeated_mistakes for row in episodes), ".3g"),
            _percent(_mean(row.measures.waiting_share for row in episodes)),
            _percent(_mean(row.measures.idle_share for row in episodes)),
        )
        lines.append(Line((name, dataset, *cells)))
    columns = ("player", "data set", "repeated, successes", "repeated, failures", "invalid",
               "malformed", "recovered", "made again", "waiting", "idle")  # fmt: skip
    note = (
        "Mean repeated transitions an episode; wrong answers by calls; stumbles recovered from, "
        "and how often an episode has a mistake again after recovery; shares of the players' steps "
        "without an action while something runs, and while nothing does."
    )
    return Table("behaviour", "Repetition, errors and waiting", columns, tuple(lines), note)


def asynchronous_first(rows: Sequence[EpisodeRow]) -> Table:
    """Success with and without asynchronous work first (paper, finding 6)."""
    lines = []
    for name, group in named(rows).items():
        decided = [row for row in group if row.measures.asynchronous_first is not None]
        if decided:
            first, later = success_by_asynchronous_first(decided)
            share = interval(decided, lambda row: row.measures.asynchronous_first)
            cells = (percent(share), _percent(first), _percent(later), str(len(decided)))
            lines.append(Line((name, *cells)))
    if lines:
        first, later = published.ASYNCHRONOUS_FIRST
        lines.append(
            Line(("gpt-4o, ReAct", NONE, _published(first), _published(later), NONE), True)
        )
    columns = ("player", "asynchronous first", "success if so", "success if not", "episodes")
    note = "Whether the first work of a run cooks, fries, fills or boils; see docs/metrics.md."
    return Table("asynchronous_first", "Asynchronous work first", columns, tuple(lines), note)


def failures(rows: Sequence[EpisodeRow]) -> Table:
    """Failures by category and subcategory (paper, finding 4)."""
    lines = []
    for name, dataset, episodes in _by_player_and_set(rows):
        found = [row.measures.failure for row in episodes if row.measures.failure]
        kinds = Counter((each.category, each.subcategory) for each in found)
        for (category, subcategory), count in sorted(kinds.items()):
            share = _percent(count / len(found))
            lines.append(Line((name, dataset, category, subcategory, share, str(count))))
    for dataset, shares in published.FAILURES.items():
        if lines and any(row.dataset == dataset for row in rows):
            for key, value in shares.items():
                kind, _, subcategory = key.partition(": ")
                cells = ("gpt-4o, ReAct", dataset, kind, subcategory or "all of them",
                         _published(value), NONE)  # fmt: skip
                lines.append(Line(cells, reference=True))
    columns = ("player", "data set", "category", "subcategory", "share", "failures")
    note = "Told by the classifier from what the world knows; published ones by people."
    return Table("failures", "Why episodes failed", columns, tuple(lines), note)


def teams(rows: Sequence[EpisodeRow]) -> Table:
    """How teams shared the work."""
    lines = []
    for name, group in named([row for row in rows if row.seats > 1]).items():
        for seats, episodes in sorted(by(group, lambda row: str(row.seats)).items()):
            shares = [row.measures.contributions for row in episodes if row.measures.contributions]
            least = _mean(min(each.values()) for each in shares)
            most = _mean(max(each.values()) for each in shares)
            cells = (
                percent(interval(episodes, outcomes.succeeded)),
                _percent(least),
                _percent(most),
                _number(_mean(row.measures.blocked for row in episodes), ".3g"),
                _percent(_mean(row.measures.overlap for row in episodes)),
            )
            lines.append(Line((name, seats, *cells)))
    columns = ("player", "seats", "success", "least share", "largest share", "blocked", "overlap")
    note = (
        "Shares of the work of whoever did least and most; actions refused because of a partner, "
        "an episode; steps in which two or more act."
    )
    return Table("teams", "Teams", columns, tuple(lines), note)


def real_time(rows: Sequence[EpisodeRow]) -> Table:
    """What thinking cost where the world went on meanwhile."""
    lines = []
    for name, dataset, episodes in _by_player_and_set([r for r in rows if r.real_time]):
        measures = [row.measures for row in episodes]
        cells = (
            percent(interval(episodes, outcomes.succeeded)),
            _number(_mean(each.staleness for each in measures), ".3g"),
            _number(_mean(each.late_answers for each in measures), ".3g"),
            _percent(_mean(each.held_share for each in measures)),
            _number(_mean(each.lost_to_thinking for each in measures), ".3g"),
            str(len(episodes)),
        )
        lines.append(Line((name, dataset, *cells)))
    columns = ("player", "data set", "success", "staleness", "late", "held", "lost", "episodes")
    note = (
        "Staleness: mean steps between what a model saw and its action. Late: answers an episode "
        "that came steps later. Held: of those that were valid when it looked, the share that "
        "applied. Lost: steps an episode in which a player did nothing because its model thought."
    )
    return Table("real_time", "In real time", columns, tuple(lines), note)


def ablations(rows: Sequence[EpisodeRow]) -> Table:
    """Solved, steps and cost by player (paper, table "ablation1")."""
    lines = []
    for name, group in named(rows).items():
        prompt, completion = outcomes.tokens(group)
        calls = sum(row.counts.calls for row in group)
        cells = (
            f"{sum(map(outcomes.succeeded, group))}/{len(group)}",
            _number(outcomes.mean_steps(group)),
            f"{calls:,}",
            f"{prompt:,}",
            f"{completion:,}",
            _number(outcomes.cost(group)),
            _number(outcomes.cost_per_success(group)),
            _number(outcomes.seconds_per_call(group), ".3g"),
        )
        lines.append(Line((name, *cells)))
    for each in published.ABLATIONS:
        cells_known = (f"gpt-4o, {each.name}", f"{each.solved}/{published.ABLATION_TASKS}",
                       _number(each.steps), NONE, NONE, NONE, _number(each.cost),
                       _number(each.cost / each.solved), NONE)  # fmt: skip
        lines.append(Line(cells_known, reference=True))
    columns = ("player", "solved", "mean steps", "calls", "prompt tokens", "completion tokens",
               "cost ($)", "$ a success", "s a call")  # fmt: skip
    return Table("ablations", "Steps, tokens and cost", columns, tuple(lines))


def variants(rows: Sequence[EpisodeRow]) -> Table:
    """Success with and without chance, and without delays, by task (paper, tables
    "stochastic-results" and "dataset-comparison")."""
    names = ("", "stochastic", "delay-free")
    lines = []
    for (player, kind), group in _by_player_and_kind(rows):
        for dataset, in_set in datasets(group).items():
            for task, episodes in tasks(in_set).items():
                own = by(episodes, lambda row: row.variant)
                if own.keys() - {""}:
                    cells = [percent(interval(own.get(n, ()), outcomes.succeeded)) for n in names]
                    lines.append(Line((player, kind, dataset, task.rpartition("/")[2], *cells)))
    if lines:
        lines += _published_variants({row.dataset for row in rows})
    columns = ("player", "kind", "data set", "task", "as it is", "stochastic", "delay-free")
    note = (
        "Stochastic: once in an episode a cut item reverts. Delay-free: nothing has to be waited "
        "for; its step budgets are those of kitchens without delays."
    )
    return Table("variants", "Variants", columns, tuple(lines), note)


def _by_player_and_kind(
    rows: Sequence[EpisodeRow],
) -> Iterator[tuple[tuple[str, str], list[EpisodeRow]]]:
    def name(row: EpisodeRow) -> str:
        return " · ".join(filter(None, [row.player, row.pace]))

    for player, group in sorted(by(rows, name).items()):
        for kind, episodes in sorted(by(group, lambda row: row.kind).items()):
            yield (player, kind), episodes


def _published_variants(sets: Iterable[str]) -> Iterator[Line]:
    by_chance = {n: (plain, less, None) for n, (plain, less) in published.STOCHASTIC.items()}
    by_delays = {
        n: (delayed, None, free) for n, (free, delayed) in published.SYNCHRONOUS_VARIANTS.items()
    }
    for dataset, known in (("synchronous", by_chance), ("asynchronous", by_delays)):
        for number, values in known.items() if dataset in sets else ():
            cells = ("gpt-4o, ReAct", NONE, dataset, str(number), *map(_published, values))
            yield Line(cells, reference=True)


def comparisons(rows: Sequence[EpisodeRow]) -> Table:
    """Every two players on the episodes that both played, by McNemar's exact test."""
    results: Mapping[str, dict[object, bool]] = {
        name: {row.pair: outcomes.succeeded(row) for row in group}
        for name, group in named(rows).items()
    }
    lines = []
    names = sorted(results, key=lambda name: -len(results[name]))[:MAX_COMPARED]
    names.sort()
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            both = sorted(results[one].keys() & results[other].keys(), key=str)
            if not both:
                continue
            mine, theirs = ([results[name][pair] for pair in both] for name in (one, other))
            p = mcnemar_test(mine, theirs)
            shown = "< 0.001" if p < 0.001 else f"{p:.3f}"
            lines.append(
                Line((one, other, str(sum(mine)), str(sum(theirs)), str(len(both)), shown))
            )
    columns = ("one", "other", "one solves", "other solves", "of", "p")
    note = (
        "McNemar's exact test on episodes of the same instance and seed; not corrected for their "
        "number."
    )
    if left := len(results) - len(names):
        note += f" {left} more players, those with fewest episodes, are left out."
    return Table("comparisons", "Players compared pair by pair", columns, tuple(lines), note)
