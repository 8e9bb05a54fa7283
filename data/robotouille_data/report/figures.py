"""Figures of a report: outcomes, activities, inactive shares, decision times and rounds."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robotouille.html_report.figures import (
    COLOURS,
    INK,
    MARKERS,
    ReportFigure,
    draw_figure,
    label_rows,
    legend_above,
)
from robotouille.html_report.intervals import Interval, median_interval, wilson_interval
from robotouille_data.recorded_seats import ACTIVITIES
from robotouille_data.report.facts import EpisodeFacts, Group, SeatFacts

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ACTIVITY_COLOURS = {
    "acted": "#1a80c4",
    "busy": "#8fcdf2",
    "waiting": "#d55e00",
    "idle": "#f4d58d",
    "away": "#94a3b8",
    "substituted": "#b9629b",
}
MAX_POINTS = 200
"""Points drawn for each row of a figure. If there are more, a random sample is drawn."""
MAX_ROUNDS = 40
WIDTH, ROW_HEIGHT = 10.6, 0.58
"""Sizes in inches."""


@dataclass(frozen=True, slots=True)
class Values:
    """Row of a figure: its label, its colour, and its values with their clusters."""

    label: str
    colour: str
    values: list[float]
    clusters: list[str]


def all_figures(groups: Sequence[Group]) -> dict[str, ReportFigure]:
    """Return every figure for which there is data, by name."""
    found = {
        "outcomes": _outcomes(groups),
        "activities": _activities(groups),
        "idle": _idle(groups),
        "decisions": _decisions(groups),
        "rounds": _rounds(groups),
    }
    return {name: figure for name, figure in found.items() if figure is not None}


# Outcomes


def _outcomes(groups: Sequence[Group]) -> ReportFigure | None:
    if not any(success_rate(group.episodes) for group in groups):
        return None

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(
            1, 2, sharey=True, width_ratios=(1, 1.25), gridspec_kw={"wspace": 0.08}
        )
        for place, group in enumerate(groups):
            found = success_rate(group.episodes)
            if found is not None:
                _interval(left, place, found, COLOURS[place], scale=100)
        left.set_xlim(-4, 104)
        left.set_xlabel("goal reached, % of episodes")
        names = [group.name for group in groups]
        rows = [
            Values(group.name, COLOURS[place], *_steps_of_successes(group.episodes))
            for place, group in enumerate(groups)
        ]
        _points(right, rows)
        right.set_xlabel("steps of successful episodes")
        right.set_xlim(left=0)
        label_rows(left, names)
        right.tick_params(axis="y", length=0)

    caption = (
        "Left: share of finished episodes that reached the goal, with Wilson's 95 % interval. "
        "Right: steps of these episodes. Dots are episodes, boxes span the quartiles, diamonds are "
        "medians with 95 % bootstrap intervals."
    )
    height = 0.9 + ROW_HEIGHT * len(groups)
    return draw_figure("outcomes", caption, (WIDTH, height), draw, png=False)


def success_rate(episodes: Sequence[EpisodeFacts]) -> Interval | None:
    """Return the share of finished episodes that reached the goal."""
    known = [each.success for each in episodes if each.success is not None]
    return wilson_interval(sum(known), len(known))


def _steps_of_successes(episodes: Sequence[EpisodeFacts]) -> tuple[list[float], list[str]]:
    won = [each for each in episodes if each.success]
    return [float(each.steps) for each in won], [each.cluster for each in won]


def median_steps(episodes: Sequence[EpisodeFacts]) -> Interval | None:
    """Return the median number of steps of the episodes that reached the goal."""
    return median_interval(*_steps_of_successes(episodes))


# Activities


def _labelled_roles(groups: Sequence[Group]) -> Iterator[tuple[str, str, list[SeatFacts]]]:
    """Yield a label, the group's colour and the seats of each role.

    The label includes the kind of participant if there are several kinds.
    """
    several = len({role.kind for group in groups for role in group.roles()}) > 1
    for place, group in enumerate(groups):
        for role in group.roles():
            about = ", ".join(filter(None, [role.player, role.kind if several else ""]))
            yield f"{group.name}: {about}" if about else group.name, COLOURS[place], role.seats


def _activities(groups: Sequence[Group]) -> ReportFigure | None:
    rows = [(label, seats) for label, _, seats in _labelled_roles(groups)]
    sums = [np.sum([seat.activities for seat in seats], axis=0) for _, seats in rows]
    if not any(each.sum() for each in sums):
        return None

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        for place, counts in enumerate(sums):
            left = 0.0
            for name, count in zip(ACTIVITIES, counts, strict=True):
                share = 100 * count / max(1, counts.sum())
                axes.barh(place, share, left=left, height=0.62, color=ACTIVITY_COLOURS[name],
                          edgecolor="white", linewidth=0.8)  # fmt: skip
                left += share
        axes.set_xlim(0, 100)
        axes.set_xlabel("% of steps")
        label_rows(axes, [label for label, _ in rows])
        legend_above(axes, 6, activity_handles())

    caption = (
        "Activities of the seats; each step of a seat has one. Busy: walking or working. Waiting: "
        "after a rejected action, or during another player's turn. Idle: able to act but without "
        "an action."
    )
    height = 1.15 + 0.4 * len(rows)
    return draw_figure("activities", caption, (WIDTH, height), draw, png=False)


def activity_handles() -> list[object]:
    """Return a legend entry for each activity."""
    from matplotlib.patches import Patch

    return [Patch(color=colour, label=name) for name, colour in ACTIVITY_COLOURS.items()]


# Values of seats


def _idle(groups: Sequence[Group]) -> ReportFigure | None:
    caption = (
        "Inactive share of the steps in which a seat's participant had control, with a row for "
        "each role. Dots are seats of episodes, boxes span the quartiles, diamonds are medians "
        "with 95 % bootstrap intervals."
    )
    label = "inactive, % of the participant's steps"
    return _of_seats("idle", groups, lambda seat: _percent(seat.inactive_share), label, caption)


def _decisions(groups: Sequence[Group]) -> ReportFigure | None:
    caption = (
        "Decision time: from the moment a seat may act to its action, averaged over the seat's "
        "applied actions. Dots, boxes and diamonds as above."
    )
    return _of_seats("decisions", groups, lambda s: s.decision_ms, "decision time, ms", caption)


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _of_seats(
    name: str,
    groups: Sequence[Group],
    value: Callable[[SeatFacts], float | None],
    label: str,
    caption: str,
) -> ReportFigure | None:
    rows = [
        Values(title, colour, *_values_of_seats(seats, value))
        for title, colour, seats in _labelled_roles(groups)
    ]
    rows = [row for row in rows if row.values]
    if not rows:
        return None

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        _points(axes, rows)
        axes.set_xlabel(label)
        axes.set_xlim(left=0)
        axes.xaxis.set_major_formatter(lambda x, _: f"{x:,g}")
        label_rows(axes, [row.label for row in rows])

    height = 0.85 + ROW_HEIGHT * len(rows)
    return draw_figure(name, caption, (WIDTH, height), draw, png=False)


def _values_of_seats(
    seats: Sequence[SeatFacts], value: Callable[[SeatFacts], float | None]
) -> tuple[list[float], list[str]]:
    known = [(found, seat.episode.cluster) for seat in seats if (found := value(seat)) is not None]
    return [found for found, _ in known], [cluster for _, cluster in known]


def median_of_seats(
    seats: Sequence[SeatFacts], value: Callable[[SeatFacts], float | None]
) -> Interval | None:
    """Return the median of a value over seats. Seats without the value are ignored."""
    return median_interval(*_values_of_seats(seats, value))


# Rounds


def by_round(group: Group) -> dict[int, list[EpisodeFacts]]:
    """Return the episodes of a group by the number in their label `round`."""
    found: dict[int, list[EpisodeFacts]] = {}
    for episode in group.episodes:
        if re.fullmatch(r"[0-9]{1,6}", episode.round or ""):
            found.setdefault(int(episode.round or ""), []).append(episode)
    return dict(sorted(found.items())[:MAX_ROUNDS])


def _rounds(groups: Sequence[Group]) -> ReportFigure | None:
    rounds = [by_round(group) for group in groups]
    numbers = sorted({number for own in rounds for number in own})
    if len(numbers) < 2:
        return None

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        for place, (group, own) in enumerate(zip(groups, rounds, strict=True)):
            steps = {number: median_steps(some) for number, some in own.items()}
            rates = {number: success_rate(some) for number, some in own.items()}
            _round_line(left, place, group, steps, 1)
            _round_line(right, place, group, rates, 100)
        left.set_ylabel("steps to the goal, median")
        left.set_ylim(0, 1.08 * max(left.dataLim.y1, 1))
        right.set_ylabel("goal reached, %")
        right.set_ylim(-4, 104)
        for axes in (left, right):
            axes.set_xlabel("round")
            axes.set_xticks(numbers if len(numbers) <= 12 else numbers[:: len(numbers) // 8])
            axes.margins(x=0.1)
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=4)

    caption = (
        "Learning. Left: steps of the episodes that reached the goal. Right: share of episodes "
        "that reached it. Bars are 95 % intervals. The points of a round are drawn next to each "
        "other so that they do not overlap."
    )
    return draw_figure("rounds", caption, (WIDTH, 3.4), draw, png=False)


def _round_line(
    axes: Axes, place: int, group: Group, found: Mapping[int, Interval | None], scale: float
) -> None:
    known = [(number, each) for number, each in found.items() if each is not None]
    colour, aside = COLOURS[place], 0.06 * (place % 2 * 2 - 1) * ((place + 1) // 2)
    at = [number + aside for number, _ in known]
    middles = [scale * each.estimate for _, each in known]
    axes.plot(at, middles, color=colour, linewidth=1.4, marker=MARKERS[place], label=group.name)
    for x, (_, each) in zip(at, known, strict=True):
        if each.low is not None and each.high is not None:
            axes.plot([x, x], [scale * each.low, scale * each.high], color=colour, linewidth=1)


# Points with a box and an interval


def _points(axes: Axes, rows: Sequence[Values]) -> None:
    """Draw the values of each row as dots, with their quartiles and median."""
    for place, row in enumerate(rows):
        if not row.values:
            continue
        generator = np.random.default_rng(place)
        shown = np.array(row.values)
        if len(shown) > MAX_POINTS:
            shown = generator.choice(shown, MAX_POINTS, replace=False)
        heights = place + 0.2 + generator.uniform(-0.12, 0.12, len(shown))
        axes.scatter(shown, heights, s=14, color=row.colour, alpha=0.75, linewidths=0)
        low, high = np.quantile(row.values, (0.25, 0.75))
        axes.barh(place - 0.16, high - low, left=low, height=0.26, color=row.colour, alpha=0.35)
        found = median_interval(row.values, row.clusters)
        if found is not None:
            _interval(axes, place - 0.16, found, row.colour)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.grid(visible=True, axis="x")


def _interval(axes: Axes, place: float, found: Interval, colour: str, scale: float = 1) -> None:
    if found.low is not None and found.high is not None:
        ends = [scale * found.low, scale * found.high]
        axes.plot(ends, [place, place], color=INK, linewidth=1.3, marker="|", markersize=7)
    axes.plot([scale * found.estimate], [place], marker="D", markersize=6, color=colour,
              markeredgecolor=INK, markeredgewidth=0.9)  # fmt: skip
