"""Commands `benchmark report`, `compare` and `agreement` on existing rows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from robotouille_evaluation.cli.benchmark import benchmark
from robotouille_evaluation.metrics import BudgetRow, Category, EpisodeMeasures, PackId, ResultRow
from robotouille_evaluation.metrics import Result as Outcome
from robotouille_evaluation.metrics.rows import FailureRow
from robotouille_evaluation.report.comparison_tables import comparisons
from robotouille_evaluation.runs import RunFolder
from tests.support.episode_rows import row, shift_row

PUBLISHED = PackId(name="published", version="1", digest="fedcba9876543210")


def called(*words: Any) -> Result:
    return CliRunner().invoke(benchmark, [str(word) for word in words])


def run_of(path: Path, *rows: ResultRow) -> Path:
    path.mkdir(parents=True)
    for each in rows:
        RunFolder(path).add(each)
    return path


def test_agents_under_different_conditions_are_not_compared(tmp_path: Path) -> None:
    ours = run_of(tmp_path / "a", row(agent="planner"))
    theirs = run_of(
        tmp_path / "b",
        row(agent="react (m)", pack=PUBLISHED, budget=BudgetRow(rule="published", steps=20)),
    )
    result = called("compare", "planner", "react (m)", ours, theirs)
    assert result.exit_code == 1
    received = " ".join(result.output.split())
    assert "pack ours 1.0 (0123456789ab) and published 1 (fedcba987654)" in received
    assert "budget own (12 steps) and published (20 steps)" in received
    assert "timing" not in received


def test_agent_names_without_model(tmp_path: Path) -> None:
    run = run_of(
        tmp_path / "a",
        *(row(agent="react (m)", job=f"a{n}", instance=f"i{n}") for n in range(2)),
        *(row(agent="reflexion (m)", job=f"b{n}", instance=f"i{n}", attempts=2) for n in range(2)),
    )
    result = called("compare", "react", "reflexion (m)", run, "--json")
    assert json.loads(result.output) == {
        "episodes": 2,
        "react": 2,
        "reflexion (m)": 2,
        "p": 1.0,
        "mean_steps": {"react": 8.0, "reflexion (m)": 8.0, "p": 1.0},
    }
    assert "has no episode; choose react (m), reflexion (m)" in " ".join(
        called("compare", "planner", "react", run).output.split()
    )


def test_significance_of_a_clear_difference(tmp_path: Path) -> None:
    lost = Outcome(success=False, steps=12, ended_by="step-limit")
    run = run_of(
        tmp_path / "a",
        *(row(agent="planner", job=f"a{n}", instance=f"i{n}") for n in range(12)),
        *(row(agent="random", job=f"b{n}", instance=f"i{n}", outcome=lost) for n in range(12)),
    )
    received = " ".join(called("compare", "planner", "random", run).output.split())
    # 2 / 2^12, for both tests.
    assert received == (
        "12 episodes: planner solves 12, random 0; p < 0.001 (McNemar, exact). "
        "Mean steps 8.0 and 12.0; p < 0.001 (permutation)"
    )


def test_shifts_are_compared_by_points(tmp_path: Path) -> None:
    run = run_of(
        tmp_path / "a",
        *(shift_row(90, agent="planner", job=f"a{n}", instance=f"i{n}") for n in range(12)),
        *(shift_row(n, agent="random", job=f"b{n}", instance=f"i{n}") for n in range(12)),
    )
    assert " ".join(called("compare", "planner", "random", run).output.split()) == (
        "12 shifts: mean points 90.0 of planner and 5.5 of random; p < 0.001 (permutation)"
    )
    found = json.loads(called("compare", "planner", "random", run, "--json").output)
    assert found["episodes"] == 12
    assert found["mean_points"]["random"] == 5.5


def test_repeated_episodes_are_compared_by_their_means(tmp_path: Path) -> None:
    """The rows of the last folder replaced those of the others."""
    lost = Outcome(success=False, steps=12, ended_by="step-limit")
    many = [{"job": f"a{n}", "instance": f"i{n}"} for n in range(14)]
    one = run_of(
        tmp_path / "one",
        *(row(run="one", **each) for each in many),
        *(row(run="one", agent="random", **each | {"job": f"{n}"}) for n, each in enumerate(many)),
        shift_row(90, run="one", job="s"),
        shift_row(50, run="one", job="t", agent="random"),
    )
    two = run_of(
        tmp_path / "two",
        *(row(run="two", outcome=lost, **each) for each in many[::-1][:5]),
        shift_row(20, run="two", job="s"),
    )
    found = [called("compare", "planner", "random", *runs).output
             for runs in ((one, two), (two, one))]  # fmt: skip
    assert found[0] == found[1]
    text = " ".join(found[0].split())
    assert "14 episodes, by the means of repeated ones: planner solves 11.5, random 14" in text
    assert "p = 0.062 (permutation). Mean steps 8.7 and 8.0" in text
    assert "1 shifts, by the means of repeated ones: mean points 55.0 of planner and 50.0" in text
    rows = [each for path in (one, two) for each in RunFolder(path).rows() if not each.is_shift]
    for ordered in (rows, rows[::-1]):
        (line,) = comparisons(ordered).rows
        assert line.cells == ("planner", "random", "11.5", "14", "14", "0.062")


def test_labels_are_paired_within_a_run(tmp_path: Path) -> None:
    """A job's recording has the same name in every run."""
    lost = {
        category: EpisodeMeasures(failure=FailureRow(category=category, subcategory="x"))
        for category in Category
    }
    kept = {"job": "a", "recording": "recordings/a.rbt"}
    one = run_of(tmp_path / "one", row(run="one", measures=lost[Category.GOAL], **kept))
    two = run_of(tmp_path / "two", row(run="two", measures=lost[Category.STATE], **kept))
    labels = tmp_path / "labels.csv"
    labels.write_text("recording,category\nrecordings/a.rbt,goal\n", encoding="utf-8")
    result = called("agreement", labels, one, two)
    assert result.exit_code == 1
    assert "the runs one and two all have recordings/a.rbt; choose one" in " ".join(
        result.output.split()
    )
    assert "classified" not in called("agreement", labels, one).output
    labels.write_text("run,recording,category\none,recordings/a.rbt,goal\n", encoding="utf-8")
    result = called("agreement", labels, one, two)
    assert result.exit_code == 0
    assert "classified" not in result.output
