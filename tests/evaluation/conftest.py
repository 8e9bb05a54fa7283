"""Parts of runs that most tests replace, because they take seconds and have tests of their own."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from robotouille_evaluation.metrics import ResultRow


@pytest.fixture
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip the report, whose figures take seconds."""

    def write_report(rows: list[ResultRow], folder: Path, **_: Any) -> Path:
        assert rows
        return folder / "report.html"

    monkeypatch.setattr("robotouille_evaluation.report.write_report", write_report)


@pytest.fixture
def no_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Play agents without a model in threads, because each process imports everything again."""

    def pool(workers: int, _context: object, _prepare: Callable[[], None]) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(workers)

    monkeypatch.setattr("robotouille_evaluation.runs.workers.ProcessPoolExecutor", pool)
