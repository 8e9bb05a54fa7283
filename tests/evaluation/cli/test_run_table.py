"""The table at the end of a run."""

from __future__ import annotations

from io import StringIO

from rich.console import Console

from robotouille_evaluation.cli.run_table import run_table
from robotouille_evaluation.metrics.rows import EpisodeRow, Optimum, Result, Spent
from tests.support.episode_rows import row


def shown(rows: list[EpisodeRow]) -> list[str]:
    console = Console(file=StringIO(), width=100)
    console.print(run_table(rows))
    assert isinstance(console.file, StringIO)
    return [" ".join(line.split()) for line in console.file.getvalue().splitlines()]


def test_an_agent_is_a_line() -> None:
    lost = Result(success=False, steps=12, ended_by="error")
    rows = [
        row(agent="react [x] (m)", outcome=lost, error="endpoint: nobody", usage=Spent(cost=0.5)),
        row(agent="react [x] (m)", usage=Spent(cost=1.0)),
        row(agent="planner", usage=Spent(), optimum=Optimum()),
    ]
    assert shown(rows) == [
        "agent episodes success steps / optimum errors cost",
        "planner 1 100 % – 0 –",
        "react [x] (m) 2 50 % 1.00 1 $1.50",
    ]


def test_what_nobody_knows_is_no_column() -> None:
    (heading, line) = shown([row(agent="random", usage=Spent(), optimum=Optimum())])
    assert heading == "agent episodes success errors"
    assert line == "random 1 100 % 0"
