"""Rows of reports as Parquet."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq

from robotouille_evaluation.report.write import write_parquet
from tests.support.episode_rows import made_up_rows, row


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


def test_schema_does_not_depend_on_the_rows(tmp_path: Path) -> None:
    schemas = []
    for number, rows in enumerate(([], [row()], list(made_up_rows(1)))):
        path = tmp_path / f"{number}.parquet"
        write_parquet(rows, path)
        schemas.append(pq.read_schema(path))
    assert schemas[0] == schemas[1] == schemas[2]
