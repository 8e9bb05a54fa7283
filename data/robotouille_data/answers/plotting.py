"""A simple picture of an answer: bars of what has names, lines of what has numbers.

The first column of words, or else the first column, is what the others are drawn by. All other
columns of numbers are drawn: as bars where that one has words, as lines where it has numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from importlib.util import find_spec
from itertools import islice
from math import isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotouille.domain.files import whole_file
from robotouille.errors import MissingExtraError
from robotouille_client.console.pages.drawing import drawn, plain
from robotouille_data.answers.query import Answer
from robotouille_data.errors import CatalogueError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["save_plot"]

MAX_BARS, MAX_POINTS, MAX_SERIES = 60, 100_000, 6
COLOURS = ("#1a80c4", "#d55e00", "#009e73", "#b9629b", "#b08800", "#64748b")
MARKERS = ("o", "s", "^", "D", "v", "P")
MAX_MARKED = 60
"""Points of a line up to which each has a mark."""

Series = list[tuple[str, list[float]]]


def save_plot(answer: Answer, path: Path) -> int:
    """Draw an answer as SVG or PNG; how many rows there are.

    Raises:
        MissingExtraError: Matplotlib is not installed.
        CatalogueError: The file is called otherwise, or the answer is none that can be drawn.
        OSError: The file cannot be written.
    """
    if path.suffix not in (".svg", ".png"):
        raise CatalogueError(f"{path}: a plot is called .svg or .png")
    if not all(map(find_spec, ("matplotlib", "numpy"))):
        raise MissingExtraError("a plot", "data")
    rows = [tuple(map(_plain, row)) for row in islice(answer.rows, MAX_POINTS + 1)]
    by = _drawn_by(answer.columns, rows)
    series = _series(answer.columns, rows, by)
    places = [row[by] for row in rows]
    words = any(isinstance(place, str) for place in places)
    if len(rows) > (MAX_BARS if words else MAX_POINTS):
        most = f"{MAX_BARS} bars" if words else f"{MAX_POINTS:,} points"
        raise CatalogueError(f"there is room for {most}: let the query group more, or LIMIT it")

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        (_bars if words else _lines)(axes, places, series)
        label = plain(answer.columns[by])
        (axes.set_ylabel if words else axes.set_xlabel)(label)
        if len(series) == 1:
            (axes.set_xlabel if words else axes.set_ylabel)(plain(series[0][0]))
        else:
            figure.legend(loc="outside upper left", ncols=4)

    height = 1.0 + 0.2 * len(rows) * (len(series) + 0.6) if words else 4.2
    picture = drawn("plot", "", (7.6, max(2.0, height)), draw, png=path.suffix == ".png")
    with whole_file(path, text=path.suffix == ".svg") as file:
        file.write(picture.svg if path.suffix == ".svg" else picture.png)
    return len(rows)


def _plain(value: Any) -> Any:
    return float(value) if isinstance(value, Decimal | bool) else value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)


def _drawn_by(columns: Sequence[str], rows: Sequence[tuple[Any, ...]]) -> int:
    """The place of the first column of words, or of the first."""
    if not rows:
        raise CatalogueError("the answer has no rows: there is nothing to draw")
    words = (n for n in range(len(columns)) if any(isinstance(row[n], str) for row in rows))
    return next(words, 0)


def _series(columns: Sequence[str], rows: Sequence[tuple[Any, ...]], by: int) -> Series:
    """The columns of numbers but that one; what is null or endless is a gap."""
    found: Series = []
    for place, name in enumerate(columns):
        values = [row[place] for row in rows]
        known = [value for value in values if value is not None]
        if place != by and known and all(map(_is_number, known)):
            numbers = (nan if value is None else float(value) for value in values)
            found.append((name, [n if isfinite(n) else nan for n in numbers]))
    if not found:
        raise CatalogueError(f"the answer has no column of numbers besides `{columns[by]}`")
    if len(found) > MAX_SERIES:
        raise CatalogueError(f"there is room for {MAX_SERIES} columns of numbers, not {len(found)}")
    return found


def _bars(axes: Axes, places: Sequence[Any], series: Series) -> None:
    """Groups of bars, from above; one for each column."""
    height = 0.8 / len(series)
    for number, (name, values) in enumerate(series):
        at = [row - 0.4 + height * (number + 0.5) for row in range(len(places))]
        axes.barh(at, values, height=0.92 * height, color=COLOURS[number], label=plain(name))
    labels = [plain("(none)" if place is None else str(place)) for place in places]
    axes.set_yticks(range(len(places)), labels)
    axes.set_ylim(len(places) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.grid(visible=True, axis="x")


def _lines(axes: Axes, places: Sequence[Any], series: Series) -> None:
    """A line for each column, in the order of the numbers that they are drawn by."""
    from matplotlib.ticker import MaxNLocator

    order = sorted((place, row) for row, place in enumerate(places) if place is not None)
    at = [float(place) for place, _ in order]
    if all(place.is_integer() for place in at):
        axes.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
    for number, (name, values) in enumerate(series):
        marker = MARKERS[number] if len(order) <= MAX_MARKED else ""
        heights = [values[row] for _, row in order]
        axes.plot(at, heights, color=COLOURS[number], marker=marker, markersize=4, linewidth=1.4,
                  label=plain(name))  # fmt: skip
