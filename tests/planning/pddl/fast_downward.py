"""Fast Downward, an independent optimal planner, if installed (PyPI: up-fast-downward)."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

from robotouille.planning.pddl import PddlEncoding


def driver() -> Path | None:
    spec = importlib.util.find_spec("up_fast_downward")
    if spec is None or spec.origin is None:
        return None
    path = Path(spec.origin).parent / "downward" / "fast-downward.py"
    return path if path.is_file() else None


needs_planner = pytest.mark.skipif(
    driver() is None, reason="Fast Downward is not installed: pip install up-fast-downward"
)


def solve(encoding: PddlEncoding, folder: Path) -> tuple[int, str]:
    """Return the cost of an optimal plan, and the plan."""
    (folder / "domain.pddl").write_text(encoding.domain)
    (folder / "problem.pddl").write_text(encoding.problem)
    command = [
        sys.executable, str(driver()), "--plan-file", "plan", "domain.pddl", "problem.pddl",
        "--search", "astar(blind())",
    ]  # fmt: skip
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr
    cost = re.search(r"Plan cost: (\d+)", result.stdout)
    assert cost is not None
    return int(cost[1]), (folder / "plan").read_text()
