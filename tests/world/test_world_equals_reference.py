"""The fast world and the obvious one are the same process."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import Task, load_task
from tests.support.samples import quick_sample
from tests.support.thorough import thorough
from tests.world.differential import WALKS, walk_both
from tests.world.random_tasks import tasks


@pytest.mark.parametrize("seed", quick_sample([1, 2]))
@pytest.mark.parametrize(("name", "timing", "steps"), WALKS)
def test_shipped_tasks_equal_reference(name: str, timing: str, steps: int, seed: int) -> None:
    assert walk_both(load_task(name, timing=timing), steps, seed) > steps // 8


@pytest.mark.slow
@thorough(250)
@given(task=tasks(), seed=st.integers(0, 2**16))
def test_random_domains_equal_reference(task: Task, seed: int) -> None:
    walk_both(task, 8, seed)
