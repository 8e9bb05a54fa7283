"""The batch engine agrees with the world, also along plans."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import Task, World, load_task, task_names
from robotouille.batch import BatchWorld
from robotouille.installation import data_folder
from robotouille.planning.plan import read_plan
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


@pytest.mark.parametrize("name", quick_sample(SMALL, 2))
def test_small_tasks_agree(name: str) -> None:
    world = world_of(name)
    agree(BatchWorld(world, 3), world, 3, 100, SEED)


WITH_GOAL = [name for name in task_names() if not name.startswith("shifts/")]


@pytest.mark.slow
@pytest.mark.parametrize("name", quick_sample([*WITH_GOAL, "workshop/02"], nightly=12))
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


PLANS = sorted(
    str(path.relative_to(data_folder("problems")).with_suffix(""))
    for folder in ("synchronous", "asynchronous", "multi_agent")
    for path in (data_folder("problems") / folder).glob("*.plan")
    if "@3" not in path.name and "@4" not in path.name
)


@pytest.mark.parametrize("name", quick_sample(PLANS))
def test_plans_reach_the_goal(name: str) -> None:
    world = World(load_task(name))
    batch = BatchWorld(world, 3)
    state, states = world.initial, []
    plan = (data_folder("problems") / f"{name}.plan").read_text(encoding="utf-8")
    for joint in [*read_plan(plan, world), ()]:
        in_seats = {
            player: action
            for player in world.players
            for action in joint
            if action.player in (player, None)
        }
        batch.set_state(0, state)
        numbers = np.full((3, len(world.players)), -1)
        for player, action in in_seats.items():
            seat = world.players.index(player)
            numbers[0, seat] = world.encoding.number(state.facts, player, action)
        result, expected = batch.step(numbers), state.step(in_seats)
        assert result.terminated[0] == expected.goal_reached
        assert np.array_equal(batch.vectors()[0], expected.state.vector())
        state = state.step(list(joint)).state
        states.append(state)
    assert result.terminated[0]
    agree(batch, world, 3, 10, seed=1, states=states[-3:])
