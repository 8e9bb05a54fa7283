"""Cells and rows of a report's tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Sized
from statistics import fmean

from robotouille.html_report.intervals import Interval
from robotouille.html_report.page import Table, TableRow

NONE = "–"
WORDS = frozenset(
    {"data set", "category", "subcategory", "other", "result", "failure", "recording"}
)
"""Columns of words, which are aligned to the left."""


def percent(interval: Interval | None) -> str:
    """Return a rate with standard error and interval, such as `47 % ± 5.02 (37–57)`."""
    if interval is None:
        return NONE
    error = "" if interval.error is None else f" ± {100 * interval.error:.3g}"
    return interval.text(
        lambda share: percent_of(share) + error, lambda bound: str(round(100 * bound))
    )


def percent_of(share: float | None) -> str:
    """Return a share in per cent, or a dash if it is unknown."""
    return NONE if share is None else f"{100 * share:.3g} %"


def published_percent(value: float | None) -> str:
    """Return a published value, which is in per cent already."""
    return NONE if value is None else f"{value:.3g} %"


def number_text(value: float | None, form: str = ".3g") -> str:
    """Return a number, or a dash if it is unknown."""
    return NONE if value is None else format(value, form)


def mean_of_known(values: Iterable[float | None]) -> float | None:
    """Return the mean of the known values."""
    known = [value for value in values if value is not None]
    return fmean(known) if known else None


def new_table(
    name: str, title: str, columns: Sequence[str], rows: Iterable[TableRow], note: str = ""
) -> Table:
    """Return a table that aligns its columns of words to the left."""
    return Table(tuple(columns), tuple(rows), name, title, note, WORDS)


def reference_row(*cells: str) -> TableRow:
    """Return a row of published results."""
    return TableRow(cells, reference=True)


def left_out(what: str, groups: Sized, shown: Sized) -> str:
    """Return a sentence about the groups that a table leaves out, or an empty text."""
    left = len(groups) - len(shown)
    return f" {left} more {what}, those with the fewest episodes, are left out." if left else ""
