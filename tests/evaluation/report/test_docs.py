"""The example of docs/metrics.md runs, and the page defines every metric."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import pytest

from robotouille_evaluation.metrics import asynchrony, measuring, outcomes, write_rows
from robotouille_evaluation.metrics.failures import CATEGORIES
from tests.support.episode_rows import row
from tests.support.games import recorded_game
from tests.support.pages import blocks, read

PAGE = "metrics.md"
WITHOUT_NAME = {"cost", "is_optimal", "measure", "success_within", "tokens"}
"""Functions that the page describes without their names."""


def test_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("episode.rbt").write_bytes(recorded_game("synchronous/01", steps=20))
    Path("rows.jsonl").write_text("".join(write_rows([row()])), encoding="utf-8")
    names: dict[str, Any] = {}
    for block in blocks(PAGE, "python"):
        exec(compile(block, PAGE, "exec"), names)
    assert Path("report/report.html").is_file()


def metrics(module: Any) -> set[str]:
    """Return the names of a module's public functions of a trajectory or of rows."""
    return {
        name
        for name, function in inspect.getmembers(module, inspect.isfunction)
        if function.__module__ == module.__name__
        and not name.startswith("_")
        and next(iter(inspect.signature(function).parameters)) in ("trajectory", "row", "rows")
    }


@pytest.mark.parametrize("module", [asynchrony, measuring, outcomes])
def test_the_page_defines_every_metric(module: Any) -> None:
    found = metrics(module)
    assert found
    page = read(PAGE)
    assert [name for name in found - WITHOUT_NAME if f"`{name}`" not in page] == []


def test_the_table_lists_every_subcategory() -> None:
    table = read(PAGE).partition("## Why episodes fail")[2]
    for subcategory, category in CATEGORIES.items():
        assert subcategory.value in table
        assert category.value in table
