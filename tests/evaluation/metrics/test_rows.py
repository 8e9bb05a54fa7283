"""Rows as JSON lines: truncated, damaged and invalid ones."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from robotouille.errors import FileError
from robotouille_evaluation.metrics import BudgetRow, PackId, read_rows, write_rows
from tests.support.episode_rows import made_up_rows, row

NAMES = ("agent", "strategy", "model", "sampling", "experiment", "variant", "timing", "clock",
         "control")  # fmt: skip


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "rows.jsonl"
    path.write_text(text, encoding="utf-8")
    return path


def test_rows_round_trip(tmp_path: Path) -> None:
    rows = list(made_up_rows(1))
    assert read_rows(written(tmp_path, "".join(write_rows(rows)))) == rows


def test_truncated_last_line_is_left_out(tmp_path: Path) -> None:
    text = "".join(write_rows([row(), row(attempts=2)]))
    for kept in range(1, 60):
        assert read_rows(written(tmp_path, text[:-kept])) == [row()] or kept == 1


def test_damaged_line_is_an_error(tmp_path: Path) -> None:
    good = "".join(write_rows([row()]))
    with pytest.raises(FileError, match="line 2: "):
        read_rows(written(tmp_path, good + "{}\n" + good))
    with pytest.raises(FileError, match="cannot be read"):
        read_rows(tmp_path / "none.jsonl")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("\n" * 100_001, "more than 100,000 lines"),
        (f"{' ' * 1_000}{',' * 1_000_000}\n", "line 1: "),
        (" " * 140_000, "line 1: is longer than 131,072 bytes"),
        pytest.param(
            f"{' ' * 130_000}\n" * 2_100,
            "the file is longer than 268,435,456 bytes",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_endless_rows_are_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(FileError, match=words):
        read_rows(written(tmp_path, text))


@pytest.mark.slow
def test_rows_are_read_one_by_one(tmp_path: Path) -> None:
    path = written(tmp_path, "".join(write_rows([row(job="a")] * 2_000)) + "\n" * 90_000)
    tracemalloc.start()
    try:
        assert len(read_rows(path)) == 1
        assert tracemalloc.get_traced_memory()[1] < path.stat().st_size / 2
    finally:
        tracemalloc.stop()


def test_row_takes_a_few_kilobytes(tmp_path: Path) -> None:
    path = written(tmp_path, "".join(write_rows(row(job=f"job {n}") for n in range(500))))
    tracemalloc.start()
    try:
        rows = read_rows(path)
        assert tracemalloc.get_traced_memory()[0] < 5_000 * len(rows)
    finally:
        tracemalloc.stop()


def test_last_row_of_a_repeated_job_counts(tmp_path: Path) -> None:
    broken, whole, other = row(job="a", error="no answer"), row(job="a"), row(job="b")
    path = written(tmp_path, "".join(write_rows([broken, other, whole])))
    assert read_rows(path) == [whole, other]


def test_player_of_a_row() -> None:
    assert row(agent="llm", strategy="react", model="m").player == "llm · react · m"
    assert row(agent="react (m)", strategy="react", model="m").player == "react (m)"
    assert row(agent="planner", strategy="planner").player == "planner"


@pytest.mark.parametrize(
    "fields",
    [
        {"task": "x" * 1001},
        *({name: "x" * 1001} for name in NAMES),
        {"budget": {"rule": "x" * 1001, "steps": 1}},
        {"outcome": {"success": False, "steps": 1, "ended_by": "x" * 1001}},
        {"real_time": {"step_rate": 1.0, "charge": "x" * 1001, "late": "use"}},
        {"measures": {"contributions": {"x" * 1001: 1.0}}},
        {"measures": {"failure": {"category": "goal", "subcategory": "x" * 1001}}},
        {"pack": {"name": "x" * 1001, "version": "1", "digest": "0"}},
        {"seed": 10**30},
        {"seed": -(10**30)},
        {"attempts": 10**30},
        {"outcome": {"success": False, "steps": 10**30, "ended_by": "goal"}},
        {"usage": {"prompt_tokens": 10**30}},
        {"measures": {"failure": {"category": "bad mood", "subcategory": ""}}},
        {"measures": {"failure": {"category": "goal", "subcategory": "", "steps": [10**30]}}},
    ],
)
def test_out_of_range_values_are_errors(tmp_path: Path, fields: dict[str, Any]) -> None:
    line = json.dumps({**row().model_dump(mode="json"), **fields})
    with pytest.raises(FileError, match="line 1: "):
        read_rows(written(tmp_path, f"{line}\n"))


@pytest.mark.parametrize(
    "terms",
    [
        {"pack": PackId(name="ours", version="1.0", digest="fedcba9876543210")},
        {"kind": "noisy"},
        {"seats": 2},
        {"seed": 1},
        {"timing": "people"},
        {"clock": "lockstep"},
        {"variant": "stochastic"},
        {"budget": BudgetRow(rule="published", steps=12)},
    ],
)
def test_other_conditions_make_other_pairs(terms: dict[str, Any]) -> None:
    assert row(agent="a", **terms).pair != row(agent="b").pair
