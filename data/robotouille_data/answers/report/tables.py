"""The tables of a report: the numbers that its figures show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter

from robotouille_data.answers.report.facts import Facts, Seat
from robotouille_data.answers.report.figures import (
    by_round,
    median_of_seats,
    median_of_steps,
    success_of,
)
from robotouille_data.answers.report.grouping import Group, Groups
from robotouille_data.answers.report.intervals import Interval, median_interval
from robotouille_data.recordings.seat import ACTIVITIES

__all__ = [
    "Table",
    "activities_table",
    "episodes_table",
    "interruptions_table",
    "outcomes_table",
    "rounds_table",
    "spread_table",
]


@dataclass(frozen=True, slots=True)
class Table:
    """Columns and rows of text; the first column names the rows, `text` are other columns of
    words, all others hold numbers."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    text: frozenset[str] = frozenset()


def episodes_table(groups: Groups, by: str) -> Table:
    """How many there are of what."""
    rows = [
        (
            group.name,
            _count(len(group.episodes)),
            _count(len({each.cluster for each in group.episodes if each.pair is not None})),
            _count(sum(each.state != "ended" for each in group.episodes)),
            _count(sum(each.steps for each in group.episodes)),
            _minutes(sum(each.seconds for each in group.episodes)),
            _several({each.task for each in group.episodes}),
        )
        for group in groups.shown
    ]
    rows += [
        (f"{name} (not shown)", _count(count), "", "", "", "", "")
        for name, count in groups.left_out.items()
    ]
    columns = (by, "episodes", "pairs", "unfinished", "steps", "minutes", "tasks")
    return Table(columns, tuple(rows), frozenset({"tasks"}))


def outcomes_table(groups: Sequence[Group], by: str) -> Table:
    """How episodes ended."""
    reasons = sorted({each.reason for g in groups for each in g.episodes if each.reason})
    rows = []
    for group in groups:
        ended = Counter(each.reason for each in group.episodes)
        rates = [(e.optimality, e.cluster) for e in group.episodes if e.optimality is not None]
        optimality = median_interval([rate for rate, _ in rates], [own for _, own in rates])
        rows.append((
            group.name,
            _interval(success_of(group.episodes), _as_percent),
            _interval(median_of_steps(group.episodes), "{:,.0f}".format),
            _interval(optimality, "{:.2f}".format),
            *(_count(ended[reason]) for reason in reasons),
        ))  # fmt: skip
    named = (f"ended by {reason.replace('_', ' ')}" for reason in reasons)
    return Table((by, "goal reached, %", "steps to it", "optimality rate", *named), tuple(rows))


def activities_table(groups: Sequence[Group], by: str) -> Table:
    """What seats did with their steps, in per cent, and what each did on average."""
    rows = []
    for role, seats in _roles(groups):
        did = [sum(seat.steps(name) for seat in seats) for name in ACTIVITIES]
        shares = (f"{100 * count / max(1, sum(did)):.1f}" for count in did)
        means = (_mean(seats, attrgetter(name)) for name in ("rejected", "lost", "said"))
        rows.append((*role, _count(len(seats)), *shares, *means))
    columns = (by, "player", "played by", "seats", *(f"{name}, %" for name in ACTIVITIES),
               "refused per seat", "lost per seat", "said per seat")  # fmt: skip
    return Table(columns, tuple(rows), frozenset({"player", "played by"}))


def spread_table(groups: Sequence[Group], by: str) -> Table:
    """Idle share, decision time and contribution: medians over seats."""
    rows = [
        (
            *role,
            _count(len(seats)),
            _interval(median_of_seats(seats, lambda seat: seat.idle_share), _as_percent),
            _interval(median_of_seats(seats, lambda seat: seat.decision_ms), "{:,.0f}".format),
        )
        for role, seats in _roles(groups)
    ]
    columns = (by, "player", "played by", "seats", "idle, %", "time to decide, ms")
    return Table(columns, tuple(rows), frozenset({"player", "played by"}))


def rounds_table(groups: Sequence[Group], by: str) -> Table:
    """Success and steps of each round."""
    rows = [
        (
            group.name,
            str(number),
            _count(len(episodes)),
            _interval(success_of(episodes), _as_percent),
            _interval(median_of_steps(episodes), "{:,.0f}".format),
        )
        for group in groups
        for number, episodes in by_round(group).items()
    ]
    return Table((by, "round", "episodes", "goal reached, %", "steps to it"), tuple(rows))


def interruptions_table(groups: Sequence[Group], facts: Facts, by: str) -> Table:
    """Who was away how often, and what stood still."""
    rows = []
    for group in groups:
        found = [facts.interruptions.get(each.id, Counter[str]()) for each in group.episodes]
        sums = sum(found, Counter[str]())
        away = sum(seat.steps("away") for seat in group.seats)
        stood_in = sum(seat.steps("substituted") for seat in group.seats)
        affected = sum(each["absences"] > 0 for each in found)
        rows.append((
            group.name, _count(len(group.episodes)), _count(affected), _count(sums["absences"]),
            _count(away), _count(stood_in), _count(sums["paused"]), _count(sums["restarted"]),
        ))  # fmt: skip
    columns = (by, "episodes", "with an absence", "absences", "steps away", "steps with a stand-in",
               "pauses", "restarts of the server")  # fmt: skip
    return Table(columns, tuple(rows))


def _roles(groups: Sequence[Group]) -> Iterator[tuple[tuple[str, str, str], list[Seat]]]:
    """What each row begins with, and the seats that it is about."""
    for group in groups:
        for role in group.roles():
            yield (group.name, role.player or "all", role.kind), role.seats


def _interval(found: Interval | None, write: Callable[[float], str]) -> str:
    if found is None:
        return "–"
    if found.low is None or found.high is None:
        return write(found.middle)
    return f"{write(found.middle)} ({write(found.low)} to {write(found.high)})"


def _as_percent(share: float) -> str:
    return f"{100 * share:.0f}"


def _count(number: int) -> str:
    return f"{number:,}"


def _minutes(seconds: float) -> str:
    return f"{seconds / 60:,.0f}"


def _mean(seats: Sequence[Seat], value: Callable[[Seat], int]) -> str:
    return f"{sum(map(value, seats)) / len(seats):.1f}" if seats else "–"


def _several(names: set[str], most: int = 2) -> str:
    ordered = sorted(names)
    more = f" and {len(ordered) - most} more" if len(ordered) > most else ""
    return ", ".join(ordered[:most]) + more
