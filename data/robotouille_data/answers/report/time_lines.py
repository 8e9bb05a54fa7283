"""Time lines: what each seat of an episode did, step by step, and what was said."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from robotouille_client.console.pages.drawing import INK, Picture, drawn, plain
from robotouille_data.answers.report.facts import Episode
from robotouille_data.answers.report.figures import ACTIVITY_COLOURS, WIDTH
from robotouille_data.answers.report.grouping import Group
from robotouille_data.database import in_pieces
from robotouille_data.schema import EVENTS, STEPS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["MAX_SHOWN", "MAX_STEPS", "Said", "TimeLine", "draw_time_lines", "read_time_lines"]

MAX_SHOWN = 12
"""Episodes of a group whose time lines are drawn."""
MAX_STEPS = 3000
"""Steps of the longest that is drawn."""
MAX_SAID = 100
"""Messages of an episode that are shown."""
LANE, GAP = 0.19, 0.12
"""Inches: the height of a seat's lane, and what is between two episodes."""


@dataclass(frozen=True, slots=True)
class Said:
    """A chat message: after which step, when in milliseconds, by which seat (None: a spectator),
    and what."""

    step: int
    t: int
    seat: int | None
    name: str
    text: str


@dataclass(slots=True)
class TimeLine:
    """What happened in an episode: of each seat, its activities from the first step on, and the
    steps in which it was refused; the first messages of the chat, and how many there are."""

    episode: Episode
    lanes: dict[int, list[str]] = field(default_factory=dict)
    rejected: list[tuple[int, int]] = field(default_factory=list)
    said: list[Said] = field(default_factory=list)
    messages: int = 0


def read_time_lines(connection: Connection, group: Group) -> list[TimeLine]:
    """Time lines of the first episodes of a group that are not too long, of each pair in turn."""
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
                time_line.said.append(Said(step, t, seat, name, text))
    return list(time_lines.values())


def _in_turn(episodes: Sequence[Episode]) -> Iterator[Episode]:
    """Each pair's first, then each pair's second, and so on."""
    pairs: dict[str, list[Episode]] = {}
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


def draw_time_lines(name: str, time_lines: Sequence[TimeLine], longest: int) -> Picture:
    """Of each episode, a lane for each seat, coloured by what it did.

    Args:
        longest: Steps for which there is room, so that several pictures have one scale.
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
        "A lane for each seat, the first one above. A tick over a lane is something that was asked "
        "for and refused, a dot something that was said; behind the lanes stands how it ended."
    )
    return drawn(name, caption, (WIDTH, height + 1.0), draw, png=False)


def _title(episode: Episode) -> str:
    if episode.pair is None:
        return plain(episode.name, 26)
    number = f", {episode.round}" if episode.round is not None else ""
    return plain(f"{episode.pair}{number}", 26)


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
    refused = [(min(step, steps - 1), heights[seat]) for step, seat in time_line.rejected]
    axes.vlines(
        [step + 0.5 for step, _ in refused],
        [height + 0.04 * LANE for _, height in refused],
        [height + 0.27 * LANE for _, height in refused],
        color=INK, linewidth=0.9,
    )  # fmt: skip
    said = [(each.step, heights[each.seat]) for each in time_line.said if each.seat in heights]
    axes.scatter([s for s, _ in said], [h + 0.15 * LANE for _, h in said], s=8, color=INK, zorder=3)
    won = {True: "goal", False: "no goal", None: "unfinished"}[time_line.episode.success]
    middle = top + LANE * len(order) / 2
    axes.text(steps + 0.008 * longest, middle, won, fontsize=8.5, va="center")


def _spans(lane: Sequence[str], activity: str) -> Iterator[tuple[int, int]]:
    """From which to which step it went on."""
    at = 0
    for did, same in groupby(lane):
        length = sum(1 for _ in same)
        if did == activity:
            yield at, at + length
        at += length


def _fill(axes: Axes, rectangles: Sequence[tuple[int, int, float]], colour: str) -> None:
    """All of a colour as one path: a page has thousands."""
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
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Patch(color=colour, label=name) for name, colour in ACTIVITY_COLOURS.items()
    ]
    marks: Any = {"linestyle": "", "color": INK}
    handles.append(Line2D([], [], marker="|", markersize=8, label="refused", **marks))
    handles.append(Line2D([], [], marker="o", markersize=3.5, label="said", **marks))
    axes.legend(handles=handles, loc="lower left", bbox_to_anchor=(0, 1), ncols=8, borderaxespad=0,
                handlelength=1, handleheight=1, columnspacing=1.2)  # fmt: skip
