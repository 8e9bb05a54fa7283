"""Tables of teams and of episodes in real time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from robotouille.html_report.page import Table, TableRow
from robotouille_evaluation.metrics import outcomes
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.report.cells import (
    mean_of_known,
    new_table,
    number_text,
    percent,
    percent_of,
)
from robotouille_evaluation.report.grouping import by, by_player_and_set, interval, named


def _success(rows: Iterable[ResultRow]) -> str:
    return percent(interval(outcomes.with_goal(rows), outcomes.succeeded))


def teams(rows: Sequence[ResultRow]) -> Table:
    """Return the division of work in teams."""
    lines = []
    for name, group in named([row for row in rows if row.seats > 1]).items():
        for seats, episodes in sorted(by(group, lambda row: str(row.seats)).items()):
            shares = [row.measures.contributions for row in episodes if row.measures.contributions]
            cells = (
                _success(episodes),
                percent_of(mean_of_known(min(each.values()) for each in shares)),
                percent_of(mean_of_known(max(each.values()) for each in shares)),
                number_text(mean_of_known(row.measures.blocked for row in episodes)),
                percent_of(mean_of_known(row.measures.overlap for row in episodes)),
            )
            lines.append(TableRow((name, seats, *cells)))
    columns = ("player", "seats", "success", "least share", "largest share", "blocked", "overlap")
    note = (
        "Least and largest share: work of the players who did least and most. Blocked: actions "
        "per episode that were rejected because of a teammate. Overlap: share of steps in which "
        "two or more players act."
    )
    return new_table("teams", "Teams", columns, lines, note)


def real_time(rows: Sequence[ResultRow]) -> Table:
    """Return the cost of thinking time in episodes whose world does not wait."""
    lines = []
    for name, dataset, episodes in by_player_and_set([r for r in rows if r.real_time]):
        measures = [row.measures for row in episodes]
        cells = (
            _success(episodes),
            number_text(mean_of_known(each.staleness for each in measures)),
            number_text(mean_of_known(each.late_answers for each in measures)),
            percent_of(mean_of_known(each.held_share for each in measures)),
            number_text(mean_of_known(each.lost_to_thinking for each in measures)),
            str(len(episodes)),
        )
        lines.append(TableRow((name, dataset, *cells)))
    columns = ("player", "data set", "success", "staleness", "late", "held", "lost", "episodes")
    note = (
        "Staleness: mean age in steps of the state on which an action is based. Late: answers per "
        "episode that arrived in a later step. Held: share of the actions valid at the time of the "
        "observation that could still be applied. Lost: steps per episode in which a player was "
        "idle because its model was thinking."
    )
    return new_table("real_time", "In real time", columns, lines, note)
