"""Tables of success by data set and task, and of the scores of shifts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from robotouille.html_report.page import Table, TableRow
from robotouille_evaluation.metrics import outcomes
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.report import published
from robotouille_evaluation.report.cells import (
    NONE,
    left_out,
    mean_of_known,
    new_table,
    number_text,
    percent,
    published_percent,
    reference_row,
)
from robotouille_evaluation.report.grouping import (
    RowGroups,
    by,
    by_player_and_set,
    datasets,
    interval,
    largest,
    named,
    part_played,
    score_interval,
    task_number,
    tasks,
)

MAX_COLUMNS = 40
"""Data sets or players with a column. More columns are unreadable, and the cells would grow as the
product of both numbers."""


def success_by_dataset(rows: Sequence[ResultRow]) -> Table:
    """Return success by data set (paper, table "successes")."""
    all_sets = datasets(rows)
    sets = list(largest(all_sets, MAX_COLUMNS))
    lines = []
    for name, group in named(rows).items():
        own = datasets(group)
        cells = [_success_and_part(each, own.get(each, ())) for each in sets]
        lines.append(TableRow((name, *cells, str(len(group)))))
    for each in published.SUCCESS:
        known = [_published_success(each, one, all_sets[one]) for one in sets]
        if any(known):
            cells = [cell or NONE for cell in known]
            lines.append(reference_row(f"{each.model}, {each.strategy}", *cells, NONE))
    note = (
        "Share of episodes that reached the goal within their step budget, ± standard error, with "
        "95 % bootstrap intervals over instances; docs/metrics.md compares them with the paper's "
        "errors. Each published number is from 10 episodes of each task. Do not compare a "
        "part of a data set with the whole: its tasks differ in difficulty. Published rates on the "
        "tasks played here are means of the paper's rates by task."
        + left_out("data sets", all_sets, sets)
    )
    return new_table("success", "Success by data set", ("player", *sets, "episodes"), lines, note)


def _published_success(
    each: published.PublishedSuccess, dataset: str, rows: Sequence[ResultRow]
) -> str | None:
    """Return a published rate, if part of the data set was played also on these tasks."""
    cell = each.cell(dataset)
    numbers = {number for row in rows if (number := task_number(row.task))}
    if cell is None or not part_played(dataset, rows) or not numbers or max(numbers) > 10:
        return cell
    same = published.success_on_tasks(each, dataset, numbers)
    return cell if same is None else f"{cell}, {published_percent(same)} on tasks played"


def _success_and_part(dataset: str, rows: Sequence[ResultRow]) -> str:
    rate, part = percent(interval(rows, outcomes.succeeded)), part_played(dataset, rows)
    return f"{rate}, {part}" if rows and part else rate


def success_by_task(rows: Sequence[ResultRow]) -> Iterator[Table]:
    """Yield a table of success by task for each data set (paper, table "tasks-results")."""
    groups: dict[str, RowGroups] = {}
    for name, dataset, own in by_player_and_set(rows):
        groups.setdefault(dataset, {})[name] = own
    for dataset, group in datasets(rows).items():
        players = largest(groups[dataset], MAX_COLUMNS)
        theirs = published.SUCCESS_BY_TASK.get(dataset, {})
        lines = []
        by_task = [by(own, lambda row: row.task) for own in players.values()]
        for task, episodes in tasks(group).items():
            cells = [percent(interval(own.get(task, ()), outcomes.succeeded)) for own in by_task]
            optimum = number_text(mean_of_known(row.optimum.steps for row in episodes))
            number = task_number(task)
            known = number is not None and 1 <= number <= 10
            other = [published_percent(each[number - 1]) if known and number else NONE
                     for each in theirs.values()]  # fmt: skip
            lines.append(TableRow((task.rpartition("/")[2], optimum, *cells, *other)))
        columns = ("task", "optimum", *players, *(f"gpt-4o, {s} (published)" for s in theirs))
        title = f"Success by task: {dataset.replace('_', '-')}"
        note = "Optimum: mean length of the shortest plans of the instances played."
        note += left_out("players", groups[dataset], players)
        yield new_table(f"success_{dataset}", title, columns, lines, note)


def scores(rows: Sequence[ResultRow]) -> Table:
    """Return points, served and expired orders of shifts, and the share of the planner's points."""
    lines = []
    for name, dataset, episodes in by_player_and_set(rows):
        found = [row.score for row in episodes if row.score is not None]
        cells = (
            percent(score_interval(episodes)),
            number_text(mean_of_known(each.points for each in found), ".4g"),
            number_text(mean_of_known(each.served for each in found)),
            number_text(mean_of_known(each.expired for each in found)),
            str(len(found)),
        )
        lines.append(TableRow((name, dataset, *cells)))
    columns = ("player", "data set", "score / planner", "points", "served", "expired", "episodes")
    note = (
        "Score / planner: points / the points of planner bots in the same seats, with a 95 % "
        "bootstrap interval over instances. Points, served and expired orders are means per "
        "episode. Agents that serve more than one order at a time can exceed 100 %."
    )
    return new_table("scores", "Scores of shifts", columns, lines, note)


def scores_by_task(rows: Sequence[ResultRow]) -> Table:
    """Return each player's share of the planner's points by shift and number of seats."""
    groups = named(rows)
    players = largest(groups, MAX_COLUMNS)
    by_place = [by(own, lambda row: f"{row.seats} {row.task}") for own in players.values()]
    lines = []
    for task, group in tasks(rows).items():
        for seats, episodes in sorted(by(group, lambda row: str(row.seats)).items()):
            cells = [percent(score_interval(own.get(f"{seats} {task}", ()))) for own in by_place]
            points = number_text(
                mean_of_known(r.score.planner for r in episodes if r.score is not None), ".4g"
            )
            lines.append(TableRow((task.rpartition("/")[2], seats, points, *cells)))
    columns = ("task", "seats", "planner's points", *players)
    note = left_out("players", groups, players).strip()
    return new_table("scores_by_task", "Score / planner by task", columns, lines, note)
