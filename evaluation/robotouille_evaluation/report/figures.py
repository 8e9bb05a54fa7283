"""The figures of the paper's evaluation from own results, the published numbers beside them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from robotouille_client.console.pages.drawing import (
    COLOURS,
    INK,
    SOFT,
    Picture,
    distinct_labels,
    drawn,
    plain,
)
from robotouille_evaluation.metrics.intervals import Interval
from robotouille_evaluation.metrics.outcomes import optimality_rate, succeeded
from robotouille_evaluation.metrics.rows import EpisodeRow
from robotouille_evaluation.report import published
from robotouille_evaluation.report.grouping import datasets, interval, named, part_played
from robotouille_evaluation.report.tables import STEPS_TO_GO_BINS, bin_of_steps_to_go

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["all_figures"]

MAX_PANELS, MAX_BARS = 12, 40
"""Players that have a panel, or bars; those with most episodes."""
OPTIMALITY_BINS = ("1", "1 to 1.25", "1.25 to 1.5", "more than 1.5")
CATEGORY_COLOURS = {
    "state": COLOURS[0],
    "action": COLOURS[3],
    "transition": COLOURS[1],
    "goal": COLOURS[2],
    "other": SOFT,
}
Groups = Mapping[str, list[EpisodeRow]]


def all_figures(rows: Sequence[EpisodeRow]) -> list[Picture]:
    """Every figure for which there are rows."""
    figures = [success_bars, optimality_histogram, steps_to_go_histogram, repeated_transitions,
               failure_pies]  # fmt: skip
    return [picture for figure in figures if (picture := figure(rows)) is not None]


# Success


class Bar(NamedTuple):
    """One bar: who, in which data set, and how often."""

    label: str
    shares: dict[str, Interval | None]
    reference: bool = False
    parts: Mapping[str, str] = {}
    """Of a data set that was not played whole, how much."""

    @property
    def room(self) -> float:
        """The height that it needs, in bars."""
        return max(len(self.shares), 0.9 * (self.label.count("\n") + 1))


def success_bars(rows: Sequence[EpisodeRow]) -> Picture | None:
    """Success by data set, a group of bars a player; published ones are hollow."""
    sets = list(datasets(rows))
    if not sets:
        return None
    own, left = _own_bars(rows)
    bars = [*own, *_published_bars(sets)]
    height = 1.1 + 0.19 * sum(bar.room + 0.7 for bar in bars)

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        _bars(axes, bars, sets)

    caption = (
        "Success by data set in per cent, with 95 % intervals. Hollow bars are published figures "
        f"({published.SOURCE})."
    )
    caption += f" {left} more players are in the tables." if left else ""
    return drawn("success", caption, (7.2, height), draw)


def _own_bars(rows: Sequence[EpisodeRow]) -> tuple[list[Bar], int]:
    """The bars, and how many players are left out."""
    groups = named(rows)
    shown = _largest(groups, MAX_BARS)
    labels = distinct_labels(shown)
    bars = []
    for name, group in shown.items():
        own = datasets(group)
        shares = {each: interval(episodes, succeeded) for each, episodes in own.items()}
        parts = {each: part_played(each, episodes) for each, episodes in own.items()}
        bars.append(Bar(labels[name], shares, parts=parts))
    return bars, len(groups) - len(shown)


def _largest(groups: Groups, number: int) -> Groups:
    """The groups with most rows, in their order."""
    chosen = sorted(groups, key=lambda name: -len(groups[name]))[:number]
    return {name: groups[name] for name in groups if name in set(chosen)}


def _published_bars(sets: Sequence[str]) -> Iterator[Bar]:
    for each in published.SUCCESS:
        if each.model != "gpt-4o":
            continue
        known = {"synchronous": each.synchronous, "asynchronous": each.asynchronous}
        shares = {
            name: Interval(value / 100, value / 100, value / 100, 100)
            for name, value in known.items()
            if value is not None and name in sets
        }
        if shares:
            yield Bar(f"{each.model}, {each.strategy} (published)", dict(shares), True)


def _bars(axes: Axes, bars: Sequence[Bar], sets: Sequence[str]) -> None:
    middles, place = [], 0.0
    for bar in bars:
        begin = place
        place += (bar.room - len(bar.shares)) / 2
        for name in sets:
            if found := bar.shares.get(name):
                part = bar.parts.get(name, "")
                _bar(axes, place, found, _set_colour(name), bar.reference, part)
                place += 1
        middles.append(begin + (bar.room - 1) / 2)
        place = begin + bar.room + 0.7
    axes.set_yticks(middles, [bar.label for bar in bars])
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(place - 0.9, -0.9)
    axes.set_xlim(0, 130 if any(any(bar.parts.values()) for bar in bars) else 108)
    axes.set_xticks(range(0, 101, 20))
    axes.set_xlabel("success, %")
    axes.grid(visible=False, axis="y")
    axes.grid(visible=True, axis="x")
    _legend_of_sets(axes, sets)


def _bar(
    axes: Axes, place: float, found: Interval, colour: str, reference: bool, part: str
) -> None:
    mean = high = 100 * found.mean
    face = "none" if reference else colour
    axes.barh(place, mean, height=0.86, color=face, edgecolor=colour, linewidth=1)
    if not reference and found.low is not None and found.high is not None:
        high = 100 * found.high
        axes.plot([100 * found.low, high], [place, place], color=INK, linewidth=1)
    said = f"{mean:.3g} ({part})" if part else f"{mean:.3g}"
    axes.text(high + 1, place, said, va="center", fontsize=8)


def _legend_of_sets(axes: Axes, sets: Sequence[str]) -> None:
    from matplotlib.patches import Patch

    patches = [Patch(color=_set_colour(name), label=_set_label(name)) for name in sets]
    axes.legend(handles=patches, loc="lower left", bbox_to_anchor=(0, 1), ncols=3, borderaxespad=0)


# Histograms, a panel a player


def _panels(
    name: str, caption: str, panels: Groups, draw: Callable[[Axes, list[EpisodeRow]], None]
) -> Picture | None:
    shown = _largest(panels, MAX_PANELS)
    labels = distinct_labels(shown)
    if not shown:
        return None
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

    left = len(panels) - len(shown)
    caption += f" {left} more players are in the tables." if left else ""
    return drawn(name, caption, (3.6 * columns, height), draw_all)


def _chosen(rows: Sequence[EpisodeRow], wanted: Callable[[EpisodeRow], bool]) -> Groups:
    groups = {name: list(filter(wanted, group)) for name, group in named(rows).items()}
    return {name: group for name, group in groups.items() if group}


def optimality_bin(rate: float) -> str:
    """The bin of the paper's histogram."""
    limits = (1, 1.25, 1.5, float("inf"))
    return next(name for name, limit in zip(OPTIMALITY_BINS, limits, strict=True) if rate <= limit)


def optimality_histogram(rows: Sequence[EpisodeRow]) -> Picture | None:
    """Optimality rates of successes (paper, figure "histogram_optimality")."""

    def bins(group: list[EpisodeRow]) -> list[str]:
        rates = (optimality_rate(row) for row in group)
        return [optimality_bin(rate) for rate in rates if rate is not None]

    def draw(axes: Axes, group: list[EpisodeRow]) -> None:
        _histogram(axes, group, bins, OPTIMALITY_BINS, published.OPTIMALITY)
        axes.set_xlabel("steps / fewest steps")
        axes.set_ylabel("% of successes")

    caption = (
        "Optimality rate of successes by data set. Ticks across a bar are the published numbers of "
        "gpt-4o with ReAct, as far as the paper gives them."
    )
    groups = _chosen(rows, lambda row: optimality_rate(row) is not None)
    return _panels("optimality", caption, groups, draw)


def steps_to_go_histogram(rows: Sequence[EpisodeRow]) -> Picture | None:
    """Normalised steps to go of failures (paper, figure "histogram_steps_to_go")."""

    def bins(group: list[EpisodeRow]) -> list[str]:
        found = (bin_of_steps_to_go(row.measures) for row in group)
        return [each for each in found if each is not None]

    def draw(axes: Axes, group: list[EpisodeRow]) -> None:
        _histogram(axes, group, bins, STEPS_TO_GO_BINS, published.STEPS_TO_GO)
        axes.set_xlabel("steps to go / fewest steps")
        axes.set_ylabel("% of failures")

    caption = (
        "How far failures ended from the goal. Up to 0.5 is progress, 0.5 to 1 little or none, "
        "more than 1 farther away than at first. Ticks across a bar are published numbers."
    )
    groups = _chosen(
        rows, lambda row: not succeeded(row) and bin_of_steps_to_go(row.measures) is not None
    )
    return _panels("steps_to_go", caption, groups, draw)


def _histogram(
    axes: Axes,
    group: list[EpisodeRow],
    bins: Callable[[list[EpisodeRow]], list[str]],
    names: Sequence[str],
    theirs: Mapping[str, Mapping[str, float]],
) -> None:
    """Shares of each bin, a bar a data set; published ones as ticks."""
    sets = datasets(group)
    width = 0.8 / len(sets)
    for i, (dataset, episodes) in enumerate(sets.items()):
        counts = Counter(bins(episodes))
        total = max(1, counts.total())
        places = [j - 0.4 + width * (i + 0.5) for j in range(len(names))]
        shares = [100 * counts[name] / total for name in names]
        label = f"{_set_label(dataset)} ({counts.total()})"
        axes.bar(places, shares, width * 0.9, color=_set_colour(dataset), label=label)
        for place, name in zip(places, names, strict=True):
            value = theirs.get(dataset, {}).get(name)
            if value is not None:
                ends = [place - width / 2, place + width / 2]
                axes.plot(ends, [value, value], color=INK, linewidth=1.6)
    axes.set_xticks(range(len(names)), [name.replace("more than", ">") for name in names])
    axes.tick_params(axis="x", labelsize=8, length=0)
    axes.set_ylim(0, 140)
    axes.set_yticks([0, 25, 50, 75, 100])
    axes.legend(loc="upper right", borderaxespad=0, fontsize=7.5, handlelength=1)


def _set_label(dataset: str) -> str:
    return plain(dataset.replace("_", "-"), 20)


def _set_colour(dataset: str) -> str:
    known = ("synchronous", "asynchronous", "multi_agent")
    return COLOURS[known.index(dataset)] if dataset in known else COLOURS[4]


def repeated_transitions(rows: Sequence[EpisodeRow]) -> Picture | None:
    """Repeated transitions of successes and failures (paper, "histogram_repeated_transitions")."""

    def draw(axes: Axes, group: list[EpisodeRow]) -> None:
        labels, values, colours = [], [], []
        for dataset, episodes in datasets(group).items():
            for word, won in (("won", True), ("lost", False)):
                found = [row.repetitions for row in episodes if succeeded(row) == won]
                if found:
                    labels.append(f"{_SHORT.get(dataset, plain(dataset, 8))}\n{word}")
                    values.append(found)
                    colours.append(_set_colour(dataset))
        boxes = axes.boxplot(values, tick_labels=labels, patch_artist=True, widths=0.6,
                             medianprops={"color": INK, "linewidth": 1.6},
                             whiskerprops={"color": SOFT}, capprops={"color": SOFT},
                             flierprops={"markersize": 3, "markeredgecolor": SOFT})  # fmt: skip
        for box, colour in zip(boxes["boxes"], colours, strict=True):
            box.set(facecolor=colour, edgecolor=colour, alpha=0.75)
        axes.tick_params(axis="x", labelsize=7.5, length=0)
        axes.set_ylim(-0.5, max(4, 1.05 * max(map(max, values))))
        axes.set_ylabel("repeated transitions")

    caption = (
        "Steps of an episode that repeat an earlier one. Boxes span the quartiles and have a line "
        "at the median; whiskers reach 1.5 times as far as the box is high."
    )
    return _panels("repeated_transitions", caption, named(rows), draw)


_SHORT = {"synchronous": "sync", "asynchronous": "async", "multi_agent": "team"}


def failure_pies(rows: Sequence[EpisodeRow]) -> Picture | None:
    """Failures by category and subcategory, nested (paper, figure "piechart_taxonomy")."""
    groups: dict[str, list[EpisodeRow]] = {}
    for name, group in named(rows).items():
        for dataset, episodes in datasets(group).items():
            if lost := [row for row in episodes if row.measures.failure]:
                short = _SHORT.get(dataset, plain(dataset, 8))
                groups[f"{name} · {short} ({len(lost)})"] = lost
    caption = (
        "Why episodes failed: state, action, transition function or goal outside, what about it "
        "inside, as the classifier tells it."
    )
    return _panels("failures", caption, groups, _pie)


def _pie(axes: Axes, group: list[EpisodeRow]) -> None:
    kinds = Counter(
        (failure.category, failure.subcategory)
        for row in group
        if (failure := row.measures.failure)
    )
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
    labels = [f"{plain(name, 24)} {100 * count / total:.0f} %" for count, name, _ in shown]
    axes.legend([w for *_, w in shown], labels, loc="upper center", bbox_to_anchor=(0.5, 0),
                fontsize=7, ncols=2, handlelength=1, columnspacing=1)  # fmt: skip
    axes.grid(visible=False)
