"""HTML page of a report."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from robotouille.html_report.figures import ReportFigure
from robotouille.html_report.page import (
    Block,
    Cell,
    Details,
    Heading,
    Page,
    Section,
    Table,
    TableRow,
    render_page,
)
from robotouille_evaluation.metrics import outcomes
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.report import published
from robotouille_evaluation.report.cells import WORDS, percent
from robotouille_evaluation.report.grouping import (
    datasets,
    interval,
    named,
    part_played,
    score_interval,
    tasks,
)

COLUMNS = ("instance", "result", "steps", "fewest", "budget", "to go", "repeated", "wrong", "calls",
           "failure", "recording")  # fmt: skip
PUBLISHED_PACK = "published"
"""Name of imported packs, whose free instances are those of the published results."""
GRAPHS_HINT = (
    "The work that each task needs. Work with a dashed border continues by itself: start it first "
    "and do other things until it is done."
)
EPISODES_HINT = (
    "All episodes by data set, player and task. `robotouille replay play RECORDING` shows a "
    "recording, `replay notes` and `replay steps` list its contents, and `replay said` prints the "
    "prompts and answers of a model. Paths are relative to the folder in which this report was "
    "made."
)
MAX_ERROR = 300
"""Characters of an error that the page shows; `rows.parquet` has all of them."""
FOOTER = "docs/metrics.md defines each metric."


def results_page(
    rows: Sequence[ResultRow],
    tables: Sequence[Table],
    figures: Sequence[ReportFigure],
    graphs: Sequence[ReportFigure] = (),
    title: str = "Robotouille: results",
    folders: Mapping[str, Path] | None = None,
) -> str:
    """Return the HTML of the page. Equal arguments give equal text.

    Args:
        folders: The folder of each run by its name, for the paths of recordings.
    """
    graph_blocks = [Details(_graph_title(each.name), "", [each]) for each in graphs]
    sections = [
        Section("figures", "Figures", "", figures),
        Section("tables", "Tables", _tables_hint(rows), tables),
        *([Section("graphs", "Tasks", GRAPHS_HINT, graph_blocks)] if graphs else []),
        Section("episodes", "Episodes", EPISODES_HINT, list(_episodes(rows, folders or {}))),
    ]
    page = Page(title, _about(rows), list(_cards(rows)), list(_notes(rows)), sections, FOOTER)
    return render_page(page)


def _tables_hint(rows: Sequence[ResultRow]) -> str:
    hint = f"Rows with a mark are published results for reference ({published.SOURCE})."
    if not all(row.pack.name == PUBLISHED_PACK and row.kind == "free" for row in rows):
        return f"{hint} They were measured on other instances."
    counts = [
        f"{len({row.instance for row in group})} {dataset}"
        for dataset, group in datasets(rows).items()
        if dataset in published.SUCCESS_BY_TASK
    ]
    if not counts:
        return hint
    return (
        f"{hint} Their success rates are from {published.SUCCESS_INSTANCES} instances of each data "
        f"set. Instances of these in this report: {', '.join(counts)}."
    )


def _graph_title(name: str) -> str:
    return name.removeprefix("graph_").replace("_", " ")


# Summary


def _about(rows: Sequence[ResultRow]) -> str:
    variants = sorted({row.variant or "none" for row in rows})
    parts = {
        "run": sorted({row.run for row in rows}),
        "pack": sorted({f"{r.pack.name} {r.pack.version} ({r.pack.digest[:12]})" for r in rows}),
        "experiment": sorted({row.experiment for row in rows if row.experiment}),
        "sampling": sorted({row.sampling for row in rows if row.sampling}),
        "step budget": sorted({row.budget.rule for row in rows}),
        "timing": sorted({row.timing for row in rows}),
        "variant": [] if variants == ["none"] else variants,
    }
    return " · ".join(f"{name}: {_some(values)}" for name, values in parts.items() if values)


def _some(words: Sequence[str], most: int = 4) -> str:
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more


def _cards(rows: Sequence[ResultRow]) -> Iterator[tuple[str, str]]:
    played = len({(row.dataset, row.task) for row in rows})
    yield f"{len(rows):,}", "episode" if len(rows) == 1 else "episodes"
    yield f"{played}", "task" if played == 1 else "tasks"
    shares = {
        name: found.estimate
        for name, group in named([row for row in rows if row.score is not None]).items()
        if (found := score_interval(group)) is not None
    }
    if shares:
        best = max(shares, key=lambda name: shares[name])
        yield f"{100 * shares[best]:.3g} %", f"best score / planner, shifts: {best}"
    for dataset, episodes in datasets(outcomes.with_goal(rows)).items():
        rates = {
            name: outcomes.success_rate(group) or 0.0 for name, group in named(episodes).items()
        }
        rate = max(rates.values())
        winners = [name for name, other in rates.items() if other == rate > 0]
        part = part_played(dataset, episodes)
        where = dataset.replace("_", "-") + (f" ({part})" if part else "")
        who = f": {_some(winners, 1)}" if winners else ""
        yield f"{100 * rate:.3g} %", f"best success, {where}{who}"
    if total := sum(outcomes.tokens(rows)):
        yield f"{total / 1e6:,.3g} M" if total >= 1e6 else f"{total:,}", "tokens"
    if cost := outcomes.cost(rows):
        yield f"${cost:,.2f}", "cost"


def _notes(rows: Sequence[ResultRow]) -> Iterator[str]:
    broken = [row for row in rows if row.error]
    unproven = sum(not row.optimum.proven for row in outcomes.with_goal(rows))
    if broken:
        first = f"the first: {broken[0].error}"[:MAX_ERROR]
        yield f"{_episode_count(len(broken))} ended with an error and count as failed; {first}"
    if unproven:
        yield (
            f"{_episode_count(unproven)} without an optimality rate: no optimum is proven "
            "(`robotouille pack prove`, then `robotouille benchmark measure`)"
        )
    if len({row.pack.digest for row in rows}) > 1:
        yield "the results come from several packs, and players are listed separately for each"
    if len({row.budget.rule for row in rows}) > 1:
        yield "there are several rules for step budgets; players are listed separately for each"


# Episodes


def _episodes(rows: Sequence[ResultRow], folders: Mapping[str, Path]) -> Iterator[Block]:
    players = named(rows)
    for dataset in datasets(rows):
        yield Heading(dataset.replace("_", "-"))
        for name, group in players.items():
            own = [row for row in group if row.dataset == dataset]
            if own:
                inner = [_task(task, some, folders) for task, some in tasks(own).items()]
                yield Details(name, _result(own), inner)


def _episode_count(number: int) -> str:
    return "1 episode" if number == 1 else f"{number:,} episodes"


def _result(rows: Sequence[ResultRow]) -> str:
    goals = outcomes.with_goal(rows)
    parts = [_episode_count(len(rows))]
    if goals:
        parts.append(percent(interval(goals, outcomes.succeeded)))
    if len(goals) < len(rows):
        parts.append(f"{percent(score_interval(rows))} of the planner's score")
    return ", ".join(parts)


def _task(task: str, rows: Sequence[ResultRow], folders: Mapping[str, Path]) -> Details:
    ordered = sorted(rows, key=lambda row: (row.instance, row.seed, row.run))
    lines = [_episode(row, folders.get(row.run, Path())) for row in ordered]
    return Details(
        task.rpartition("/")[2], _result(rows), [Table(COLUMNS, lines, words=WORDS)]
    )  # fmt: skip


def _episode(row: ResultRow, folder: Path) -> TableRow:
    css = "won" if outcomes.succeeded(row) else "lost"
    result = "solved" if css == "won" else row.outcome.ended_by.replace("_", " ")
    if row.score is not None:
        css = ""
        result = (
            f"{row.score.points} points, {row.score.served} served, {row.score.expired} expired"
        )
    failure = row.measures.failure
    why = f"{failure.category}: {failure.subcategory}" if failure else ""
    if failure and failure.steps:
        why += f" (steps {_some([str(step) for step in failure.steps], 6)})"
    instance = f"{row.instance.rpartition('/')[2]}, seed {row.seed}"
    if row.attempts > 1:
        instance += f", attempt {row.attempts}"
    path = "" if row.recording is None else shlex.quote(str(folder / row.recording))
    numbers = (
        row.outcome.steps,
        _fewest(row),
        row.budget.steps,
        _to_go(row),
        row.repetitions,
        row.counts.invalid + row.counts.malformed,
        row.counts.calls,
    )
    return TableRow((
        instance, Cell(result, css=css), *map(str, numbers),
        (row.error or why)[:MAX_ERROR], Cell(path, code=bool(path)),
    ))  # fmt: skip


def _fewest(row: ResultRow) -> str:
    if row.score is not None:
        return ""
    return f"{row.optimum.steps}" if row.optimum.proven else f"≥ {row.optimum.bound}"


def _to_go(row: ResultRow) -> str:
    least, most = row.measures.to_go_least, row.measures.to_go_most
    if row.measures.out_of_reach:
        return "out of reach"
    if least is None:
        return ""
    if most is None:
        return f"≥ {least:.2f}"
    return f"{least:.2f}" if least == most else f"{least:.2f}–{most:.2f}"
