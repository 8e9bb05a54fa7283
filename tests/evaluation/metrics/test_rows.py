"""Rows as lines: what a killed run leaves, and what is no row."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from robotouille.errors import FileError
from robotouille_evaluation.metrics import read_rows, write_rows
from tests.support.episode_rows import made_up_rows, row


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "rows.jsonl"
    path.write_text(text, encoding="utf-8")
    return path


def test_rows_come_back(tmp_path: Path) -> None:
    rows = list(made_up_rows(1))
    assert read_rows(written(tmp_path, "".join(write_rows(rows)))) == rows


def test_a_last_line_that_was_cut_off_is_left_out(tmp_path: Path) -> None:
    text = "".join(write_rows([row(), row(trial=1)]))
    for kept in range(1, 60):
        assert read_rows(written(tmp_path, text[:-kept])) == [row()] or kept == 1


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    good = "".join(write_rows([row()]))
    with pytest.raises(FileError, match="line 2: "):
        read_rows(written(tmp_path, good + "{}\n" + good))
    with pytest.raises(FileError, match="cannot be read"):
        read_rows(tmp_path / "none.jsonl")


def test_of_a_job_that_was_played_again_the_last_row_counts(tmp_path: Path) -> None:
    broken, whole, other = row(job="a", error="no answer"), row(job="a"), row(job="b")
    path = written(tmp_path, "".join(write_rows([broken, other, whole])))
    assert read_rows(path) == [whole, other]


def test_rows_are_checked() -> None:
    with pytest.raises(ValidationError):
        row(trial=-1)
    with pytest.raises(ValidationError):
        row(seconds=float("nan"))
    with pytest.raises(ValidationError):
        row(mood="good")


def test_who_played() -> None:
    assert row(agent="llm", strategy="react", model="m").player == "llm · react · m"
    assert row(agent="react (m)", strategy="react", model="m").player == "react (m)"
    assert row(agent="planner", strategy="planner").player == "planner"
