"""Tables of a report, with the numbers that its figures show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from operator import attrgetter
from typing import TypeVar

from robotouille.html_report.intervals import Interval, median_interval
from robotouille.html_report.page import Table, TableRow
from robotouille_data.recorded_seats import ACTIVITIES
from robotouille_data.report.facts import Facts, Group, Groups, SeatFacts
from robotouille_data.report.figures import (
    by_round,
    median_of_seats,
    median_steps,
    success_rate,
)

Fact = TypeVar("Fact")
WORDS = frozenset({"tasks", "player", "played by"})


def _table(columns: Sequence[str], rows: Iterable[tuple[str, ...]]) -> Table:
    return Table(tuple(columns), [TableRow(row) for row in rows], words=WORDS)


def episodes_table(groups: Groups, by: str) -> Table:
    """Return the size of each group."""
    rows = [
        (
            group.name,
            f"{len(group.episodes):,}",
            f"{len({each.cluster for each in group.episodes if each.pair is not None}):,}",
            f"{sum(each.state != 'ended' for each in group.episodes):,}",
            f"{sum(each.steps for each in group.episodes):,}",
            f"{sum(each.seconds for each in group.episodes) / 60:,.0f}",
            _some({each.task for each in group.episodes}),
        )
        for group in groups.shown
    ]
    rows += [
        (f"{name} (not shown)", f"{count:,}", "", "", "", "", "")
        for name, count in groups.left_out.items()
    ]
    return _table((by, "episodes", "pairs", "unfinished", "steps", "minutes", "tasks"), rows)


def outcomes_table(groups: Sequence[Group], by: str) -> Table:
    """Return success, steps, optimality and the reasons for which episodes ended."""
    reasons = sorted({each.reason for g in groups for each in g.episodes if each.reason})
    rows = []
    for group in groups:
        ended = Counter(each.reason for each in group.episodes)
        rates = [(e.optimality, e.cluster) for e in group.episodes if e.optimality is not None]
        optimality = median_interval([rate for rate, _ in rates], [own for _, own in rates])
        rows.append((
            group.name,
            _interval(success_rate(group.episodes), _percent),
            _interval(median_steps(group.episodes), "{:,.0f}".format),
            _interval(optimality, "{:.2f}".format),
            *(f"{ended[reason]:,}" for reason in reasons),
        ))  # fmt: skip
    named = (f"ended by {reason.replace('_', ' ')}" for reason in reasons)
    return _table((by, "goal reached, %", "steps to the goal", "optimality rate", *named), rows)


def scores_table(groups: Sequence[Group], by: str) -> Table:
    """Return the points of finished shifts, and their served and expired orders."""
    rows = []
    for group in groups:
        found = [(e.score, e.cluster) for e in group.episodes if e.score is not None]
        scores, clusters = [score for score, _ in found], [own for _, own in found]
        shares = [(score.share, own) for score, own in found if score.share is not None]
        share = median_interval([each for each, _ in shares], [own for _, own in shares])
        rows.append((
            group.name,
            f"{len(scores):,}",
            _interval(median_interval([s.points for s in scores], clusters), "{:,.0f}".format),
            _interval(share, _percent),
            _mean(scores, attrgetter("served")),
            _mean(scores, attrgetter("expired")),
        ))  # fmt: skip
    columns = (by, "shifts", "points", "of the upper bound, %", "served per shift",
               "expired per shift")  # fmt: skip
    return _table(columns, rows)


def activities_table(groups: Sequence[Group], by: str) -> Table:
    """Return the share of each activity, and mean counts per seat."""
    rows = []
    for role, seats in _labelled_roles(groups):
        sums = [sum(seat.steps(name) for seat in seats) for name in ACTIVITIES]
        shares = (f"{100 * count / max(1, sum(sums)):.1f}" for count in sums)
        means = (_mean(seats, attrgetter(name)) for name in ("rejected", "lost", "said"))
        rows.append((*role, f"{len(seats):,}", *shares, *means))
    columns = (by, "player", "played by", "seats", *(f"{name}, %" for name in ACTIVITIES),
               "rejected per seat", "lost per seat", "messages per seat")  # fmt: skip
    return _table(columns, rows)


def spread_table(groups: Sequence[Group], by: str) -> Table:
    """Return medians over seats of the inactive and unused shares and the decision time."""
    rows = [
        (
            *role,
            f"{len(seats):,}",
            _interval(median_of_seats(seats, attrgetter("inactive_share")), _percent),
            _interval(median_of_seats(seats, attrgetter("unused_share")), _percent),
            _interval(median_of_seats(seats, attrgetter("decision_ms")), "{:,.0f}".format),
        )
        for role, seats in _labelled_roles(groups)
    ]
    columns = (by, "player", "played by", "seats", "inactive, %", "could act usefully, %",
               "decision time, ms")  # fmt: skip
    return _table(columns, rows)


def rounds_table(groups: Sequence[Group], by: str) -> Table:
    """Return success and steps of each round."""
    rows = [
        (
            group.name,
            str(number),
            f"{len(episodes):,}",
            _interval(success_rate(episodes), _percent),
            _interval(median_steps(episodes), "{:,.0f}".format),
        )
        for group in groups
        for number, episodes in by_round(group).items()
    ]
    return _table((by, "round", "episodes", "goal reached, %", "steps to the goal"), rows)


def interruptions_table(groups: Sequence[Group], facts: Facts, by: str) -> Table:
    """Return counts of absences, pauses and restarts."""
    rows = []
    for group in groups:
        found = [facts.interruptions.get(each.id, Counter[str]()) for each in group.episodes]
        sums = sum(found, Counter[str]())
        counts = (
            len(group.episodes),
            sum(each["absences"] > 0 for each in found),
            sums["absences"],
            sum(seat.steps("away") for seat in group.seats),
            sum(seat.steps("substituted") for seat in group.seats),
            sums["paused"],
            sums["restarted"],
        )
        rows.append((group.name, *(f"{count:,}" for count in counts)))
    columns = (by, "episodes", "with an absence", "absences", "steps away",
               "steps with a substitute", "pauses", "restarts of the server")  # fmt: skip
    return _table(columns, rows)


def _labelled_roles(
    groups: Sequence[Group],
) -> Iterator[tuple[tuple[str, str, str], list[SeatFacts]]]:
    """Yield the first three cells of each row, and the seats of the row."""
    for group in groups:
        for role in group.roles():
            yield (group.name, role.player or "all", role.kind), role.seats


def _interval(found: Interval | None, write: Callable[[float], str]) -> str:
    return "–" if found is None else found.text(write, write)


def _percent(share: float) -> str:
    return f"{100 * share:.0f}"


def _mean(facts: Sequence[Fact], value: Callable[[Fact], int]) -> str:
    return f"{sum(map(value, facts)) / len(facts):.1f}" if facts else "–"


def _some(names: set[str], most: int = 2) -> str:
    ordered = sorted(names)
    more = f" and {len(ordered) - most} more" if len(ordered) > most else ""
    return ", ".join(ordered[:most]) + more
