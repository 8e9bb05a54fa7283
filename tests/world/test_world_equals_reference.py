"""The fast world and the obvious one are the same process."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from robotouille import Task, World, load_task
from robotouille.domain.schema import Creation, Deletion
from tests.world.differential import walk_both
from tests.world.random_tasks import tasks

WALKS = [
    ("synchronous/01", "benchmark", 60),
    ("synchronous/02", "people", 40),
    ("asynchronous/05", "benchmark", 40),
    ("asynchronous/06", "benchmark", 150),
    ("multi_agent/01@2", "benchmark", 80),
    ("multi_agent/01@4", "benchmark", 60),
    ("multi_agent/01@4", "people", 60),
    ("multi_agent/07", "benchmark", 40),
    ("workshop/01", "benchmark", 120),
    ("workshop/02", "benchmark", 120),
    ("workshop/02", "people", 80),
]


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("name", "timing", "steps"), WALKS)
def test_shipped_tasks(name: str, timing: str, steps: int, seed: int) -> None:
    assert walk_both(load_task(name, timing=timing), steps, seed) > steps // 8


@settings(
    max_examples=250,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
)
@given(task=tasks(), seed=st.integers(0, 2**16))
def test_random_domains(task: Task, seed: int) -> None:
    walk_both(task, 8, seed)
