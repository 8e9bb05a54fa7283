"""Figures with a panel for each player, and the labels and colours of data sets."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sized
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from robotouille.html_report.figures import (
    COLOURS,
    ReportFigure,
    distinct_labels,
    draw_figure,
    short_label,
)
from robotouille_evaluation.packs.published_figures import REACT
from robotouille_evaluation.report.grouping import DATASETS, largest

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

T = TypeVar("T")

MAX_PANELS = 12
"""Players with a panel. If there are more, those with the most episodes are drawn."""
MAX_SETS = 8
"""Data sets that a figure draws for a player: those with the most episodes."""
PUBLISHED_PANEL = f"{REACT} (published)"
SHORT_NAMES = {"synchronous": "sync", "asynchronous": "async", "multi_agent": "team"}


def draw_panels(
    name: str,
    caption: str,
    panels: Mapping[str, list[T]],
    draw: Callable[[Axes, list[T]], None],
    draw_published: Callable[[Axes], None] | None = None,
) -> ReportFigure | None:
    """Draw a panel for each player and, unless it is None, one for published results.

    Returns:
        None without panels.
    """
    shown = largest(panels, MAX_PANELS)
    drawn: dict[str, Callable[[Axes], None]] = {
        title: partial(_draw_group, draw, group) for title, group in shown.items()
    }
    if draw_published is not None:
        drawn[PUBLISHED_PANEL] = draw_published
    if not drawn:
        return None
    labels = distinct_labels(drawn)
    columns = min(2, len(drawn))
    lines = -(-len(drawn) // columns)
    titles = [label.count("\n") for label in labels.values()]
    height = 2.6 * lines + 0.17 * sum(max(titles[i : i + columns])
                                      for i in range(0, len(titles), columns))  # fmt: skip

    def draw_all(figure: Figure) -> None:
        for i, (title, draw_panel) in enumerate(drawn.items()):
            axes = figure.add_subplot(lines, columns, i + 1)
            axes.set_title(labels[title])
            draw_panel(axes)

    words = caption + left_out(panels, shown)
    return draw_figure(name, words, (3.6 * columns, height), draw_all)


def _draw_group(draw: Callable[[Axes, list[T]], None], group: list[T], axes: Axes) -> None:
    draw(axes, group)


def left_out(groups: Sized, shown: Sized) -> str:
    """Return a sentence about players that a figure does not show, if any."""
    left = len(groups) - len(shown)
    return f" {left} more players are in the tables." if left else ""


def set_label(dataset: str) -> str:
    """Return the name of a data set for a legend."""
    return short_label(dataset.replace("_", "-"), 20)


def set_colour(dataset: str) -> str:
    """Return the colour of a data set."""
    return COLOURS[DATASETS.index(dataset) if dataset in DATASETS else 4]


def short_name(dataset: str) -> str:
    """Return a name of a data set that fits below a box."""
    return SHORT_NAMES.get(dataset, short_label(dataset, 8))
