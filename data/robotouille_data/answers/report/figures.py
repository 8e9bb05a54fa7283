"""The figures of a report: outcomes, what seats did, how that is spread, and rounds."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robotouille_client.console.pages.drawing import INK, Picture, drawn
from robotouille_data.answers.report.facts import Episode, Seat
from robotouille_data.answers.report.grouping import Group
from robotouille_data.answers.report.intervals import Interval, median_interval, share_interval
from robotouille_data.recordings.seat import ACTIVITIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "ACTIVITY_COLOURS",
    "WIDTH",
    "all_figures",
    "by_round",
    "median_of_seats",
    "median_of_steps",
    "success_of",
]

ACTIVITY_COLOURS = {
    "acted": "#1a80c4",
    "busy": "#8fcdf2",
    "waiting": "#d55e00",
    "idle": "#f4d58d",
    "away": "#94a3b8",
    "substituted": "#b9629b",
}
"""After Okabe and Ito (2008), so that they are told apart with any sight of colours."""
GROUP_COLOURS = (
    "#1a80c4", "#d55e00", "#009e73", "#b9629b", "#b08800", "#3a9bd1", "#64748b", "#8c5a2b"
)  # fmt: skip
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
MAX_POINTS = 200
"""Points of a line that are drawn: of more, so many by lot."""
MAX_ROUNDS = 40
WIDTH = 10.6
LINE = 0.58
"""Inches that a line of a figure takes."""


class Line(NamedTuple):
    """A line of a figure: its label, colour, values, and what each value belongs to."""

    label: str
    colour: str
    values: list[float]
    clusters: list[str]


def all_figures(groups: Sequence[Group]) -> dict[str, Picture]:
    """Every figure for which there is something, by name."""
    found = {
        "outcomes": _outcomes(groups),
        "activities": _activities(groups),
        "idle": _idle(groups),
        "decisions": _decisions(groups),
        "rounds": _rounds(groups),
    }
    return {name: picture for name, picture in found.items() if picture is not None}


# Outcomes


def _outcomes(groups: Sequence[Group]) -> Picture | None:
    """How often the goal was reached, and in how many steps."""
    if not any(group.episodes for group in groups):
        return None

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(
            1, 2, sharey=True, width_ratios=(1, 1.25), gridspec_kw={"wspace": 0.08}
        )
        for place, group in enumerate(groups):
            found = success_of(group.episodes)
            if found is not None:
                _interval(left, place, found, GROUP_COLOURS[place], scale=100)
        left.set_xlim(-4, 104)
        left.set_xlabel("goal reached, % of episodes")
        lines = [
            Line(group.name, GROUP_COLOURS[place], *_steps_of_successes(group.episodes))
            for place, group in enumerate(groups)
        ]
        _spread(right, lines)
        right.set_xlabel("steps of those that reached it")
        right.set_xlim(left=0)
        _name_lines(left, [group.name for group in groups])
        right.tick_params(axis="y", length=0)

    caption = (
        "Left: the share of ended episodes that reached the goal, with Wilson's 95 % interval. "
        "Right: how many steps those took. Dots are episodes, boxes hold the middle half, diamonds "
        "are medians with 95 % bootstrap intervals."
    )
    return drawn("outcomes", caption, (WIDTH, 0.9 + LINE * len(groups)), draw, png=False)


def success_of(episodes: Sequence[Episode]) -> Interval | None:
    """The share of ended episodes that reached the goal."""
    known = [each.success for each in episodes if each.success is not None]
    return share_interval(sum(known), len(known))


def _steps_of_successes(episodes: Sequence[Episode]) -> tuple[list[float], list[str]]:
    won = [each for each in episodes if each.success]
    return [float(each.steps) for each in won], [each.cluster for each in won]


def median_of_steps(episodes: Sequence[Episode]) -> Interval | None:
    """Steps of the episodes that reached the goal."""
    return median_interval(*_steps_of_successes(episodes))


# What seats did


def _roles(groups: Sequence[Group]) -> Iterator[tuple[str, str, list[Seat]]]:
    """The seats of each group and role, with a label and the group's colour; the kind is said where
    there are several."""
    several = len({role.kind for group in groups for role in group.roles()}) > 1
    for place, group in enumerate(groups):
        for role in group.roles():
            words = [role.player, role.kind if several else ""]
            about = ", ".join(filter(None, words))
            label = f"{group.name}: {about}" if about else group.name
            yield label, GROUP_COLOURS[place], role.seats


def _activities(groups: Sequence[Group]) -> Picture | None:
    """The shares of the six activities, of all steps of all seats."""
    lines = [(label, seats) for label, _, seats in _roles(groups)]
    sums = [np.sum([seat.did for seat in seats], axis=0) for _, seats in lines]
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
        _name_lines(axes, [label for label, _ in lines])
        _activity_legend(axes)

    caption = (
        "What seats did with their steps; each step is one of these. Busy is walking or working, "
        "waiting is a wish that was refused, or another's turn; idle is nothing where something "
        "could have been done."
    )
    return drawn("activities", caption, (WIDTH, 1.15 + 0.4 * len(lines)), draw, png=False)


def _activity_legend(axes: Axes) -> None:
    from matplotlib.patches import Patch

    patches = [Patch(color=colour, label=name) for name, colour in ACTIVITY_COLOURS.items()]
    axes.legend(handles=patches, loc="lower left", bbox_to_anchor=(0, 1), ncols=6, borderaxespad=0,
                handlelength=1, handleheight=1, columnspacing=1.4)  # fmt: skip


# Spread over seats


def _idle(groups: Sequence[Group]) -> Picture | None:
    caption = (
        "How much of the time in which it could be controlled by its participant each seat was "
        "idle, each role on a line of its own. Dots are seats of episodes, boxes hold the middle "
        "half, diamonds are medians with 95 % bootstrap intervals."
    )
    label = "idle, % of the steps with its participant"
    return _of_seats("idle", groups, lambda seat: _percent(seat.idle_share), label, caption)


def _decisions(groups: Sequence[Group]) -> Picture | None:
    caption = (
        "How long each seat took to decide: from when it could act to its action, on average over "
        "its actions that were applied. Dots, boxes and diamonds as above."
    )
    return _of_seats(
        "decisions", groups, lambda seat: seat.decision_ms, "time to decide, ms", caption
    )


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _of_seats(
    name: str,
    groups: Sequence[Group],
    value: Callable[[Seat], float | None],
    label: str,
    caption: str,
) -> Picture | None:
    lines = [
        Line(title, colour, *_values_of_seats(seats, value))
        for title, colour, seats in _roles(groups)
    ]
    lines = [line for line in lines if line.values]
    if not lines:
        return None

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        _spread(axes, lines)
        axes.set_xlabel(label)
        axes.set_xlim(left=0)
        axes.xaxis.set_major_formatter(lambda x, _: f"{x:,g}")
        _name_lines(axes, [line.label for line in lines])

    return drawn(name, caption, (WIDTH, 0.85 + LINE * len(lines)), draw, png=False)


def _values_of_seats(
    seats: Sequence[Seat], value: Callable[[Seat], float | None]
) -> tuple[list[float], list[str]]:
    known = [(found, seat.episode.cluster) for seat in seats if (found := value(seat)) is not None]
    return [found for found, _ in known], [cluster for _, cluster in known]


def median_of_seats(
    seats: Sequence[Seat], value: Callable[[Seat], float | None]
) -> Interval | None:
    """The median over seats of what is known of each."""
    return median_interval(*_values_of_seats(seats, value))


# Rounds


def by_round(group: Group) -> dict[int, list[Episode]]:
    """A group's episodes by the number that their label `round` is."""
    found: dict[int, list[Episode]] = {}
    for episode in group.episodes:
        if re.fullmatch(r"[0-9]{1,6}", episode.round or ""):
            found.setdefault(int(episode.round or ""), []).append(episode)
    return dict(sorted(found.items())[:MAX_ROUNDS])


def _rounds(groups: Sequence[Group]) -> Picture | None:
    """Success and steps over rounds; None where nobody has played two."""
    rounds = [by_round(group) for group in groups]
    numbers = sorted({number for own in rounds for number in own})
    if len(numbers) < 2:
        return None

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        for place, (group, own) in enumerate(zip(groups, rounds, strict=True)):
            _line_of_rounds(
                left, place, group, {n: median_of_steps(some) for n, some in own.items()}, 1
            )
            _line_of_rounds(
                right, place, group, {n: success_of(some) for n, some in own.items()}, 100
            )
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
        "Learning: left, how many steps those took who reached the goal; right, how many reached "
        "it. Bars are 95 % intervals; points of one round stand side by side to be told apart."
    )
    return drawn("rounds", caption, (WIDTH, 3.4), draw, png=False)


def _line_of_rounds(
    axes: Axes, place: int, group: Group, found: Mapping[int, Interval | None], scale: float
) -> None:
    known = [(number, each) for number, each in found.items() if each is not None]
    colour, aside = GROUP_COLOURS[place], 0.06 * (place % 2 * 2 - 1) * ((place + 1) // 2)
    at = [number + aside for number, _ in known]
    middles = [scale * each.middle for _, each in known]
    axes.plot(at, middles, color=colour, linewidth=1.4, marker=MARKERS[place], label=group.name)
    for x, (_, each) in zip(at, known, strict=True):
        if each.low is not None and each.high is not None:
            axes.plot([x, x], [scale * each.low, scale * each.high], color=colour, linewidth=1)


# Lines of points


def _spread(axes: Axes, lines: Sequence[Line]) -> None:
    """Each line's values as dots, with a box, and the median with its interval."""
    for place, line in enumerate(lines):
        if not line.values:
            continue
        chance = np.random.default_rng(place)
        shown = np.array(line.values)
        if len(shown) > MAX_POINTS:
            shown = chance.choice(shown, MAX_POINTS, replace=False)
        heights = place + 0.2 + chance.uniform(-0.12, 0.12, len(shown))
        axes.scatter(shown, heights, s=14, color=line.colour, alpha=0.75, linewidths=0)
        low, high = np.quantile(line.values, (0.25, 0.75))
        axes.barh(place - 0.16, high - low, left=low, height=0.26, color=line.colour, alpha=0.35)
        found = median_interval(line.values, line.clusters)
        if found is not None:
            _interval(axes, place - 0.16, found, line.colour)
    _turn(axes, len(lines))


def _interval(axes: Axes, place: float, found: Interval, colour: str, scale: float = 1) -> None:
    if found.low is not None and found.high is not None:
        ends = [scale * found.low, scale * found.high]
        axes.plot(ends, [place, place], color=INK, linewidth=1.3, marker="|", markersize=7)
    axes.plot([scale * found.middle], [place], marker="D", markersize=6, color=colour,
              markeredgecolor=INK, markeredgewidth=0.9)  # fmt: skip


def _name_lines(axes: Axes, labels: Sequence[str]) -> None:
    axes.set_yticks(range(len(labels)), labels)
    axes.tick_params(axis="y", length=0)
    _turn(axes, len(labels))


def _turn(axes: Axes, count: int) -> None:
    """The first line above; values are read from below."""
    axes.set_ylim(count - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.grid(visible=True, axis="x")
