"""Results of a query as a table on a terminal, as a file, or as a plot."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from decimal import Decimal
from itertools import islice
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotouille.errors import MissingExtraError
from robotouille.files.writing import whole_file
from robotouille.html_report import require_libraries
from robotouille.html_report.figures import (
    COLOURS,
    MARKERS,
    draw_figure,
    label_rows,
    short_label,
)
from robotouille.terminal import csv_cell, printable
from robotouille_data.database import CatalogueError
from robotouille_data.query import QueryAnswer

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_BARS, MAX_POINTS, MAX_SERIES = 60, 100_000, 6
HUGE = 1e300
"""Matplotlib fails on larger numbers, because their differences are infinite."""
MAX_MARKED = 60
"""Points of a line up to which each point has a marker."""

Series = list[tuple[str, list[float]]]


def save_plot(answer: QueryAnswer, path: Path) -> int:
    """Draw an answer as bars or lines in an SVG or PNG file, and return the number of rows.

    Raises:
        MissingExtraError: Matplotlib is not installed.
        CatalogueError: The file name has another suffix, or the answer cannot be drawn.
        OSError: The file cannot be written.
    """
    if path.suffix not in (".svg", ".png"):
        raise CatalogueError(f"{path}: the name of a plot must end in .svg or .png")
    require_libraries("a plot", "data")
    # One row more than fits shows that there are too many, without reading millions.
    rows = [tuple(map(_plotted, row)) for row in islice(answer.rows, MAX_POINTS + 1)]
    by = _axis_column(answer.columns, rows)
    series = _series(answer.columns, rows, by)
    places = [row[by] for row in rows]
    words = any(isinstance(place, str) for place in places)
    if not words and not all(place is None or _is_number(place) for place in places):
        raise CatalogueError(f"the column `{answer.columns[by]}` has values that are no numbers")
    if len(rows) > (MAX_BARS if words else MAX_POINTS):
        most = f"{MAX_BARS} bars" if words else f"{MAX_POINTS:,} points"
        raise CatalogueError(f"a plot has room for {most}: group the rows or add a LIMIT")

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        (_bars if words else _lines)(axes, places, series)
        label = short_label(answer.columns[by])
        (axes.set_ylabel if words else axes.set_xlabel)(label)
        if len(series) == 1:
            (axes.set_xlabel if words else axes.set_ylabel)(short_label(series[0][0]))
        else:
            figure.legend(loc="outside upper left", ncols=4)

    height = 1.0 + 0.2 * len(rows) * (len(series) + 0.6) if words else 4.2
    picture = draw_figure("plot", "", (7.6, max(2.0, height)), draw, png=path.suffix == ".png")
    with whole_file(path, text=path.suffix == ".svg") as file:
        file.write(picture.svg if path.suffix == ".svg" else picture.png)
    return len(rows)


def _plotted(value: Any) -> Any:
    return float(value) if isinstance(value, Decimal | bool) else value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)


def _drawable(value: Any) -> bool:
    return value is not None and isfinite(value) and abs(value) < HUGE


def _axis_column(columns: Sequence[str], rows: Sequence[tuple[Any, ...]]) -> int:
    """Return the index of the first column with text, or 0."""
    if not rows:
        raise CatalogueError("the answer has no rows to draw")
    words = (n for n in range(len(columns)) if any(isinstance(row[n], str) for row in rows))
    return next(words, 0)


def _series(columns: Sequence[str], rows: Sequence[tuple[Any, ...]], by: int) -> Series:
    """Return the columns of numbers except `by`. Null, infinite and huge values are gaps."""
    found: Series = []
    for place, name in enumerate(columns):
        values = [row[place] for row in rows]
        known = [value for value in values if value is not None]
        if place != by and known and all(map(_is_number, known)):
            drawn = [float(value) if _drawable(value) else nan for value in values]
            found.append((name, drawn))
    if not found:
        raise CatalogueError(f"the answer has no column of numbers except `{columns[by]}`")
    if len(found) > MAX_SERIES:
        raise CatalogueError(
            f"a plot has room for {MAX_SERIES} columns of numbers, not {len(found)}"
        )
    return found


def _bars(axes: Axes, places: Sequence[Any], series: Series) -> None:
    """Draw groups of horizontal bars, one bar for each column."""
    height = 0.8 / len(series)
    for number, (name, values) in enumerate(series):
        at = [row - 0.4 + height * (number + 0.5) for row in range(len(places))]
        axes.barh(at, values, height=0.92 * height, color=COLOURS[number], label=short_label(name))
    labels = [short_label("(none)" if place is None else str(place)) for place in places]
    label_rows(axes, labels)


def _lines(axes: Axes, places: Sequence[Any], series: Series) -> None:
    """Draw a line for each column, with points in the order of `places`."""
    from matplotlib.ticker import MaxNLocator

    order = sorted((place, row) for row, place in enumerate(places) if _drawable(place))
    at = [float(place) for place, _ in order]
    if all(place.is_integer() for place in at):
        axes.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
    for number, (name, values) in enumerate(series):
        marker = MARKERS[number] if len(order) <= MAX_MARKED else ""
        heights = [values[row] for _, row in order]
        axes.plot(at, heights, color=COLOURS[number], marker=marker, markersize=4, linewidth=1.4,
                  label=short_label(name))  # fmt: skip


MAX_SHOWN = 1000
"""Rows printed on a terminal."""
MAX_WIDTH = 60
"""Characters of a value printed on a terminal."""


def table_lines(answer: QueryAnswer, limit: int = MAX_SHOWN) -> tuple[list[str], bool]:
    """Return a heading and the first rows as lines, and whether there are more rows."""
    rows = [[_shown(value) for value in row] for row in islice(answer.rows, limit + 1)]
    more = len(rows) > limit
    table = [[_shown(name) for name in answer.columns], *rows[:limit]]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    ruled = [table[0], ["-" * width for width in widths], *table[1:]]
    lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in ruled)
    return list(lines), more


def save_csv(answer: QueryAnswer, path: Path) -> int:
    """Write CSV with a heading, and return the number of rows.

    Texts that a spreadsheet may interpret as formulas get an apostrophe.
    """
    with whole_file(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(map(_inert, answer.columns))
        count = 0
        for row in answer.rows:
            writer.writerow(map(_inert, row))
            count += 1
    return count


def save_json(answer: QueryAnswer, path: Path) -> int:
    """Write a JSON list with one object per line, and return the number of rows.

    NaN and infinite numbers become null because JSON does not have them.
    """
    count = 0
    with whole_file(path) as file:
        file.write("[")
        for count, row in enumerate(answer.rows, 1):
            file.write(",\n" if count > 1 else "\n")
            named = dict(zip(answer.columns, map(_finite, row), strict=True))
            json.dump(named, file, ensure_ascii=False, default=_number)
        file.write("\n]\n")
    return count


def save_parquet(answer: QueryAnswer, path: Path) -> int:
    """Write Parquet with Zstandard compression, and return the number of rows.

    Raises:
        MissingExtraError: polars is not installed.
        OSError: The file cannot be written.
    """
    try:
        import polars as pl
    except ImportError:
        raise MissingExtraError("Parquet", "data") from None
    rows = [tuple(map(_plain, row)) for row in answer.rows]
    # All rows decide about the types. The first hundred, polars' default, may all be null or whole
    # numbers.
    frame = pl.DataFrame(rows, list(answer.columns), orient="row", infer_schema_length=None)
    with whole_file(path, text=False) as file:
        frame.write_parquet(file, compression="zstd")
    return len(rows)


def _shown(value: Any) -> str:
    match value:
        case None:
            text = ""
        case float():
            text = f"{value:g}"
        case Decimal():
            text = _digits(value)
        case _:
            text = str(value)
    # Chat and names in the catalogue are from participants and may contain escape sequences for the
    # terminal.
    return printable(text if len(text) <= MAX_WIDTH else f"{text[: MAX_WIDTH - 1]}…")


def _inert(value: Any) -> Any:
    if isinstance(value, Decimal):
        return _digits(value)
    return csv_cell(value) if isinstance(value, str) else value


def _digits(number: Decimal) -> str:
    """Return a decimal without exponent and trailing zeros.

    PostgreSQL's mean of zeros has 20 digits after the point, which Python writes as `0E-20`.
    """
    text = f"{number:f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def _plain(value: Any) -> Any:
    return float(value) if isinstance(value, Decimal) else value


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not isfinite(value) else value


def _number(value: Any) -> Any:
    """Convert values without a JSON type. PostgreSQL returns sums and means as decimals."""
    return float(value) if isinstance(value, Decimal) else str(value)
