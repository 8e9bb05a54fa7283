"""The JAX engine takes the same steps as the world, on any device that JAX finds."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from robotouille import RobotouilleError, World, WrongArgumentError
from robotouille.planning.policies.planner_policy import PlannerOptions
from robotouille.planning.policies.shift_policy import ShiftPolicy
from tests.batch.agreement import agree, world_of
from tests.support.pages import blocks
from tests.support.shifts import file_of, term

ALONE = PlannerOptions(alone=True)

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


@pytest.mark.parametrize("name", ["shifts/01_sandwich_bar@1", "shifts/05_clean_plates@1"])
def test_jax_steps_equal_world_steps_of_a_shift(name: str) -> None:
    """A bot serves dishes, which random steps hardly ever do."""
    from robotouille_jax import JaxBatch

    world = World(name)
    batch, policy, state = JaxBatch(world, 12), ShiftPolicy(world, "robot1", ALONE), world.initial
    states = []
    for _ in range(90):
        states.append(state)
        action = policy.act(state)
        number = -1 if action is None else world.encoding.number(state.facts, "robot1", action)
        result, step = batch.step(np.full(12, number)), state.step(action)
        policy.observe([("robot1", a.action, a.applied) for a in step.attempts])
        state = step.state
        assert result.rewards[0] == step.reward
        assert np.array_equal(batch.vectors()[0], state.vector())
    assert state.orders is not None and state.orders.served > 1
    agree(batch, world, 12, 40, seed=3, states=states[::8][:12])


def test_jax_batch_refuses_a_dish_with_a_part_that_no_changing_condition_is_about(
    tmp_path: Path,
) -> None:
    from robotouille_jax import JaxBatch

    problem = file_of()
    toast = [term("item_on", "lettuce", 1, "hatch", 2), term("isbread", "bread", 3)]
    problem["shift"]["menu"]["toast"] = {"goal": toast, "points": 1, "patience": 5}
    path = tmp_path / "toast.json"
    path.write_text(json.dumps(problem))
    with pytest.raises(RobotouilleError, match="toast"):
        JaxBatch(World(f"{path}@1"), 2)


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
