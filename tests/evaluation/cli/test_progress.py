"""How far a run is, in a line."""

from __future__ import annotations

from robotouille_evaluation.cli.progress import RunProgress
from robotouille_evaluation.metrics.rows import BudgetRow, EpisodeRow, PackId, Result, Spent
from robotouille_evaluation.runs import AgentSpec, Job


def row(*, error: str | None = None) -> EpisodeRow:
    return EpisodeRow(
        run="r", pack=PackId(name="p", version="1", digest="d"), dataset="d", task="t",
        instance="i", agent="a", budget=BudgetRow(rule="own", steps=9), usage=Spent(cost=0.25),
        outcome=Result(success=error is None, steps=1, ended_by="goal"), error=error,
    )  # fmt: skip


def test_where_there_is_no_terminal_a_line_says_it() -> None:
    job = Job(agent=AgentSpec(name="a", kind="random"), instance="i", seats=1, seed=0, budget="own")
    with RunProgress([row()], 12) as progress:
        assert str(progress) == "1 of 12 episodes over, 1 solved, $0.25, after 0 s"
        progress.finished(job, row(error="time-out: none"))
        assert str(progress).startswith("2 of 12 episodes over, 1 solved, 1 errors, $0.50, after")
