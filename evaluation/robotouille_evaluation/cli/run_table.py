"""What came of a run, agent by agent, as a short table for a terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import fmean

from rich.table import Table
from rich.text import Text

from robotouille.program import printable
from robotouille_evaluation.metrics import outcomes
from robotouille_evaluation.metrics.rows import EpisodeRow

__all__ = ["run_table"]

UNKNOWN = "–"


def run_table(rows: Sequence[EpisodeRow]) -> Table:
    """A line for each agent, in the order of their names; no column of which nothing is known."""
    agents: dict[str, list[EpisodeRow]] = {}
    for row in rows:
        agents.setdefault(row.agent, []).append(row)
    names = sorted(agents)
    table = Table(box=None, pad_edge=False)
    table.add_column("agent", overflow="fold")
    lines = [[Text(printable(name))] for name in names]
    for heading, cell in COLUMNS.items():
        cells = [cell(agents[name]) for name in names]
        if set(cells) != {UNKNOWN}:
            table.add_column(heading, justify="right", no_wrap=True)
            for line, shown in zip(lines, cells, strict=True):
                line.append(Text(shown))
    for line in lines:
        table.add_row(*line)
    return table


def _success(rows: Sequence[EpisodeRow]) -> str:
    rate = outcomes.success_rate(rows)
    return UNKNOWN if rate is None else f"{100 * rate:.3g} %"


def _optimality(rows: Sequence[EpisodeRow]) -> str:
    rates = [rate for rate in map(outcomes.optimality_rate, rows) if rate is not None]
    return f"{fmean(rates):.2f}" if rates else UNKNOWN


def _cost(rows: Sequence[EpisodeRow]) -> str:
    cost = outcomes.cost(rows)
    return UNKNOWN if cost is None else f"${cost:.2f}"


COLUMNS: dict[str, Callable[[Sequence[EpisodeRow]], str]] = {
    "episodes": lambda rows: str(len(rows)),
    "success": _success,
    "steps / optimum": _optimality,
    "errors": lambda rows: str(sum(row.error is not None for row in rows)),
    "cost": _cost,
}
