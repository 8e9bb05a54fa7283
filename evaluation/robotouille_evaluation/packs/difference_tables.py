"""How two packs differ, as tables: for a terminal, and in Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.table import Table
from rich.text import Text

from robotouille.program import printable
from robotouille_evaluation.packs.differences import Difference, PackDifferences, TaskDifferences

__all__ = ["markdown_tables", "text_tables"]

NOTHING = "–"

Row = tuple[str, str, str, str]


def text_tables(found: PackDifferences) -> list[Table]:
    """Tables for a terminal: all in all, task by task, word by word; those that have rows."""
    tables = []
    for title, rows in _sections(found):
        names = (Text(printable(name)) for name in (found.a, found.b))
        table = Table("", "", title=title, title_justify="left", show_lines=False)
        for name in names:
            table.add_column(name)
        for row in rows:
            table.add_row(*(Text(printable(cell)) for cell in row))
        tables.append(table)
    return tables


def markdown_tables(found: PackDifferences) -> str:
    """The same as Markdown, a heading above each table."""
    lines: list[str] = []
    for title, rows in _sections(found):
        lines += [
            f"### {title}",
            "",
            f"| | | {_cell(found.a)} | {_cell(found.b)} |",
            "| --- | --- | --- | --- |",
        ]
        lines += [f"| {' | '.join(map(_cell, row))} |" for row in rows]
        lines.append("")
    return "\n".join(lines)


def _cell(text: str) -> str:
    return printable(text).replace("|", "\\|").replace("[", "\\[").replace("]", "\\]")


def _sections(found: PackDifferences) -> Iterator[tuple[str, Sequence[Row]]]:
    sections = {
        "In all": [_row("", difference) for difference in found.overall],
        "Task by task": [row for task in found.tasks for row in _task_rows(task)],
        "Words of the domain": [_row("", difference) for difference in found.wording],
    }
    return ((title, rows) for title, rows in sections.items() if rows)


def _task_rows(task: TaskDifferences) -> Iterator[Row]:
    """A task's differences, its names in a row above them; none if it does not differ."""
    if task.differences or task.a is None or task.b is None:
        yield "task", "", task.a or NOTHING, task.b or NOTHING
    for difference in task.differences:
        yield _row("", difference)


def _row(task: str, difference: Difference) -> Row:
    return task, difference.aspect, difference.a or NOTHING, difference.b or NOTHING
