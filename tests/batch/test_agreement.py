"""The batch engine takes the same steps as the world."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import Task, World, task_names
from robotouille.batch import BatchWorld
from tests.batch.agreement import agree, world_of
from tests.support.samples import quick_sample
from tests.support.thorough import thorough
from tests.world.random_tasks import tasks

SMALL = [
    "synchronous/01", "asynchronous/06", "multi_agent/01@4:people", "workshop/01",
    "workshop/02:people", "examples/pancakes", "bolts",
]  # fmt: skip
SEED = int(os.environ.get("GITHUB_SHA", "0")[:8], 16)
"""In continuous integration, each commit has another seed."""


@pytest.mark.parametrize("name", SMALL)
def test_small_tasks_agree(name: str) -> None:
    world = world_of(name)
    agree(BatchWorld(world, 3), world, 3, 100, SEED)


@pytest.mark.slow
@pytest.mark.parametrize("name", quick_sample([*task_names(), "workshop/02"]))
def test_all_tasks_agree(name: str) -> None:
    world = world_of(name)
    agree(BatchWorld(world, 3), world, 3, 60, SEED)


@pytest.mark.slow
@thorough(150)
@given(task=tasks(), seed=st.integers(0, 2**16))
def test_random_domains_agree(task: Task, seed: int) -> None:
    world = World(task)
    agree(BatchWorld(world, 2), world, 2, 12, seed)


@pytest.mark.process
@pytest.mark.slow
def test_compiled_kernels_agree() -> None:
    """Compare 20,000 steps of compiled kernels; `make nightly` compares ten million."""
    pytest.importorskip("numba")
    environment = {k: v for k, v in os.environ.items() if k != "ROBOTOUILLE_COMPILE"}
    program = [sys.executable, "-m", "tests.programs.batch_agreement"]
    options = ["--steps", "20000", "--seed", str(SEED), *SMALL]
    result = subprocess.run(
        [*program, *options], env=environment, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    report = json.loads(result.stdout.splitlines()[-1])
    assert report["compiled"] and report["steps"] >= 20_000
