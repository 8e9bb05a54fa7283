"""Answers to queries of SQLite catalogues without a process for each query."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import pytest

from robotouille_data.sqlite_process import answer_frames

__all__ = ["answers_without_processes"]


@pytest.fixture(autouse=True)
def answers_without_processes(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Let quick tests answer SQLite queries in this process, without the limits."""
    if request.node.get_closest_marker("process") is not None:
        return
    query = pytest.importorskip("robotouille_data.query", reason="needs the extra `data`")
    monkeypatch.setattr(query, "sqlite_answer", _answer)


@contextmanager
def _answer(
    uri: str, query: str, *, seconds: float, lock_seconds: float
) -> Iterator[tuple[list[str], Iterator[Any]]]:
    with closing(answer_frames(uri, query, lock_seconds)) as frames:
        yield list(next(frames)), frames
