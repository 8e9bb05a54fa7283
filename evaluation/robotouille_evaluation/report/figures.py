"""Figures of the paper's evaluation, drawn from own results next to the published numbers."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from robotouille.html_report.figures import (
    COLOURS,
    INK,
    SOFT,
    ReportFigure,
    distinct_labels,
    draw_figure,
    label_rows,
    legend_above,
    short_label,
)
from robotouille.html_report.intervals import Interval
from robotouille_evaluation.metrics.outcomes import optimality_rate, succeeded, with_goal
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.report import published
from robotouille_evaluation.report.bins import (
    OPTIMALITY_BINS,
    STEPS_TO_GO_BINS,
    optimality_bin,
)
from robotouille_evaluation.report.grouping import (
    DATASETS,
    RowGroups,
    datasets,
    interval,
    largest,
    may_be_react,
    named,
    part_played,
)
from robotouille_evaluation.report.reference import FailureKind, Reference
from robotouille_evaluation.report.tables import bin_of_steps_to_go

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

T = TypeVar("T")

MAX_PANELS, MAX_BARS = 12, 40
"""Players with a panel or with bars. If there are more, those with the most episodes are drawn."""
MAX_SETS = 8
"""Data sets that a figure draws for a player: those with the most episodes."""
CATEGORY_COLOURS = {
    "state": COLOURS[0],
    "action": COLOURS[3],
    "transition": COLOURS[1],
    "goal": COLOURS[2],
    "other": SOFT,
}
LABEL_CHARACTERS = 45
"""Characters that fit in a line below a histogram."""
LINES_CAPTION = " Lines across a bar are the published numbers of gpt-4o with ReAct."
SHORT_NAMES = {"synchronous": "sync", "asynchronous": "async", "multi_agent": "team"}


def all_figures(
    rows: Sequence[ResultRow], reference: Reference = Reference()
) -> list[ReportFigure]:
    """Return every figure for which there is data, with published numbers for reference.

    Shifts have tables only.
    """
    rows = with_goal(rows)
    figures = [optimality_histogram, steps_to_go_histogram, repeated_transitions, failure_pies]
    drawn = [success_bars(rows), *(figure(rows, reference) for figure in figures)]
    return [figure for figure in drawn if figure is not None]


# Success


class PlayerBars(NamedTuple):
    """Bars of one player: its success by data set, and which part of a data set was played."""

    label: str
    shares: dict[str, Interval | None]
    reference: bool = False
    parts: Mapping[str, str] = {}

    @property
    def height(self) -> float:
        """Height of the bars or of the label, in bars."""
        return max(len(self.shares), 0.9 * (self.label.count("\n") + 1))


def success_bars(rows: Sequence[ResultRow]) -> ReportFigure | None:
    """Draw success by data set, a group of bars for each player. Published bars are hollow."""
    all_sets = datasets(rows)
    if not all_sets:
        return None
    sets = list(largest(all_sets, MAX_SETS))
    groups = {
        name: own
        for name, group in named(rows).items()
        if (own := [row for row in group if row.dataset in sets])
    }
    shown = largest(groups, MAX_BARS)
    bars = [*_own_bars(shown), *_published_bars(sets)]
    height = 1.1 + 0.19 * sum(each.height + 0.7 for each in bars)
    caption = (
        "Success by data set in per cent, with 95 % intervals. Hollow bars are published numbers "
        f"({published.SOURCE}).{_left_out(groups, shown)}"
    )
    if left := len(all_sets) - len(sets):
        caption += f" {left} more data sets are left out."
    return draw_figure(
        "success", caption, (7.2, height), lambda figure: _bars(figure.add_subplot(), bars, sets)
    )


def _left_out(groups: Sized, shown: Sized) -> str:
    left = len(groups) - len(shown)
    return f" {left} more players are in the tables." if left else ""


def _own_bars(groups: RowGroups) -> Iterator[PlayerBars]:
    labels = distinct_labels(groups)
    for name, group in groups.items():
        own = datasets(group)
        shares = {each: interval(episodes, succeeded) for each, episodes in own.items()}
        parts = {each: part_played(each, episodes) for each, episodes in own.items()}
        yield PlayerBars(labels[name], shares, parts=parts)


def _published_bars(sets: Sequence[str]) -> Iterator[PlayerBars]:
    for each in published.SUCCESS:
        if each.model != "gpt-4o":
            continue
        known = {"synchronous": each.synchronous, "asynchronous": each.asynchronous}
        shares: dict[str, Interval | None] = {
            name: Interval(value / 100, None, None, 100)
            for name, value in known.items()
            if value is not None and name in sets
        }
        if shares:
            yield PlayerBars(f"{each.model}, {each.strategy} (published)", shares, reference=True)


def _bars(axes: Axes, bars: Sequence[PlayerBars], sets: Sequence[str]) -> None:
    from matplotlib.patches import Patch

    middles, place = [], 0.0
    for player in bars:
        begin = place
        place += (player.height - len(player.shares)) / 2
        for name in sets:
            if found := player.shares.get(name):
                part = player.parts.get(name, "")
                _bar(axes, place, found, _set_colour(name), player.reference, part)
                place += 1
        middles.append(begin + (player.height - 1) / 2)
        place = begin + player.height + 0.7
    label_rows(axes, [player.label for player in bars], middles)
    axes.set_ylim(place - 0.9, -0.9)
    axes.set_xlim(0, 130 if any(any(player.parts.values()) for player in bars) else 108)
    axes.set_xticks(range(0, 101, 20))
    axes.set_xlabel("success, %")
    patches = [Patch(color=_set_colour(name), label=_set_label(name)) for name in sets]
    legend_above(axes, 3, patches)


def _bar(
    axes: Axes, place: float, found: Interval, colour: str, reference: bool, part: str
) -> None:
    share = 100 * found.estimate
    face = "none" if reference else colour
    axes.barh(place, share, height=0.86, color=face, edgecolor=colour, linewidth=1)
    if found.low is not None and found.high is not None:
        ends = [100 * found.low, 100 * found.high]
        axes.plot(ends, [place + 0.36] * 2, color=INK, linewidth=1)
    text = f"{share:.3g} ({part})" if part else f"{share:.3g}"
    # The interval is at the lower edge of the bar, so the label fits between the two.
    axes.text(share + 1, place - 0.06, text, va="center", fontsize=8)


def _set_label(dataset: str) -> str:
    return short_label(dataset.replace("_", "-"), 20)


def _set_colour(dataset: str) -> str:
    return COLOURS[DATASETS.index(dataset) if dataset in DATASETS else 4]


# Histograms, with a panel for each player


def _panels(
    name: str,
    caption: str,
    panels: Mapping[str, list[T]],
    draw: Callable[[Axes, list[T]], None],
) -> ReportFigure | None:
    shown = largest(panels, MAX_PANELS)
    if not shown:
        return None
    labels = distinct_labels(shown)
    columns = min(2, len(shown))
    lines = -(-len(shown) // columns)
    titles = [label.count("\n") for label in labels.values()]
    height = 2.6 * lines + 0.17 * sum(max(titles[i : i + columns])
                                      for i in range(0, len(titles), columns))  # fmt: skip

    def draw_all(figure: Figure) -> None:
        for i, (title, group) in enumerate(shown.items()):
            axes = figure.add_subplot(lines, columns, i + 1)
            axes.set_title(labels[title])
            draw(axes, group)

    return draw_figure(
        name, caption + _left_out(panels, shown), (3.6 * columns, height), draw_all
    )  # fmt: skip


def _chosen(rows: Sequence[ResultRow], wanted: Callable[[ResultRow], bool]) -> RowGroups:
    groups = {name: list(filter(wanted, group)) for name, group in named(rows).items()}
    return {name: group for name, group in groups.items() if group}


def _optimality_bin(row: ResultRow) -> str | None:
    rate = optimality_rate(row)
    return None if rate is None else optimality_bin(rate)


def optimality_histogram(rows: Sequence[ResultRow], reference: Reference) -> ReportFigure | None:
    """Draw the optimality rates of successes (paper, figure "histogram_optimality")."""

    def draw(axes: Axes, group: list[ResultRow]) -> None:
        _histogram(axes, group, _optimality_bin, OPTIMALITY_BINS, reference.optimality)
        axes.set_xlabel("steps / fewest steps")
        axes.set_ylabel("% of successes")

    groups = _chosen(rows, lambda row: _optimality_bin(row) is not None)
    caption = "Optimality rates of successes by data set."
    if _has_reference(groups, reference.optimality):
        caption += LINES_CAPTION
    return _panels("optimality", caption, groups, draw)


def steps_to_go_histogram(rows: Sequence[ResultRow], reference: Reference) -> ReportFigure | None:
    """Draw the normalised steps to go of failures (paper, figure "histogram_steps_to_go")."""

    def bin_of(row: ResultRow) -> str | None:
        return bin_of_steps_to_go(row.measures)

    def draw(axes: Axes, group: list[ResultRow]) -> None:
        _histogram(axes, group, bin_of, STEPS_TO_GO_BINS, reference.steps_to_go)
        axes.set_xlabel("steps to go / fewest steps")
        axes.set_ylabel("% of failures")

    groups = _chosen(rows, lambda row: not succeeded(row) and bin_of(row) is not None)
    caption = (
        "Distance of failures from the goal. Below 0.5 is progress, 0.5 to 1 is little or none, "
        "more is farther away than at the start. A bin contains its lower bound."
    )
    if _has_reference(groups, reference.steps_to_go):
        caption += LINES_CAPTION
    return _panels("steps_to_go", caption, groups, draw)


def _has_reference(groups: RowGroups, theirs: Mapping[str, object]) -> bool:
    """Return True if published numbers of ReAct stand next to results of a group."""
    return any(row.dataset in theirs and may_be_react(row) for g in groups.values() for row in g)


def _histogram(
    axes: Axes,
    group: list[ResultRow],
    bin_of: Callable[[ResultRow], str | None],
    names: Sequence[str],
    theirs: Mapping[str, Mapping[str, float]],
) -> None:
    """Draw the share of each bin, with a bar for each data set and lines for published shares."""
    sets = largest(datasets(group), MAX_SETS)
    width = 0.8 / len(sets)
    for i, (dataset, episodes) in enumerate(sets.items()):
        counts = Counter(found for row in episodes if (found := bin_of(row)) is not None)
        total = max(1, counts.total())
        places = [j - 0.4 + width * (i + 0.5) for j in range(len(names))]
        shares = [100 * counts[name] / total for name in names]
        label = f"{_set_label(dataset)} ({counts.total()})"
        axes.bar(places, shares, width * 0.9, color=_set_colour(dataset), label=label)
        for place, name in zip(places, names, strict=True):
            value = theirs.get(dataset, {}).get(name)
            if value is not None and may_be_react(episodes[0]):
                ends = [place - width / 2, place + width / 2]
                axes.plot(ends, [value, value], color=INK, linewidth=1.6)
    width_of_label = LABEL_CHARACTERS // len(names)
    labels = [textwrap.fill(name.replace("more than", ">"), width_of_label) for name in names]
    axes.set_xticks(range(len(names)), labels)
    axes.tick_params(axis="x", labelsize=8, length=0)
    axes.set_ylim(0, 140)  # Room for the legend above the bars.
    axes.set_yticks([0, 25, 50, 75, 100])
    axes.legend(loc="upper right", borderaxespad=0, fontsize=7.5, handlelength=1)


def repeated_transitions(rows: Sequence[ResultRow], reference: Reference) -> ReportFigure | None:
    """Draw the repeated transitions of episodes (paper, "histogram_repeated_transitions")."""

    def draw(axes: Axes, group: list[ResultRow]) -> None:
        labels: list[str] = []
        values: list[list[float]] = []
        faces: list[str] = []
        edges: list[str] = []
        for dataset, episodes in largest(datasets(group), MAX_SETS).items():
            colour = _set_colour(dataset)
            for result, won in (("won", True), ("lost", False)):
                found: list[float] = [row.repetitions for row in episodes if succeeded(row) == won]
                if found:
                    labels.append(f"{_short_name(dataset)}\n{result}")
                    values.append(found)
                    faces.append(colour)
                    edges.append(colour)
                theirs = reference.repetitions.get((dataset, "successes" if won else "failures"))
                if theirs and may_be_react(episodes[0]):
                    labels.append(f"paper\n{result}")
                    values.append(list(theirs))
                    faces.append("none")
                    edges.append(colour)
        boxes = axes.boxplot(values, tick_labels=labels, patch_artist=True, widths=0.6,
                             medianprops={"color": INK, "linewidth": 1.6},
                             whiskerprops={"color": SOFT}, capprops={"color": SOFT},
                             flierprops={"markersize": 3, "markeredgecolor": SOFT})  # fmt: skip
        for box, face, edge in zip(boxes["boxes"], faces, edges, strict=True):
            box.set(facecolor=face, edgecolor=edge, alpha=0.75)
        axes.tick_params(axis="x", labelsize=7.5, length=0)
        axes.set_ylim(-0.5, max(4, 1.05 * max(map(max, values))))
        axes.set_ylabel("repeated transitions")

    groups = named(rows)
    caption = (
        "Steps that repeat an earlier step of the episode. Boxes span the quartiles, with a line "
        "at the median. Whiskers extend to 1.5 times the height of the box."
    )
    if _has_reference(groups, {dataset: None for dataset, _ in reference.repetitions}):
        caption += " Hollow boxes are the published results of gpt-4o with ReAct."
    return _panels("repeated_transitions", caption, groups, draw)


def _short_name(dataset: str) -> str:
    return SHORT_NAMES.get(dataset, short_label(dataset, 8))


# Failures


def failure_pies(rows: Sequence[ResultRow], reference: Reference) -> ReportFigure | None:
    """Draw failures by category and subcategory, nested (paper, figure "piechart_taxonomy")."""
    pies: dict[str, list[FailureKind]] = {}
    for name, group in named(rows).items():
        for dataset, episodes in datasets(group).items():
            causes = [cause for row in episodes if (cause := row.measures.failure)]
            if causes:
                label = f"{name} · {_short_name(dataset)} ({len(causes)})"
                pies[label] = [(cause.category, cause.subcategory) for cause in causes]
    sets = datasets(rows) if pies else {}
    for (player, dataset), kinds in reference.failure_kinds.items():
        if dataset in sets:
            pies[f"{player} · {_short_name(dataset)} ({len(kinds)}, published)"] = list(kinds)
    caption = (
        "Reasons for failures according to the classifier. The outer ring is the category (state, "
        "action, transition function or goal), the inner ring the subcategory."
    )
    if reference.failure_kinds:
        caption += " People decided about the published failures."
    return _panels("failures", caption, pies, _pie)


def _pie(axes: Axes, failures: list[FailureKind]) -> None:
    kinds = Counter(failures)
    order = sorted(kinds, key=lambda kind: (list(CATEGORY_COLOURS).index(kind[0]), kind[1]))
    outer = Counter[str]()
    for category, subcategory in order:
        outer[category] += kinds[category, subcategory]
    total = sum(outer.values())
    edge = {"edgecolor": "white", "linewidth": 1}
    axes.pie(
        list(outer.values()),
        colors=[CATEGORY_COLOURS[name] for name in outer],
        labels=[f"{name} {100 * n / total:.0f} %" for name, n in outer.items()],
        radius=1,
        startangle=90,
        counterclock=False,
        labeldistance=1.08,
        textprops={"fontsize": 8},
        wedgeprops={"width": 0.3, **edge},
    )
    wedges = axes.pie(
        [kinds[kind] for kind in order],
        colors=[CATEGORY_COLOURS[category] for category, _ in order],
        radius=0.68,
        startangle=90,
        counterclock=False,
        wedgeprops={"width": 0.3, "alpha": 0.6, **edge},
    )[0]
    common = [(kinds[kind], kind[1], w) for kind, w in zip(order, wedges, strict=True)]
    shown = sorted(common, key=lambda each: -each[0])[:4]
    labels = [f"{_short_kind(name)} {100 * count / total:.0f} %" for count, name, _ in shown]
    axes.legend([w for *_, w in shown], labels, loc="upper center", bbox_to_anchor=(0.5, 0),
                fontsize=7, ncols=2, handlelength=1, columnspacing=1)  # fmt: skip
    axes.grid(visible=False)


def _short_kind(subcategory: str) -> str:
    """Return a subcategory that fits into the legend: `'One item at station'`."""
    return short_label(subcategory.removeprefix("Violates ").removesuffix(" rule"), 25)
