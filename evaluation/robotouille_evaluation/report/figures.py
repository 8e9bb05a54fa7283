"""Figures of the paper's evaluation, drawn from own results next to the published numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

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
from robotouille_evaluation.metrics.outcomes import succeeded, with_goal
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.report import published
from robotouille_evaluation.report.grouping import (
    RowGroups,
    datasets,
    interval,
    largest,
    named,
    part_played,
)
from robotouille_evaluation.report.histograms import (
    optimality_histogram,
    repeated_transitions,
    steps_to_go_histogram,
)
from robotouille_evaluation.report.panels import (
    MAX_SETS,
    draw_panels,
    left_out,
    set_colour,
    set_label,
    short_name,
)
from robotouille_evaluation.report.reference import FailureKind, Reference

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_BARS = 40
"""Players with bars. If there are more, those with the most episodes are drawn."""
CATEGORY_COLOURS = {
    "state": COLOURS[0],
    "action": COLOURS[3],
    "transition": COLOURS[1],
    "goal": COLOURS[2],
    "other": SOFT,
}
NARROW = 0.025
"""Share of a wedge that gets no label."""


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
        f"({published.SOURCE}).{left_out(groups, shown)}"
    )
    if left := len(all_sets) - len(sets):
        caption += f" {left} more data sets are left out."
    return draw_figure(
        "success", caption, (7.2, height), lambda figure: _bars(figure.add_subplot(), bars, sets)
    )


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
                _bar(axes, place, found, set_colour(name), player.reference, part)
                place += 1
        middles.append(begin + (player.height - 1) / 2)
        place = begin + player.height + 0.7
    label_rows(axes, [player.label for player in bars], middles)
    axes.set_ylim(place - 0.9, -0.9)
    axes.set_xlim(0, 130 if any(any(player.parts.values()) for player in bars) else 108)
    axes.set_xticks(range(0, 101, 20))
    axes.set_xlabel("success, %")
    patches = [Patch(color=set_colour(name), label=set_label(name)) for name in sets]
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


# Failures


def failure_pies(rows: Sequence[ResultRow], reference: Reference) -> ReportFigure | None:
    """Draw failures by category and subcategory, nested (paper, figure "piechart_taxonomy")."""
    pies: dict[str, list[FailureKind]] = {}
    for name, group in named(rows).items():
        for dataset, episodes in datasets(group).items():
            causes = [cause for row in episodes if (cause := row.measures.failure)]
            if causes:
                label = f"{name} · {short_name(dataset)} ({len(causes)})"
                pies[label] = [(cause.category, cause.subcategory) for cause in causes]
    sets = datasets(rows) if pies else {}
    for (player, dataset), kinds in reference.failure_kinds.items():
        if dataset in sets:
            pies[f"{player} · {short_name(dataset)} ({len(kinds)}, published)"] = list(kinds)
    caption = (
        "Reasons for failures according to the classifier. The outer ring is the category (state, "
        "action, transition function or goal), the inner ring the subcategory."
    )
    if reference.failure_kinds:
        caption += " People decided about the published failures."
    return draw_panels("failures", caption, pies, _pie)


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
        # Labels of narrow wedges would overlap; the legend or the tables have their shares.
        labels=[
            f"{name} {100 * n / total:.0f} %" if n > NARROW * total else ""
            for name, n in outer.items()
        ],
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
