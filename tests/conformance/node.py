"""Runs the Node client with its two libraries."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from tests.support.node import libraries, node

__all__ = ["run_node"]

FOLDER = Path(__file__).parent
OLDEST = 18


def run_node(task: str, **options: Any) -> Any:
    """Return the result of a task of `client.mjs`, or skip the test without Node."""
    program = node(OLDEST)
    libraries(FOLDER)
    done = subprocess.run(
        [program, str(FOLDER / "client.mjs")],
        input=json.dumps({"do": task, **options}),
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
