"""The PettingZoo environments: API, seeds, and agreement with the world."""

from __future__ import annotations

import warnings

import numpy as np
import pettingzoo
import pytest

from robotouille import InapplicableError, World, WrongArgumentError, task_names
from robotouille.envs import RobotouilleParallelEnv, aec_env, env_id, parallel_env
from tests.support.samples import quick_sample

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test

TASKS = [name for name in task_names() if not name.startswith("examples/")]
pytestmark = pytest.mark.filterwarnings("ignore:We recommend agents to be named")
"""Agents are called as players are, so that texts and masks speak of the same ones."""


@pytest.mark.parametrize("name", quick_sample(TASKS, 2))
def test_api_and_seed_tests_pass_on_every_task(name: str) -> None:
    parallel_api_test(parallel_env(name, max_steps=25), num_cycles=30)
    parallel_seed_test(lambda: parallel_env(name, max_steps=25), num_cycles=10)
    api_test(aec_env(name, max_steps=8), num_cycles=20)
    seed_test(lambda: aec_env(name, max_steps=8), num_cycles=10)


@pytest.mark.parametrize("observation", ["graph", "text"])
def test_api_tests_pass_for_every_observation(observation: str) -> None:
    parallel_api_test(parallel_env("multi_agent/01@2", observation=observation), num_cycles=20)


@pytest.mark.parametrize("name", quick_sample(["multi_agent/01@3", "multi_agent/07@2"]))
def test_environment_matches_the_world(name: str) -> None:
    env, world, rng = parallel_env(name), World(name), np.random.default_rng(4)
    seen, infos = env.reset(seed=1)
    state = world.initial
    for _ in range(80):
        for player in world.players:
            assert np.array_equal(seen[player][: -len(world.players)], state.vector())
            assert np.array_equal(infos[player]["action_mask"], state.mask(player))
            assert np.array_equal(env.action_mask(player), state.mask(player))
        chosen = {p: int(rng.choice(np.flatnonzero(infos[p]["action_mask"]))) for p in env.agents}
        step = state.step([state.action(p, chosen[p]) for p in world.players])
        seen, rewards, reached, truncated, infos = env.step(chosen)
        assert set(rewards.values()) == {step.reward}
        assert set(reached.values()) == {step.goal_reached}
        assert set(truncated.values()) == {False}
        for player, attempt in zip(world.players, step.attempts, strict=True):
            assert infos[player]["valid"] == attempt.applied
        state = step.state
        assert np.array_equal(env.state(), state.vector())


def test_missing_agents_do_nothing() -> None:
    env = parallel_env("multi_agent/01@2")
    _, infos = env.reset()
    number = int(np.flatnonzero(infos["robot1"]["action_mask"])[0])
    before = env.world_state
    infos = env.step({"robot1": number})[4]
    assert env.world_state == before.step(before.action("robot1", number)).state
    assert infos["robot2"]["valid"]
    assert env.step({"robot1": None, "robot2": -1})[4]["robot2"]["valid"]


def test_invalid_actions() -> None:
    env = parallel_env("multi_agent/01@2", invalid="raise")
    _, infos = env.reset()
    wrong = int(np.flatnonzero(infos["robot2"]["action_mask"] == 0)[0])
    with pytest.raises(InapplicableError):
        env.step({"robot2": wrong})
    with pytest.raises(WrongArgumentError, match="no agent 'robot9'"):
        env.step({"robot9": 0})
    with pytest.raises(WrongArgumentError, match="robot2 has"):
        env.step({"robot2": 10**6})


def test_no_agents_after_the_episode() -> None:
    env = parallel_env("multi_agent/01@2", max_steps=2)
    env.reset()
    env.step({})
    truncated = env.step({})[3]
    assert truncated == {"robot1": True, "robot2": True}
    assert env.agents == []
    assert env.step({}) == ({}, {}, {}, {}, {})


@pytest.mark.skipif(not hasattr(pettingzoo, "make"), reason="an older PettingZoo has no names")
def test_environment_is_made_by_name() -> None:
    env = pettingzoo.make("parallel", env_id("multi_agent/01_lettuce_burger"))
    assert isinstance(env, RobotouilleParallelEnv)
