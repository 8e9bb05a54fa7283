"""The fast world and the obvious one are the same process."""

import json
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotouille import Task, load_task
from tests.support.samples import first_quickly
from tests.support.thorough import thorough
from tests.world.differential import WALKS, walk_both
from tests.world.random_tasks import tasks
from tests.world.reference import Reference, ReferenceState
from tests.world.regenerate import GOLDEN


@pytest.mark.parametrize("seed", first_quickly([1, 2]))
@pytest.mark.parametrize(("name", "timing", "steps"), WALKS)
def test_shipped_tasks(name: str, timing: str, steps: int, seed: int) -> None:
    assert walk_both(load_task(name, timing=timing), steps, seed) > steps // 8


@pytest.mark.slow
@thorough(250)
@given(task=tasks(), seed=st.integers(0, 2**16))
def test_random_domains(task: Task, seed: int) -> None:
    walk_both(task, 8, seed)


@pytest.mark.parametrize(
    ("name", "depth"),
    first_quickly([("synchronous/04", 6), ("workshop/01", 5), ("multi_agent/01@2", 1)]),
)
def test_perft(name: str, depth: int) -> None:
    """The golden counts are those of the reference."""
    golden = json.loads((GOLDEN / "perft.json").read_text())[name]
    reference = Reference(load_task(name))
    states = {key(reference.initial): reference.initial}
    for count in golden[: depth + 1]:
        assert len(states) == count
        states = {
            key(after): after
            for state in states.values()
            for joint in product(
                *([(p, c) for c in reference.valid(state, p)] for p in reference.players)
            )
            for after, _ in [reference.step(state, joint)]
        }


def key(state: ReferenceState) -> tuple[object, ...]:
    return frozenset(state.facts), tuple(state.timer_rows()), tuple(sorted(state.created.items()))
