"""Tables of a report. Published results follow the results of the run, marked as references."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from io import StringIO

from robotouille.html_report.page import Cell, Table
from robotouille.terminal import spreadsheet_cell
from robotouille_evaluation.metrics import outcomes
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.report import published
from robotouille_evaluation.report.appendix_tables import horizons, recovery
from robotouille_evaluation.report.comparison_tables import ablations, comparisons, variants
from robotouille_evaluation.report.quality_tables import (
    asynchronous_first,
    behaviour,
    failures,
    optimality,
    steps_to_go,
)
from robotouille_evaluation.report.reference import Reference
from robotouille_evaluation.report.success_tables import (
    scores,
    scores_by_task,
    success_by_dataset,
    success_by_task,
)
from robotouille_evaluation.report.team_tables import real_time, teams

NEGATIVE = re.compile(r"-\d+(\.\d+)?( %)?", re.ASCII)
"""Numbers that begin like a formula."""


def all_tables(rows: Sequence[ResultRow], reference: Reference = Reference()) -> list[Table]:
    """Return every table for which there is data, with published numbers for reference."""
    goals = outcomes.with_goal(rows)
    shifts = [row for row in rows if row.score is not None]
    found = [
        success_by_dataset(goals),
        *success_by_task(goals),
        horizons(goals),
        scores(shifts),
        scores_by_task(shifts),
        optimality(goals, reference),
        steps_to_go(goals, reference),
        behaviour(rows, reference),
        asynchronous_first(goals),
        failures(goals, reference),
        recovery(goals),
        teams(rows),
        real_time(rows),
        ablations(rows),
        variants(goals),
        comparisons(goals),
    ]
    return [table for table in found if table.rows]


def csv_text(table: Table) -> str:
    """Return the table as CSV. The last column, `source`, identifies published rows."""
    output = StringIO()
    writer = csv.writer(output, lineterminator="\n")
    writer.writerow(map(_inert, (*table.columns, "source")))
    for row in table.rows:
        source = published.SOURCE if row.reference else "own"
        writer.writerow([_inert(cell) for cell in (*row.cells, source)])
    return output.getvalue()


def _inert(cell: str | Cell) -> str:
    """Return the cell as one line that no spreadsheet interprets as a formula."""
    text = cell if isinstance(cell, str) else cell.text
    if NEGATIVE.fullmatch(text):
        return text
    return spreadsheet_cell(text.replace("\r", " ").replace("\n", " "))
