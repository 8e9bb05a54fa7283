"""The report as one HTML page. Whatever comes from rows is escaped."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template

from robotouille_client.console.pages.drawing import Picture
from robotouille_client.console.pages.page import (
    cards_html,
    figure_html,
    notes_html,
    page_html,
    scrolling_table,
)
from robotouille_client.console.pages.page_style import STYLE
from robotouille_evaluation.metrics import outcomes
from robotouille_evaluation.metrics.rows import EpisodeRow
from robotouille_evaluation.report import published
from robotouille_evaluation.report.grouping import datasets, interval, named, part_played, tasks
from robotouille_evaluation.report.tables import Line, Table, percent

__all__ = ["render_page"]

SECTIONS = Template("""<section id="results">$cards$notes</section>
<section id="figures"><h2>Figures</h2>$figures</section>
<section id="tables"><h2>Tables</h2>
<p class="hint">Lines with a mark <span class="mark">published</span> are for reference: measured \
by others, on other instances ($source).</p>$tables</section>
$graphs
<section id="episodes"><h2>Episodes</h2>
<p class="hint">Every episode, by data set, player and task. Watch one with <code>robotouille \
replay play RECORDING</code>, read it with <code>replay notes</code> or <code>steps</code>, and \
what a model was asked and said with <code>replay said</code>. Recordings are named as seen from \
where this report was made.</p>\
$episodes</section>""")


def render_page(
    rows: Sequence[EpisodeRow],
    tables: Sequence[Table],
    figures: Sequence[Picture],
    graphs: Sequence[Picture] = (),
    title: str = "Robotouille: results",
    folders: Mapping[str, Path] | None = None,
) -> str:
    """The page's HTML; equal arguments give equal text. `folders` say where each run lies, by its
    name."""
    links = [("results", "Results"), ("figures", "Figures"), ("tables", "Tables")]
    links += [("graphs", "Tasks")] if graphs else []
    sections = SECTIONS.substitute(
        cards=cards_html(_cards(rows)),
        notes=notes_html(_notes(rows), "notes"),
        figures="".join(map(figure_html, figures)),
        tables="".join(map(_table, tables)),
        graphs=_graphs(graphs),
        episodes="".join(_episodes(rows, folders or {})),
        source=escape(published.SOURCE),
    )
    return page_html(
        title,
        _about(rows),
        [*links, ("episodes", "Episodes")],
        sections_html=sections,
        footer="What each number means and how it is computed: docs/metrics.md.",
        style=STYLE,
    )


# What it is about


def _about(rows: Sequence[EpisodeRow]) -> str:
    runs = sorted({row.run for row in rows})
    packs = sorted({f"{r.pack.name} {r.pack.version} ({r.pack.digest[:12]})" for r in rows})
    rules = sorted({row.budget.rule for row in rows})
    return " · ".join([
        f"{'runs' if len(runs) > 1 else 'run'} {_some(runs)}",
        f"{'packs' if len(packs) > 1 else 'pack'} {_some(packs)}",
        f"step budget {_some(rules)}",
        f"timing {_some(sorted({row.timing for row in rows}))}",
        *_variants(rows),
    ])  # fmt: skip


def _variants(rows: Sequence[EpisodeRow]) -> Iterator[str]:
    names = {row.variant for row in rows}
    if names - {""}:
        yield f"variant {_some(sorted(name or 'none' for name in names))}"


def _some(words: Sequence[str], most: int = 4) -> str:
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return ", ".join(words[:most]) + more


def _cards(rows: Sequence[EpisodeRow]) -> Iterator[tuple[str, str]]:
    yield f"{len(rows):,}", "episodes"
    yield f"{len({(row.dataset, row.task) for row in rows})}", "tasks"
    for dataset, episodes in datasets(rows).items():
        best = max(
            (
                (outcomes.success_rate(group) or 0.0, name)
                for name, group in named(episodes).items()
            ),
            default=(0.0, ""),
        )
        part = part_played(dataset, episodes)
        said = f"{dataset.replace('_', '-')} ({part})" if part else dataset.replace("_", "-")
        yield f"{100 * best[0]:.3g} %", f"best, {said}: {best[1]}"
    prompt, completion = outcomes.tokens(rows)
    if prompt + completion:
        yield f"{(prompt + completion) / 1e6:,.3g} M", "tokens"
    total = outcomes.cost(rows)
    if total:
        yield f"${total:,.2f}", "cost"


def _notes(rows: Sequence[EpisodeRow]) -> Iterator[str]:
    """What a reader has to know before believing a number."""
    broken = [row for row in rows if row.error]
    unproven = sum(not row.optimum.proven for row in rows)
    if broken:
        first = f"the first: {broken[0].error}"[:300]
        yield f"{len(broken):,} episodes broke off by an error and count as failed; {first}"
    if unproven:
        yield f"of {unproven:,} episodes the optimum is not proven: no optimality rate"
    if len({row.pack.digest for row in rows}) > 1:
        yield "these are several packs; their players are listed apart"
    if len({row.budget.rule for row in rows}) > 1:
        yield "step budgets follow several rules; their players are listed apart"


# Figures and tables


def _graphs(graphs: Sequence[Picture]) -> str:
    if not graphs:
        return ""
    figures = "".join(
        f"<details><summary>{escape(_title(each.name))}</summary>{figure_html(each)}</details>"
        for each in graphs
    )
    hint = (
        "What each task is made of. Dashed work goes on by itself: begin it first, and do other "
        "things meanwhile."
    )
    return f'<section id="graphs"><h2>Tasks</h2><p class="hint">{hint}</p>{figures}</section>'


def _title(name: str) -> str:
    return name.removeprefix("graph_").replace("_", " ")


TEXT = {"data set", "category", "subcategory", "other", "result", "failure", "recording"}
"""Columns of words; all others hold numbers."""


def _table(table: Table) -> str:
    body = "".join(_line(table.columns, line) for line in table.lines)
    note = f'<p class="hint">{escape(table.note)}</p>' if table.note else ""
    title = f'<h3 id="table-{escape(table.name)}">{escape(table.title)}</h3>'
    return title + note + _scrolling(table.columns, body)


def _scrolling(columns: Sequence[str], body: str) -> str:
    text = [name in TEXT for name in columns]
    return scrolling_table([_words(name) for name in columns], body, text)


def _kind(column: str) -> str:
    return ' class="text"' if column in TEXT else ""


def _words(text: str) -> str:
    """Escaped, and a long name may be broken after an underscore."""
    return escape(text).replace("_", "_<wbr>")


def _line(columns: Sequence[str], line: Line) -> str:
    mark = ' <span class="mark">published</span>' if line.reference else ""
    cells = "".join(
        f"<td{_kind(column)}>{escape(cell)}</td>"
        for column, cell in zip(columns[1:], line.cells[1:], strict=True)
    )
    kind = ' class="reference"' if line.reference else ""
    return f'<tr{kind}><th scope="row">{_words(line.cells[0])}{mark}</th>{cells}</tr>'


# Episodes

COLUMNS = ("instance", "result", "steps", "fewest", "budget", "to go", "repeated", "wrong", "calls",
           "failure", "recording")  # fmt: skip


def _episodes(rows: Sequence[EpisodeRow], folders: Mapping[str, Path]) -> Iterator[str]:
    names: Mapping[str, list[EpisodeRow]] = named(rows)
    for dataset in datasets(rows):
        yield f"<h3>{escape(dataset.replace('_', '-'))}</h3>"
        for name, group in names.items():
            own = [row for row in group if row.dataset == dataset]
            if own:
                inner = "".join(_task(task, some, folders) for task, some in tasks(own).items())
                yield _fold(name, own, f'<div class="inner">{inner}</div>')


def _fold(name: str, rows: Sequence[EpisodeRow], content: str) -> str:
    rate = percent(interval(rows, outcomes.succeeded))
    return (
        f"<details><summary>{escape(name)} <small>{len(rows)} episodes, {rate}</small></summary>"
        f"{content}</details>"
    )


def _task(task: str, rows: Sequence[EpisodeRow], folders: Mapping[str, Path]) -> str:
    ordered = sorted(rows, key=lambda row: (row.instance, row.seed, row.run))
    lines = "".join(_episode(row, folders.get(row.run, Path())) for row in ordered)
    return _fold(task.rpartition("/")[2], rows, _scrolling(COLUMNS, lines))


def _episode(row: EpisodeRow, folder: Path) -> str:
    won = outcomes.succeeded(row)
    result = "solved" if won else row.outcome.ended_by.replace("_", " ")
    failure = row.measures.failure
    why = f"{failure.category}: {failure.subcategory}" if failure else ""
    if failure and failure.steps:
        why += f" (steps {_some([str(step) for step in failure.steps], 6)})"
    fewest = row.optimum.steps if row.optimum.proven else f"≥ {row.optimum.bound}"
    wrong = row.counts.invalid + row.counts.malformed
    instance = f"{row.instance.rpartition('/')[2]}, seed {row.seed}"
    if row.attempts > 1:
        instance += f", attempt {row.attempts}"
    values = [row.outcome.steps, fewest, row.budget.steps, _to_go(row), row.repetitions, wrong,
              row.counts.calls, row.error or why]  # fmt: skip
    cells = "".join(
        f"<td{_kind(column)}>{escape(str(value))}</td>"
        for column, value in zip(COLUMNS[2:-1], values, strict=True)
    )
    return (
        f'<tr><th scope="row">{escape(instance)}</th>'
        f'<td class="text {"won" if won else "lost"}">{escape(result)}</td>{cells}'
        f'<td class="text">{_recording(row, folder)}</td></tr>'
    )


def _to_go(row: EpisodeRow) -> str:
    least, most = row.measures.to_go_least, row.measures.to_go_most
    if row.measures.out_of_reach:
        return "out of reach"
    if least is None:
        return ""
    if most is None:
        return f"≥ {least:.2f}"
    return f"{least:.2f}" if least == most else f"{least:.2f}–{most:.2f}"


def _recording(row: EpisodeRow, folder: Path) -> str:
    if row.recording is None:
        return ""
    return f"<code>{escape(shlex.quote(str(folder / row.recording)))}</code>"
