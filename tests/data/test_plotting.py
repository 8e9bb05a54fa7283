"""Plots of answers."""

from __future__ import annotations

import re
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sqlalchemy", reason="needs the extra `data`")
pytest.importorskip("matplotlib", reason="needs the extra `data`")

from robotouille_data.database import CatalogueError
from robotouille_data.query import QueryAnswer
from robotouille_data.query_output import MAX_BARS, save_plot

HOSTILE = "<script>$x^2$\x07</script>"


def plot(path: Path, columns: str, *rows: tuple[Any, ...]) -> str:
    """Draw a plot and return its texts in order."""
    assert save_plot(QueryAnswer(tuple(columns.split()), iter(rows)), path) == len(rows)
    return " | ".join(re.findall(r"<text[^>]*>([^<]*)</text>", path.read_text(encoding="utf-8")))


def test_text_column_gives_bars(tmp_path: Path) -> None:
    rows = [("apart", 1, Decimal("2.5")), ("together", 3, None)]
    texts = plot(tmp_path / "a.svg", "group steps share", *rows)
    for word in ("apart", "together", "group", "steps", "share"):
        assert word in texts


def test_number_column_gives_lines(tmp_path: Path) -> None:
    texts = plot(tmp_path / "a.svg", "round steps", (2, 5.0), (1, 7), (3, None))
    assert "round" in texts
    assert "steps" in texts


def test_huge_numbers_are_gaps(tmp_path: Path) -> None:
    rows = [(1e308, 1e308), (-1e308, -1e308), (1, 2), (2, 1e308), (3, -1e308), (4, 5)]
    assert "steps" in plot(tmp_path / "a.svg", "round steps", *rows)
    assert "steps" in plot(tmp_path / "b.svg", "round steps", (1e299, 1e299), (-1e299, -1e299))


@pytest.mark.slow
def test_equal_answers_give_equal_bytes(tmp_path: Path) -> None:
    rows = [(HOSTILE, 1, True), ("日本語", 2, False)]
    for suffix in ("svg", "png"):
        content = set()
        for name in ("a", "b"):
            path = tmp_path / f"{name}.{suffix}"
            save_plot(QueryAnswer(("x", HOSTILE, "z"), iter(rows)), path)
            content.add(path.read_bytes())
        assert len(content) == 1
    assert b"<script>" not in (tmp_path / "a.svg").read_bytes()
    assert b"\x07" not in (tmp_path / "a.svg").read_bytes()
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_answers_that_cannot_be_drawn_are_refused(tmp_path: Path) -> None:
    many = [(f"g{number}", 1) for number in range(MAX_BARS + 1)]
    for name, columns, rows, received in (
        ("a.jpg", ("x", "y"), [("a", 1)], "end in .svg or .png"),
        ("a.svg", ("x", "y"), [], "no rows"),
        ("a.svg", ("x", "y"), [("a", "b")], "no column of numbers"),
        ("a.svg", ("x",), [(1,)], "no column of numbers"),
        ("a.svg", ("x", *"abcdefg"), [("a", *range(7))], "room for 6"),
        ("a.svg", ("x", "y"), many, "room for 60 bars"),
        ("a.svg", ("x", "y"), [(b"\0", 1)], "`x` has values that are no numbers"),
    ):
        with pytest.raises(CatalogueError, match=re.escape(received)):
            save_plot(QueryAnswer(columns, iter(rows)), tmp_path / name)
    assert not list(tmp_path.iterdir())
