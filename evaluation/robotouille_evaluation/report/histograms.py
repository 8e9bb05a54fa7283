"""Histograms of optimality and steps to go, and boxes of repeated transitions.

Published numbers of gpt-4o with ReAct are lines or boxes next to the results of ReAct agents. For
data sets without such results, they have a panel of their own.
"""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from robotouille.html_report.figures import INK, SOFT, ReportFigure
from robotouille_evaluation.metrics.outcomes import optimality_rate, succeeded
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.report.bins import (
    OPTIMALITY_BINS,
    STEPS_TO_GO_BINS,
    bin_of_steps_to_go,
    optimality_bin,
)
from robotouille_evaluation.report.grouping import (
    RowGroups,
    datasets,
    largest,
    may_be_react,
    named,
)
from robotouille_evaluation.report.panels import (
    MAX_SETS,
    draw_panels,
    set_colour,
    set_label,
    short_name,
)
from robotouille_evaluation.report.reference import Reference, Shares

if TYPE_CHECKING:
    from matplotlib.axes import Axes

V = TypeVar("V")

LABEL_CHARACTERS = 45
"""Characters that fit in a line below a histogram."""
MOST = 99.0
"""Least sum in per cent of a histogram whose bins are all known: printed shares are rounded."""


@dataclass(frozen=True, slots=True)
class Histogram:
    """Description of a histogram.

    Attributes:
        bins: Names of the bins.
        bin_of: Returns the bin of an episode, or None for episodes that do not count.
        across: Label of the horizontal axis.
        episodes: Episodes that count, for the label of the vertical axis.
    """

    name: str
    caption: str
    bins: Sequence[str]
    bin_of: Callable[[ResultRow], str | None]
    across: str
    episodes: str


def _optimality_bin(row: ResultRow) -> str | None:
    rate = optimality_rate(row)
    return None if rate is None else optimality_bin(rate)


def _steps_to_go_bin(row: ResultRow) -> str | None:
    return None if succeeded(row) else bin_of_steps_to_go(row.measures)


OPTIMALITY = Histogram(
    "optimality",
    "Optimality rates of successes by data set.",
    OPTIMALITY_BINS,
    _optimality_bin,
    "steps / fewest steps",
    "successes",
)
STEPS_TO_GO = Histogram(
    "steps_to_go",
    "Distance of failures from the goal. Below 0.5 is progress, 0.5 to 1 is little or none, more "
    "is farther away than at the start. A bin contains its lower bound.",
    STEPS_TO_GO_BINS,
    _steps_to_go_bin,
    "steps to go / fewest steps",
    "failures",
)


def optimality_histogram(rows: Sequence[ResultRow], reference: Reference) -> ReportFigure | None:
    """Draw the optimality rates of successes (paper, figure "histogram_optimality")."""
    return _draw(OPTIMALITY, rows, reference.optimality)


def steps_to_go_histogram(rows: Sequence[ResultRow], reference: Reference) -> ReportFigure | None:
    """Draw the normalised steps to go of failures (paper, figure "histogram_steps_to_go")."""
    return _draw(STEPS_TO_GO, rows, reference.steps_to_go)


def _draw(kind: Histogram, rows: Sequence[ResultRow], theirs: Shares) -> ReportFigure | None:
    counted = {
        name: [row for row in group if kind.bin_of(row) is not None]
        for name, group in named(rows).items()
    }
    groups = {name: group for name, group in counted.items() if group}
    alone = {
        dataset: shares
        for dataset, shares in _without_react(rows, groups, theirs).items()
        if sum(shares.get(name, 0) for name in kind.bins) > MOST
    }
    caption = kind.caption
    if _has_reference(groups, theirs):
        caption += " Lines across a bar are the published numbers of gpt-4o with ReAct."
    if alone:
        caption += " Hollow bars are the published numbers of gpt-4o with ReAct."
    return draw_panels(
        kind.name,
        caption,
        groups,
        lambda axes, group: _own_bars(axes, kind, group, theirs),
        partial(_published_bars, kind=kind, theirs=alone) if alone else None,
    )


def _has_reference(groups: RowGroups, theirs: Mapping[str, object]) -> bool:
    """Return True if published numbers of ReAct stand next to results of a group."""
    return any(row.dataset in theirs and may_be_react(row) for g in groups.values() for row in g)


def _without_react(
    rows: Sequence[ResultRow], groups: RowGroups, theirs: Mapping[str, V]
) -> dict[str, V]:
    """Return the published numbers of data sets without results of ReAct agents."""
    played = {row.dataset for row in rows if not row.variant}
    shown = {row.dataset for group in groups.values() for row in group if may_be_react(row)}
    return {dataset: value for dataset, value in theirs.items() if dataset in played - shown}


def _own_bars(axes: Axes, kind: Histogram, group: Sequence[ResultRow], theirs: Shares) -> None:
    """Draw the share of each bin, with a bar for each data set and lines for published shares."""
    sets = largest(datasets(group), MAX_SETS)
    for number, (dataset, episodes) in enumerate(sets.items()):
        counts = Counter(found for row in episodes if (found := kind.bin_of(row)) is not None)
        total = max(1, counts.total())
        places, width = _places(kind, number, len(sets))
        shares = [100 * counts[name] / total for name in kind.bins]
        label = f"{set_label(dataset)} ({counts.total()})"
        axes.bar(places, shares, width * 0.9, color=set_colour(dataset), label=label)
        for place, name in zip(places, kind.bins, strict=True):
            value = theirs.get(dataset, {}).get(name)
            if value is not None and may_be_react(episodes[0]):
                ends = [place - width / 2, place + width / 2]
                axes.plot(ends, [value, value], color=INK, linewidth=1.6)
    _label_axes(axes, kind)


def _published_bars(axes: Axes, kind: Histogram, theirs: Shares) -> None:
    """Draw published shares as hollow bars."""
    for number, (dataset, shares) in enumerate(theirs.items()):
        places, width = _places(kind, number, len(theirs))
        values = [shares.get(name, 0) for name in kind.bins]
        colour, label = set_colour(dataset), set_label(dataset)
        axes.bar(places, values, width * 0.9, color="none", edgecolor=colour, label=label)
    _label_axes(axes, kind)


def _places(kind: Histogram, number: int, sets: int) -> tuple[list[float], float]:
    """Return the middles of a data set's bars, and the width of a bar with its gap."""
    width = 0.8 / sets
    return [i - 0.4 + width * (number + 0.5) for i in range(len(kind.bins))], width


def _label_axes(axes: Axes, kind: Histogram) -> None:
    width = LABEL_CHARACTERS // len(kind.bins)
    labels = [textwrap.fill(name.replace("more than", ">"), width) for name in kind.bins]
    axes.set_xticks(range(len(kind.bins)), labels)
    axes.tick_params(axis="x", labelsize=8, length=0)
    axes.set_ylim(0, 140)  # Room for the legend above the bars.
    axes.set_yticks([0, 25, 50, 75, 100])
    axes.legend(loc="upper right", borderaxespad=0, fontsize=7.5, handlelength=1)
    axes.set_xlabel(kind.across)
    axes.set_ylabel(f"% of {kind.episodes}")


# Repeated transitions

RESULTS = {"successes": "won", "failures": "lost"}


class Box(NamedTuple):
    """Box of the repeated transitions of some episodes."""

    label: str
    values: Sequence[float]
    dataset: str
    reference: bool = False


def repeated_transitions(rows: Sequence[ResultRow], reference: Reference) -> ReportFigure | None:
    """Draw the repeated transitions of episodes (paper, "histogram_repeated_transitions")."""
    groups = named(rows)
    known = {dataset: None for dataset, _ in reference.repetitions}
    alone = _without_react(rows, groups, known)
    published = [
        Box(f"{short_name(dataset)}\n{RESULTS[kind]}", values, dataset, reference=True)
        for (dataset, kind), values in reference.repetitions.items()
        if dataset in alone
    ]
    caption = (
        "Steps that repeat an earlier step of the episode. Boxes span the quartiles, with a line "
        "at the median. Whiskers extend to 1.5 times the height of the box."
    )
    if published or _has_reference(groups, known):
        caption += " Hollow boxes are the published results of gpt-4o with ReAct."
    return draw_panels(
        "repeated_transitions",
        caption,
        groups,
        lambda axes, group: _boxes(axes, _own_boxes(group, reference)),
        partial(_boxes, shown=published) if published else None,
    )


def _own_boxes(group: Sequence[ResultRow], reference: Reference) -> list[Box]:
    shown = []
    for dataset, episodes in largest(datasets(group), MAX_SETS).items():
        for kind, result in RESULTS.items():
            won = kind == "successes"
            found = [row.repetitions for row in episodes if succeeded(row) == won]
            if found:
                shown.append(Box(f"{short_name(dataset)}\n{result}", found, dataset))
            theirs = reference.repetitions.get((dataset, kind))
            if theirs and may_be_react(episodes[0]):
                shown.append(Box(f"paper\n{result}", theirs, dataset, reference=True))
    return shown


def _boxes(axes: Axes, shown: Sequence[Box]) -> None:
    values = [list(box.values) for box in shown]
    drawn = axes.boxplot(values, tick_labels=[box.label for box in shown], patch_artist=True,
                         widths=0.6, medianprops={"color": INK, "linewidth": 1.6},
                         whiskerprops={"color": SOFT}, capprops={"color": SOFT},
                         flierprops={"markersize": 3, "markeredgecolor": SOFT})  # fmt: skip
    for box, patch in zip(shown, drawn["boxes"], strict=True):
        colour = set_colour(box.dataset)
        patch.set(facecolor="none" if box.reference else colour, edgecolor=colour, alpha=0.75)
    axes.tick_params(axis="x", labelsize=7.5, length=0)
    axes.set_ylim(-0.5, max(4, 1.05 * max(map(max, values))))
    axes.set_ylabel("repeated transitions")
