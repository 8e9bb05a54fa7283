"""Compiled kernels and plain Python give the same answers; records hold what is put into them."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

import pytest

from robotouille.planners.kitchen import kernels
from robotouille.planners.kitchen.kernels import (
    SMALL,
    Cube,
    Ints,
    Table,
    blank_records,
    kernel,
    plain,
    record,
    records,
)

TASKS = [
    "synchronous/02", "synchronous/09", "synchronous/10", "asynchronous/05", "asynchronous/06",
    "asynchronous/08", "asynchronous/10",
]  # fmt: skip
SCRIPT = """
import json, sys
from robotouille import World
from robotouille.planners.kitchen.kernels import COMPILED
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
    """The answers of a process of its own."""
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
def test_plain_python_can_be_asked_for() -> None:
    assert answers(False)["compiled"] is False


@pytest.mark.process
@pytest.mark.nightly
@needs_compiler
def test_compiled_and_plain_give_the_same_answers() -> None:
    """One test, since compiling takes a minute wherever it has not been done."""
    compiled, plain_python = answers(True), answers(False)
    assert compiled.pop("compiled") is True
    assert compiled == {name: plain_python[name] for name in TASKS}


def test_whether_there_is_something_to_compile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernels, "cache_folder", lambda folder: tmp_path)
    monkeypatch.setattr(kernels, "COMPILED", True)
    assert kernels.to_be_compiled()
    (tmp_path / "heuristic").mkdir()
    (tmp_path / "heuristic/meals.nbi").touch()
    assert not kernels.to_be_compiled()
    monkeypatch.setattr(kernels, "COMPILED", False)
    (tmp_path / "heuristic/meals.nbi").unlink()
    assert not kernels.to_be_compiled()


@dataclass(slots=True)
class Shelf:
    number: int
    row: Annotated[Ints, 4]
    table: Annotated[Table, SMALL, 3, 4]
    cube: Annotated[Cube, SMALL, 2, 3, 4]


@dataclass(slots=True)
class Sum:
    before: int
    after: int


def new_shelf() -> Shelf:
    return Shelf(0, [0, 0], [[0]], [[]])


@kernel
def total(shelf: Shelf) -> int:
    return shelf.number + shelf.row[1] + shelf.table[1][2] + shelf.cube[1][1][0]


def test_records_hold_rows_tables_and_cubes() -> None:
    shelf = Shelf(1, [0, -20], [[0, 0, 0], [0, 0, 300]], [[[0], [0]], [[0], [4000]]])
    assert total(record(shelf)) == 4281


def test_rows_of_records_may_be_empty() -> None:
    shelf = record(Shelf(7, [], [[], []], [[], []]))
    assert shelf.number == 7


def test_blank_records_are_apart() -> None:
    first, second = blank_records(new_shelf, 2)
    first.row[1] = 5
    assert (first.row[1], second.row[1], second.number) == (5, 0, 0)


def test_what_is_left_in_records() -> None:
    made = records(Sum, [Sum(1, 0), Sum(2, 0)])
    made[1].after = 3
    assert list(plain(Sum, made)) == [Sum(1, 0), Sum(2, 3)]
    assert list(plain(Sum, records(Sum, []))) == []
