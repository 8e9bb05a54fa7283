"""Agreement of compiled kernels and plain Python, and the contents of records."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from robotouille.compiling import cache_folder

TASKS = [
    "synchronous/02", "synchronous/09", "synchronous/10", "asynchronous/05", "asynchronous/06",
    "asynchronous/08", "asynchronous/10",
]  # fmt: skip
SCRIPT = """
import json, sys
from robotouille import World
from robotouille.planning.kitchen.kernels import COMPILED
from robotouille.planning.solvers import solve
from robotouille.planning.plan import write_plan

found = {"compiled": COMPILED}
for name in sys.argv[1:]:
    world = World(name)
    answer = solve(world)
    found[name] = [write_plan(answer.plan, world), answer.bound, answer.expansions]
print(json.dumps(found))
"""

needs_compiler = pytest.mark.skipif(
    importlib.util.find_spec("numba") is None,
    reason="numba, the extra `fast`, is not installed: kernels run as plain Python",
)


@cache
def answers(compile_kernels: bool) -> dict[str, object]:
    """Return the results of another process."""
    environment = {key: v for key, v in os.environ.items() if key != "ROBOTOUILLE_COMPILE"}
    if not compile_kernels:
        environment["ROBOTOUILLE_COMPILE"] = "0"
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *TASKS],
        env=environment,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, object] = json.loads(done.stdout)
    return found


@pytest.mark.process
@pytest.mark.slow
def test_plain_python_can_be_requested() -> None:
    assert answers(False)["compiled"] is False


@pytest.mark.process
@pytest.mark.nightly
@needs_compiler
# One test, because compiling takes a minute if nothing is cached.
def test_compiled_and_plain_kernels_agree() -> None:
    compiled, plain_python = answers(True), answers(False)
    assert compiled.pop("compiled") is True
    assert compiled == {name: plain_python[name] for name in TASKS}


def test_equal_files_of_two_installations_are_compiled_for_each(tmp_path: Path) -> None:
    folders = tmp_path / "one", tmp_path / "other"
    for folder in folders:
        folder.mkdir()
        (folder / "kernels.py").write_text("def count() -> int: ...")
    assert cache_folder(folders[0]) != cache_folder(folders[1])
