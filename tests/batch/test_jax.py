"""The engine in JAX and the world are the same process, too, on whatever JAX runs on here."""

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
        importlib.util.find_spec("jax") is None, reason="JAX, the extra `gpu`, is not installed"
    ),
]


@pytest.mark.parametrize(
    "name",
    ["synchronous/01", "asynchronous/06", "workshop/02:people", "examples/pancakes", "bolts"],
)
def test_steps_are_the_worlds(name: str) -> None:
    from robotouille.batch import JaxBatch

    world = world_of(name)
    agree(JaxBatch(world, 16), world, 16, 40, seed=2)


def test_it_is_used_as_the_other_engine() -> None:
    from robotouille.batch import JaxBatch

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


def test_masks_of_all_players_and_single_actions() -> None:
    from robotouille.batch import JaxBatch

    batch = JaxBatch(World("multi_agent/01"), 4, seed=3)
    for _ in range(5):
        masks = [np.asarray(batch.masks(player)) for player in batch.players]
        assert np.array_equal(batch.joint_masks(), np.concatenate(masks, axis=1))
        assert batch.valid(batch.random_actions()).all()
        numbers = np.full((4, 2), [5, 7])
        expected = np.stack([masks[0][:, 5], masks[1][:, 7]], axis=1)
        assert np.array_equal(batch.valid(numbers), expected)
        batch.step(batch.random_actions())
    assert not batch.valid(np.full((4, 2), -1)).any()
    for wrong in (np.full((4, 2), 10**6), [[10**6, 0]] * 4, np.zeros((4, 3), dtype=np.int64)):
        with pytest.raises(WrongArgumentError):
            batch.valid(wrong)


def test_the_example_of_the_page() -> None:
    (source,) = blocks("batch.md", "py")
    exec(compile(source, "batch.md", "exec"), {})
