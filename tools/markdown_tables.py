"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["cell", "table"]


def cell(text: str) -> str:
    """Return a text as the content of a cell."""
    return " ".join(text.split()).replace("|", "\\|")


def table(heads: str, rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table; `heads` are the column titles, separated by commas."""
    titles = heads.split(", ")
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
