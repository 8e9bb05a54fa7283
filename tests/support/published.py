"""Reference data of the published evaluation; tests are skipped if it is missing."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

__all__ = ["CHECKOUT", "NEEDED", "PUBLISHED", "conversations", "published_problem", "read"]

PUBLISHED = Path(__file__).resolve().parents[3] / "shared" / "compat" / "published"
CHECKOUT = PUBLISHED / "checkout"
PROBLEMS = CHECKOUT / "environments/env_generator/examples"

NEEDED = pytest.mark.skipif(not PUBLISHED.is_dir(), reason="needs the published reference data")


def read(path: Path) -> Any:
    """Return the JSON value in a file."""
    return json.loads(path.read_text(encoding="utf-8"))


def published_problem(task: str) -> dict[str, Any]:
    """Return a problem of the checkout, such as `synchronous/0_cheese_sandwich`."""
    problem: dict[str, Any] = read(PROBLEMS / f"{task}.json")
    return problem


@cache
def conversations() -> tuple[Path, ...]:
    """Return the files of the recorded conversations."""
    folder = PUBLISHED / "conversations"
    return tuple(sorted(path for path in folder.glob("*.json") if path.name != "index.json"))
