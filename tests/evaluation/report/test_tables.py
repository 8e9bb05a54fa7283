"""Tables of reports: groups of rows, comparisons and published numbers."""

from __future__ import annotations

import csv
from io import StringIO
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from robotouille.html_report.page import Cell, Table, TableRow
from robotouille_evaluation.metrics import (
    BudgetRow,
    Category,
    EpisodeMeasures,
    Optimum,
    Result,
    ResultRow,
    score_share,
    success_rate,
)
from robotouille_evaluation.metrics.rows import FailureRow, RealTimeRow
from robotouille_evaluation.report import published
from robotouille_evaluation.report.appendix_tables import horizons, recovery
from robotouille_evaluation.report.bins import bin_of_steps_to_go
from robotouille_evaluation.report.comparison_tables import ablations, comparisons, variants
from robotouille_evaluation.report.grouping import datasets, may_be_react, named, task_number, tasks
from robotouille_evaluation.report.success_tables import (
    scores,
    scores_by_task,
    success_by_dataset,
    success_by_task,
)
from robotouille_evaluation.report.tables import all_tables, csv_text
from robotouille_evaluation.report.team_tables import real_time
from robotouille_evaluation.report.write import write_parquet
from tests.support.episode_rows import made_up_rows, row, shift_row

WON = Result(success=True, steps=8, ended_by="goal")
LOST = Result(success=False, steps=12, ended_by="step-limit")


def test_success_by_dataset() -> None:
    rows = [row(instance=f"i{n}", **({"outcome": LOST} if n > 2 else {})) for n in range(4)]
    table = success_by_dataset(rows)
    assert table.columns == ("player", "synchronous", "episodes")
    own, *theirs = table.rows
    assert own.cells[0] == "planner"
    # Three of four: sqrt(0.75 · 0.25 / 3) = 0.25.
    assert own.cells[1].startswith("75 % ± 25 (")
    assert own.cells[2] == "4"
    published = ("gpt-4o, ReAct", "47 %, 70 % on tasks played", "–")
    assert TableRow(published, reference=True) in theirs
    whole = [row(task=f"{n:02}_x") for n in range(1, 11)]
    assert "47 %" in [line.cells[1] for line in success_by_dataset(whole).rows]
    unknown = success_by_dataset([row(task="soup"), row(task="99_x")]).rows
    assert "47 %" in [line.cells[1] for line in unknown]
    assert all(line.reference for line in theirs)


def test_scores_of_shifts_are_shares_of_the_points_of_planners() -> None:
    rows = [
        shift_row(50, task="01_x"),
        shift_row(90, task="02_x"),
        shift_row(7, planner=None, task="02_x"),
    ]
    (line,) = scores(rows).rows
    assert line.cells == ("planner", "shifts", "70 % ± 20 (50–90)", "49", "4", "1", "3")
    by_task = [line.cells for line in scores_by_task(rows).rows]
    assert by_task == [("01_x", "1", "100", "50 %"), ("02_x", "1", "100", "90 %")]


def test_shifts_are_not_counted_as_failures() -> None:
    names = {table.name for table in all_tables([shift_row(50)])}
    assert names == {"scores", "scores_by_task", "behaviour", "ablations"}
    with_goals = {table.name: table for table in all_tables([shift_row(50), row()])}
    assert with_goals["success"].columns == ("player", "synchronous", "episodes")
    costs = [line.cells[1:4] for line in with_goals["ablations"].rows]
    assert costs == [("synchronous", "1", "1/1"), ("shifts", "1", "–")]
    assert success_rate([shift_row(50), row()]) == 1
    assert score_share(row()) is None
    assert score_share(shift_row(50, planner=0)) is None


def test_published_success_of_finding_7_has_standard_errors() -> None:
    lines = success_by_dataset([row(dataset="asynchronous")]).rows
    rates = {line.cells[0]: line.cells[1] for line in lines if line.reference}
    assert rates["gpt-4o, ReAct, tasks 1 to 3"] == "30 % ± 8.5"
    assert rates["gpt-4o, ReAct + Prior, tasks 1 to 3"] == "40 % ± 5"
    assert rates["gpt-4o, ReAct"] == "11 %, 20 % on tasks played"
    assert rates["gpt-4o-mini, ReAct"] == "0 %", "the paper has its total only"
    sync = success_by_dataset([row()]).rows
    assert not any("Prior" in str(line.cells[0]) for line in sync)


def test_part_of_a_data_set_is_marked() -> None:
    def cell(*tasks: int) -> str:
        return success_by_dataset([row(task=f"{n:02}_x") for n in tasks]).rows[0].cells[1]

    assert cell(1, 2, 2).endswith(", 2 of 10 tasks")
    assert cell(*range(1, 11)) == "100 % (69–100)"
    own, *_ = success_by_dataset([row(dataset="mine")]).rows
    assert "tasks" not in own.cells[1]


def test_unknown_interval_is_not_shown() -> None:
    rows = [row(task=f"{n:02}_x", seed=seed, **({"outcome": LOST} if seed else {}))
            for n in range(1, 11) for seed in range(2)]  # fmt: skip
    assert success_by_dataset(rows).rows[0].cells[1] == "50 %"


def test_success_by_task_has_published_columns() -> None:
    (table,) = success_by_task([row(task="synchronous/03_lettuce_tomato_sandwich")])
    assert table.columns[:3] == ("task", "optimum", "planner")
    assert table.rows[0].cells[-3:] == ("10 %", "30 %", "80 %")


@pytest.mark.parametrize(
    ("agent", "strategy", "known"),
    [("react-none (m)", "react-none", True), ("react-rules (m)", "react-rules", False),
     ("ReAct/a/b-mpc-prior (m)", "ReAct/a/b-mpc-prior", False), ("ReAct/x (m)", "ReAct/x", True),
     ("mine:Numbered", "", True), ("planner", "", False), ("IO-CoT/x (m)", "IO-CoT/x", False),
     ("PLaG-BaG/x (m)", "PLaG-BaG/x", False), ("io (m)", "", False)],
)  # fmt: skip
def test_agents_that_are_not_react(agent: str, strategy: str, known: bool) -> None:
    assert may_be_react(row(agent=agent, strategy=strategy)) is known
    assert not may_be_react(row(agent=agent, strategy=strategy, variant="stochastic"))


def test_success_and_horizon() -> None:
    lengths = {1: 8, 2: 14, 3: 24, 4: 10}
    rows = [
        row(task=f"{n:02}_x", optimum=Optimum(steps=steps), outcome=LOST if steps > 12 else WON)
        for n, steps in lengths.items()
    ]
    own, *theirs = horizons(rows).rows
    # Ranks 1, 3, 4, 2 of the lengths and 3.5, 1.5, 1.5, 3.5 of the rates.
    assert own.cells == ("planner", "synchronous", "4", "-0.89")
    assert ("gpt-4o, ReAct", "synchronous", "10", "-0.59") in [line.cells for line in theirs]
    assert not horizons(rows[:2]).rows, "two tasks always have a perfect correlation"
    same = [each.model_copy(update={"outcome": WON}) for each in rows]
    assert horizons(same).rows[0].cells[3] == "–"


def test_recovery_in_transition_failures() -> None:
    def failed(category: Category, recovered: int, repeated: int) -> ResultRow:
        cause = FailureRow(category=category, subcategory="x")
        return row(
            outcome=LOST,
            measures=EpisodeMeasures(
                stumbles=2, recovered=recovered, repeated_mistakes=repeated, failure=cause
            ),
        )

    rule = Category.TRANSITION
    rows = [failed(rule, 2, 1), failed(rule, 1, 0), failed(rule, 0, 0), failed(Category.GOAL, 1, 0)]
    own, *theirs = recovery([row(), *rows]).rows
    assert own.cells == ("planner", "synchronous", "3", "66.7 %", "50 %")
    assert [line.cells for line in theirs] == [
        ("gpt-4o, ReAct", "synchronous", "17", "58.8 %", "90 %")
    ]
    assert not recovery([row(), rows[-1]]).rows


def test_published_ablations_are_next_to_ablations_only() -> None:
    def theirs(**fields: str) -> list[tuple[str | Cell, ...]]:
        return [line.cells for line in ablations([row(**fields)]).rows if line.reference]

    strategy = "ReAct/ablations/no-history"
    known = theirs(strategy=strategy)
    assert known[0][:5] == ("gpt-4o, no-history", "synchronous", "3", "1/9", "29.11")
    assert not theirs()
    assert not theirs(strategy="ReAct/synchronous/last-reasoning-action-mpc")
    assert not theirs(strategy=strategy, dataset="asynchronous")


def test_different_settings_are_separate_players() -> None:
    other = BudgetRow(rule="published", steps=12)
    groups = named([row(), row(budget=other), row(budget=other, attempts=2)])
    assert {name: len(group) for name, group in groups.items()} == {
        "planner · own": 1,
        "planner · published": 2,
    }
    assert list(named([row()])) == ["planner"]


def test_variants_have_columns_and_are_never_averaged() -> None:
    rows = [row(), row(variant="stochastic", outcome=LOST), row(variant="delay-free")]
    assert list(named(rows)) == ["planner", "planner · delay-free", "planner · stochastic"]
    assert not comparisons(rows).rows
    own, *theirs = variants(rows).rows
    assert own.cells[:4] == ("planner", "", "synchronous", "01_cheese_sandwich")
    assert [cell.partition(" (")[0] for cell in own.cells[4:]] == ["100 %", "0 %", "–", "100 %"]
    task = "the paper's task 2"
    published = ("gpt-4o, ReAct", "–", "synchronous", task, "80 %", "10 %", "–", "–")
    assert TableRow(published, True) in theirs
    assert not variants([row()]).rows
    rows = [row(), row(dataset="asynchronous", task="asynchronous/0_x", variant="delay-free")]
    own, *theirs = variants(rows).rows
    shown = [line.cells for line in theirs]
    assert ("gpt-4o, ReAct", "–", "asynchronous", "0_x", "20 %", "–", "–", "50 %") in shown
    assert {cells[2] for cells in shown} == {"asynchronous"}, "nothing synchronous has a variant"


def test_variants_of_different_budgets_are_not_averaged() -> None:
    other = BudgetRow(rule="published", steps=12)
    rows = [row(), row(budget=other, outcome=LOST), row(variant="stochastic")]
    own = [line.cells for line in variants(rows).rows if not line.reference]
    assert [cells[0] for cells in own] == ["planner · own"]
    assert own[0][4].startswith("100 %")


def test_experiments_of_a_method_on_its_data_sets_are_one_player() -> None:
    names = {each: f"IO/{each}/io" for each in ("synchronous", "asynchronous")}
    rows = [row(agent=f"{s} (mock)", strategy=s, dataset=d) for d, s in names.items()]
    assert list(named(rows)) == ["IO/io (mock)"]
    other = row(agent="IO/synchronous/io (mock)", strategy="IO/synchronous/io", dataset="mine")
    assert list(named([other])) == ["IO/synchronous/io (mock)"], "its examples are of another one"


def test_players_are_compared_on_common_episodes() -> None:
    one = [row(agent="a", instance=f"i{n}") for n in range(8)]
    other = [row(agent="b", instance=f"i{n}", outcome=LOST) for n in range(1, 7)]
    (line,) = comparisons([*one, *other]).rows
    # All six common episodes are solved by one player only: p = 2 / 2^6.
    assert line.cells == ("a", "b", "6", "0", "6", "0.031")


@pytest.mark.parametrize(
    ("task", "number"),
    [("synchronous/01_cheese_sandwich", 1), ("10_big", 10), ("asynchronous/0_cheese", 1),
     ("9_onion", 10), ("multi_agent/9_burgers", 9), ("multi_agent/10_soups", 10),
     ("soup", None), (f"{'1' * 5000}_x", None), ("synchronous", None)],
)  # fmt: skip
def test_task_number_of_the_paper(task: str, number: int | None) -> None:
    assert task_number(task) == number


def test_bins_of_steps_to_go() -> None:
    def named_bin(least: float | None, most: float | None, dead: bool = False) -> str | None:
        return bin_of_steps_to_go(
            EpisodeMeasures(to_go_least=least, to_go_most=most, out_of_reach=dead)
        )

    assert named_bin(0.49, 0.49) == "below 0.5"
    assert named_bin(0.5, 0.99) == "0.5 to 1", "a bin contains its lower bound"
    assert named_bin(1.0, 1.49) == "1 to 1.5"
    assert named_bin(1.5, 9.0) == "1.5 or more"
    assert named_bin(0.9, 1.1) is None
    assert named_bin(1.2, None) is None
    assert named_bin(None, None) is None
    assert named_bin(None, None, dead=True) == "out of reach"


def test_data_sets_and_tasks_are_in_the_papers_order() -> None:
    rows = list(made_up_rows(1))[::-1]
    assert list(datasets([*rows, row(dataset="extra")])) == [
        "synchronous", "asynchronous", "multi_agent", "extra"
    ]  # fmt: skip
    assert list(tasks(rows))[0].startswith("01_")


@pytest.mark.parametrize("cell", ["=1+1", "+1", "-1+1", "@a", "\t=1", "  =1", "\ta"])
def test_csv_cells_and_headings_are_never_formulas(cell: str) -> None:
    table = Table(("player", cell), [TableRow(("a,b", cell))])
    head, line = csv.reader(StringIO(csv_text(table), newline=""))
    assert head == ["player", f"'{cell}", "source"]
    assert line == ["a,b", f"'{cell}", "own"]


def test_negative_numbers_stay_numbers() -> None:
    table = Table(("player", "share"), [TableRow(("-0.5", "-13.8 %"))])
    assert csv_text(table).splitlines()[1] == "-0.5,-13.8 %,own"


def test_csv_cells_have_one_line() -> None:
    table = Table(("player",), [TableRow(("a\r=1\n+1",)), TableRow(("\r=1",))])
    assert csv_text(table) == "player,source\na =1 +1,own\n' =1,own\n"


def test_comparisons_are_limited_to_the_players_with_most_episodes() -> None:
    rows = [row(agent=f"a{n:04}", instance=f"i{i}") for n in range(100) for i in range(1 + n % 2)]
    table = comparisons(rows)
    assert len(table.rows) == 30 * 29 // 2
    assert all(line.cells[4] == "2" for line in table.rows)
    assert "70 more players" in table.note


def test_many_players_and_data_sets_have_no_column_each() -> None:
    """The cells would grow as the product of both, and 1,600 of each took 16 seconds."""
    many = [
        row(agent=f"a{i}", dataset=name, instance=f"{name}{i}")
        for i in range(50)
        for name in (f"d{i}", "shared")
    ]
    by_set, *by_task = success_by_dataset(many), *success_by_task(many)
    (shared,) = (table for table in by_task if table.name == "success_shared")
    assert len(by_set.columns) == 1 + 40 + 1
    assert "shared" in by_set.columns
    assert "11 more data sets" in by_set.note
    assert len(shared.columns) == 2 + 40
    assert "10 more players" in shared.note
    assert all(len(table.columns) == 3 for table in by_task if table is not shared)


def test_every_row_has_all_columns() -> None:
    for table in all_tables(list(made_up_rows(2))):
        assert {len(line.cells) for line in table.rows} == {len(table.columns)}, table.name


def test_published_totals_are_means_of_their_tasks() -> None:
    """The paper's totals are printed separately."""
    totals = {each.strategy: each for each in published.SUCCESS if each.model == "gpt-4o"}
    for dataset, strategies in published.SUCCESS_BY_TASK.items():
        for strategy, values in strategies.items():
            assert len(values) == 10
            assert sum(values) / 10 == getattr(totals[strategy], dataset)


def test_real_time_episodes_are_separate() -> None:
    """Two players have one name. The second plays in real time."""
    measures = EpisodeMeasures(staleness=2, late_answers=2, held_share=0.5, lost_to_thinking=3)
    moving = RealTimeRow(step_rate=5, charge="tokens:20", late="drop", helper="planner")
    waiting = row()
    quick = row(clock="realtime", real_time=moving, measures=measures)
    assert waiting.pair != quick.pair
    pace = "real time: 5 steps/s, tokens:20, drop, helper planner"
    assert set(named([waiting, quick])) == {"planner", f"planner · {pace}"}
    assert list(named([quick])) == ["planner"]
    (line,) = real_time([waiting, quick]).rows
    assert line.cells[2:] == ("100 % (3–100)", "2", "2", "50 %", "3", "1")
    assert not real_time([waiting]).rows
    assert not comparisons([waiting, quick]).rows


def test_team_sizes_on_one_instance_are_separate() -> None:
    rows = [
        row(),
        row(dataset="multi_agent", instance="team", seats=2),
        row(dataset="multi_agent", instance="team", seats=3),
    ]
    assert list(named(rows)) == ["planner", "planner · 2 players", "planner · 3 players"]
    assert list(named(rows[:2])) == ["planner"]


def test_every_field_of_a_row_is_a_column(tmp_path: Path) -> None:
    rows = list(made_up_rows(1))
    write_parquet(rows, tmp_path / "rows.parquet")
    table = pq.read_table(tmp_path / "rows.parquet")
    assert table.num_rows == len(rows)
    assert table["outcome_steps"].to_pylist() == [each.outcome.steps for each in rows]
    assert table["budget_rule"].to_pylist() == [each.budget.rule for each in rows]
    assert table["usage_cost"].to_pylist() == [each.usage.cost for each in rows]
    shares = [dict(pairs) for pairs in table["measures_contributions"].to_pylist()]
    assert shares == [each.measures.contributions for each in rows]
    categories = [each.measures.failure and each.measures.failure.category for each in rows]
    assert table["measures_failure_category"].to_pylist() == categories


def test_rows_are_converted_in_groups(tmp_path: Path) -> None:
    """Conversion takes several times the memory of the rows."""
    write_parquet([row()] * 251, tmp_path / "rows.parquet")
    assert pq.ParquetFile(tmp_path / "rows.parquet").num_row_groups == 2


def test_schema_does_not_depend_on_the_rows(tmp_path: Path) -> None:
    schemas = []
    for number, rows in enumerate(([], [row()], list(made_up_rows(1)))):
        path = tmp_path / f"{number}.parquet"
        write_parquet(rows, path)
        schemas.append(pq.read_schema(path))
    assert schemas[0] == schemas[1] == schemas[2]
