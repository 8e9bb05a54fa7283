"""Time lines: the activity of each seat step by step, and the chat."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille.html_report.figures import (
    INK,
    ReportFigure,
    draw_figure,
    legend_above,
    short_label,
)
from robotouille_data.database import in_pieces
from robotouille_data.report.facts import EpisodeFacts, Group
from robotouille_data.report.figures import ACTIVITY_COLOURS, WIDTH, activity_handles
from robotouille_data.schema import EVENTS, STEPS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_SHOWN = 12
"""Episodes of a group with a time line."""
MAX_STEPS = 3000
"""Steps of the longest episode with a time line."""
MAX_SAID = 100
"""Chat messages shown for each episode."""
LANE, GAP = 0.19, 0.12
"""Inches: the height of a seat's lane, and the gap between episodes."""


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """Chat message, with its step and time in milliseconds. A spectator's seat is None."""

    step: int
    t: int
    seat: int | None
    name: str
    text: str


@dataclass(slots=True)
class TimeLine:
    """Events of one episode.

    Attributes:
        lanes: The activities of each seat, from the first step on.
        rejected: Steps and seats of rejected actions.
        said: The first chat messages.
        messages: The number of chat messages.
    """

    episode: EpisodeFacts
    lanes: dict[int, list[str]] = field(default_factory=dict)
    rejected: list[tuple[int, int]] = field(default_factory=list)
    said: list[RecordedMessage] = field(default_factory=list)
    messages: int = 0


def read_time_lines(connection: Connection, group: Group) -> list[TimeLine]:
    """Read time lines of the first episodes of a group, taking the pairs in turn.

    Episodes of more than `MAX_STEPS` steps are skipped.
    """
    # Pairs in turn: the first twelve episodes of a study may all be of two pairs.
    chosen = [each for each in _in_turn(group.episodes) if 0 < each.steps <= MAX_STEPS]
    wanted = {each.id for each in chosen[:MAX_SHOWN]}
    time_lines = {each.id: TimeLine(each) for each in group.episodes if each.id in wanted}
    for some in in_pieces(time_lines):
        its = STEPS.c
        query = sa.select(its.episode_id, its.seat, its.activity).where(its.episode_id.in_(some))
        for number, seat, activity in connection.execute(
            query.order_by(its.episode_id, its.step, its.seat)
        ):
            time_lines[number].lanes.setdefault(seat, []).append(activity)
        for number, step, t, kind, seat, name, text in connection.execute(_events(some)):
            time_line = time_lines[number]
            if kind == "rejected":
                time_line.rejected.append((step, seat))
                continue
            time_line.messages += 1
            if time_line.messages <= MAX_SAID:
                time_line.said.append(RecordedMessage(step, t, seat, name, text))
    return list(time_lines.values())


def _in_turn(episodes: Sequence[EpisodeFacts]) -> Iterator[EpisodeFacts]:
    """Yield the first episode of each pair, then the second of each, and so on."""
    pairs: dict[str, list[EpisodeFacts]] = {}
    for each in episodes:
        pairs.setdefault(each.cluster, []).append(each)
    for place in range(max(map(len, pairs.values()), default=0)):
        for own in pairs.values():
            yield from own[place : place + 1]


def _events(some: Sequence[int]) -> sa.Select[Any]:
    its = EVENTS.c
    query = sa.select(its.episode_id, its.step, its.t, its.kind, its.seat, its.name, its.text)
    shown = (its.kind == "said") | ((its.kind == "rejected") & its.seat.is_not(None))
    return query.where(its.episode_id.in_(some) & shown).order_by(its.episode_id, its.number)


def draw_time_lines(name: str, time_lines: Sequence[TimeLine], longest: int) -> ReportFigure:
    """Draw a lane for each seat of each episode, coloured by activity.

    Args:
        longest: Steps that the axis has room for. Figures with the same value have one scale.
    """
    tops, height = [], 0.0
    for time_line in time_lines:
        tops.append(height)
        height += LANE * len(time_line.lanes) + GAP

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.set_ylim(height, -GAP / 2)
        axes.set_xlim(0, 1.01 * longest)
        axes.grid(visible=False)
        axes.set_xlabel("step")
        axes.spines["left"].set_visible(False)
        for top, time_line in zip(tops, time_lines, strict=True):
            _lanes(axes, top, time_line, longest)
        middles = [
            top + LANE * len(time_line.lanes) / 2
            for top, time_line in zip(tops, time_lines, strict=True)
        ]
        axes.set_yticks(middles, [_title(time_line.episode) for time_line in time_lines])
        axes.tick_params(axis="y", length=0)
        _legend(axes)

    caption = (
        "A lane for each seat, with the first seat at the top. A tick above a lane is a rejected "
        "action, a dot a chat message. The outcome is to the right of the lanes."
    )
    return draw_figure(name, caption, (WIDTH, height + 1.0), draw, png=False)


def _title(episode: EpisodeFacts) -> str:
    if episode.pair is None:
        return short_label(episode.name, 26)
    number = f", {episode.round}" if episode.round is not None else ""
    return short_label(f"{episode.pair}{number}", 26)


def _lanes(axes: Axes, top: float, time_line: TimeLine, longest: int) -> None:
    order = sorted(time_line.lanes)
    for activity, colour in ACTIVITY_COLOURS.items():
        rectangles = [
            (begin, end, top + LANE * place)
            for place, seat in enumerate(order)
            for begin, end in _spans(time_line.lanes[seat], activity)
        ]
        _fill(axes, rectangles, colour)
    steps = time_line.episode.steps
    heights = {seat: top + LANE * place for place, seat in enumerate(order)}
    rejected = [(min(step, steps - 1), heights[seat]) for step, seat in time_line.rejected]
    axes.vlines(
        [step + 0.5 for step, _ in rejected],
        [height + 0.04 * LANE for _, height in rejected],
        [height + 0.27 * LANE for _, height in rejected],
        color=INK, linewidth=0.9,
    )  # fmt: skip
    said = [(each.step, heights[each.seat]) for each in time_line.said if each.seat in heights]
    axes.scatter([s for s, _ in said], [h + 0.15 * LANE for _, h in said], s=8, color=INK, zorder=3)
    won = {True: "goal", False: "no goal", None: "unfinished"}[time_line.episode.success]
    middle = top + LANE * len(order) / 2
    axes.text(steps + 0.008 * longest, middle, won, fontsize=8.5, va="center")


def _spans(lane: Sequence[str], activity: str) -> Iterator[tuple[int, int]]:
    """Yield the first and last step of each stretch of an activity."""
    at = 0
    for did, same in groupby(lane):
        length = sum(1 for _ in same)
        if did == activity:
            yield at, at + length
        at += length


def _fill(axes: Axes, rectangles: Sequence[tuple[int, int, float]], colour: str) -> None:
    """Draw all rectangles as one path.

    A page has thousands of them, and a path element for each would make it several times larger.
    """
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    if not rectangles:
        return
    corners, codes = [], []
    for left, right, top in rectangles:
        low, high = top + 0.31 * LANE, top + 0.97 * LANE
        corners += [(left, low), (right, low), (right, high), (left, high), (left, low)]
        codes += [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY]
    axes.add_patch(PathPatch(Path(corners, codes), facecolor=colour, linewidth=0))


def _legend(axes: Axes) -> None:
    from matplotlib.lines import Line2D

    marks: Any = {"linestyle": "", "color": INK}
    rejected = Line2D([], [], marker="|", markersize=8, label="rejected", **marks)
    said = Line2D([], [], marker="o", markersize=3.5, label="message", **marks)
    legend_above(axes, 8, [*activity_handles(), rejected, said])
