"""The browser client's rules give the same answers as the Python code."""

from __future__ import annotations

import dataclasses
import json
import random
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings

from robotouille import Timing, load_task
from robotouille.domain.derived import fluents
from robotouille.domain.task import Task
from tests.support.node import node
from tests.support.pancakes import pancake_kitchen
from tests.web.vectors import COMPAT, games, published_tasks, shipped_tasks
from tests.world.random_tasks import tasks

PROGRAM = Path(__file__).with_name("rules.mjs")
FEW = (
    ("synchronous/05", 1),
    ("asynchronous/06", 1),
    ("multi_agent/01", 2),
    ("workshop/01", None),
    ("shifts/06", 3),
)
"""Tasks of the quick test, with their seats."""


def compared(lines: Iterator[dict[str, Any]]) -> dict[str, Any]:
    """Compare the answers of Node with those of the lines, and return the counts."""
    program = node()
    with subprocess.Popen(
        [program, str(PROGRAM)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        for line in lines:
            process.stdin.write(json.dumps(line) + "\n")
        output, _ = process.communicate()
    *differences, counts = map(json.loads, output.splitlines())
    assert differences == []
    found: dict[str, Any] = counts
    assert process.returncode == 0
    assert found["differences"] == 0
    return found


@pytest.mark.process
@pytest.mark.smoke
def test_rules_agree_on_a_few_tasks() -> None:
    rng = random.Random(1)
    timings = [*Timing] * len(FEW)
    chosen: Iterator[Task] = (
        load_task(name, seats=seats, timing=timing)
        for (name, seats), timing in zip(FEW, timings, strict=False)
    )
    assert compared(games(chosen, 20, rng, presses=20))["states"] == 20


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_rules_agree_on_all_tasks(seed: int) -> None:
    rng = random.Random(seed)
    assert compared(games(shipped_tasks(rng), 2000, rng))["states"] == 2000


@pytest.mark.process
@pytest.mark.slow
def test_rules_agree_on_random_domains() -> None:
    found: list[Task] = []

    @settings(max_examples=400, database=None, derandomize=True, deadline=None)
    @given(tasks())
    def collect(task: Task) -> None:
        found.append(_with_changing_goal(task))

    collect()
    found.append(pancake_kitchen(batter=4, players=2).task)
    assert compared(games(found, 12 * len(found), random.Random(4)))["states"] > 1000


def _with_changing_goal(task: Task) -> Task:
    """Return a task without goal terms that never change.

    `Goal.holding` ignores the kinds of their objects.
    """
    changing = fluents(task.domain)
    goal = tuple(term for term in task.problem.goal if term.predicate in changing)
    problem = task.problem.model_copy(update={"goal": goal})
    return dataclasses.replace(task, problem=problem)


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.skipif(not COMPAT.is_dir(), reason="the published files are not here")
def test_rules_agree_on_published_tasks() -> None:
    assert compared(games(published_tasks(), 2000, random.Random(3)))["states"] == 2000
