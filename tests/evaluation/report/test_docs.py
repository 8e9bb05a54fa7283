"""What docs/metrics.md shows, done; and whether it knows every metric."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robotouille_evaluation.metrics import asynchrony, outcomes, progress, teams, write_rows
from robotouille_evaluation.metrics.failures import CATEGORIES
from tests.support.episode_rows import row
from tests.support.games import recorded_game
from tests.support.pages import blocks, read

PAGE = "metrics.md"
NOT_METRICS = {"Recovery", "TimeShares"}
SAID_OTHERWISE = {"cost", "is_optimal", "success_within", "tokens"}


def test_the_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("episode.rbt").write_bytes(recorded_game("synchronous/01", steps=20))
    Path("rows.jsonl").write_text("".join(write_rows([row()])), encoding="utf-8")
    names: dict[str, Any] = {}
    for block in blocks(PAGE, "python"):
        exec(compile(block, PAGE, "exec"), names)
    assert Path("report/report.html").is_file()


@pytest.mark.parametrize("module", [asynchrony, outcomes, progress, teams])
def test_every_metric_is_defined_there(module: Any) -> None:
    page = read(PAGE)
    for name in set(module.__all__) - NOT_METRICS - SAID_OTHERWISE:
        assert f"`{name}`" in page, name


def test_every_subcategory_is_in_the_table() -> None:
    table = read(PAGE).partition("## Why episodes fail")[2]
    for subcategory, category in CATEGORIES.items():
        assert subcategory.value in table
        assert category.value in table
