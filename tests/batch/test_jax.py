"""The JAX engine takes the same steps as the world, on any device that JAX finds."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from robotouille import World, WrongArgumentError
from tests.batch.agreement import agree, world_of
from tests.support.pages import blocks

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        importlib.util.find_spec("robotouille_jax") is None,
        reason="robotouille-jax is not installed",
    ),
]


@pytest.mark.parametrize(
    "name",
    ["synchronous/01", "asynchronous/06", "workshop/02:people", "examples/pancakes", "bolts"],
)
def test_jax_steps_equal_world_steps(name: str) -> None:
    from robotouille_jax import JaxBatch

    world = world_of(name)
    agree(JaxBatch(world, 16), world, 16, 40, seed=2)


def test_jax_batch_has_the_methods_of_batch_world() -> None:
    from robotouille_jax import JaxBatch

    world = World("synchronous/01")
    batch = JaxBatch(world, 4, auto_reset=True)
    assert batch.step(batch.random_actions()).applied.all()
    batch.reset(np.array([True, False, False, True]))
    assert batch.state(3) == world.initial
    batch.reset()
    assert np.array_equal(batch.vectors()[1], world.initial.vector())
    with pytest.raises(WrongArgumentError):
        batch.step(np.full(4, 10**6))
    with pytest.raises(WrongArgumentError):
        batch.step(np.zeros(3, dtype=np.int64))


def test_example_in_the_training_page_runs() -> None:
    (source,) = blocks("train.md", "py")
    exec(compile(source, "train.md", "exec"), {})
