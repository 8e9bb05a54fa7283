"""Agreement of the batch engine, here in plain Python, with the world."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from robotouille.envs import RobotouilleEnv, RobotouilleParallelEnv, parallel_env
from robotouille.envs import rules as engine
from robotouille.envs.compiled_engine import BatchRollout
from robotouille.envs.play import WorldRollout
from tests.batch.agreement import world_of
from tests.envs.agreement import alike
from tests.support.samples import quick_sample

TEAM = "multi_agent/01@2"


def some(env: RobotouilleParallelEnv, rng: np.random.Generator) -> dict[str, int | None]:
    """Return mostly valid actions, some invalid ones, and some missing agents."""
    chosen: dict[str, int | None] = {}
    for agent in env.agents:
        mask, draw = env.action_mask(agent), rng.random()
        if draw < 0.1:
            chosen[agent] = None
        elif draw < 0.2 or not mask.any():
            chosen[agent] = int(rng.integers(len(mask)))
        else:
            chosen[agent] = int(rng.choice(np.flatnonzero(mask)))
    return chosen


@pytest.mark.parametrize("task", quick_sample([TEAM, "multi_agent/07@3", "multi_agent/10@4"]))
def test_engine_matches_the_world(task: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "is_compiled", lambda: False)
    slow = parallel_env(task, max_steps=30)
    monkeypatch.setattr(engine, "is_compiled", lambda: True)
    fast = parallel_env(task, max_steps=30)
    rng = np.random.default_rng(5)
    for episode in range(2):
        alike(fast.reset(seed=episode), slow.reset(seed=episode))
        assert isinstance(slow._play._rollout, WorldRollout)
        assert isinstance(fast._play._rollout, BatchRollout)
        while slow.agents:
            chosen = some(slow, rng)
            alike(fast.step(chosen), slow.step(chosen))
            assert np.array_equal(fast.state(), slow.state())
            if rng.random() < 0.1:
                assert fast.world_state == slow.world_state
        assert fast.agents == []
        assert fast.world_state.digest == slow.world_state.digest


def test_created_objects_have_the_worlds_names(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    task = world_of("bolts").task
    slow = RobotouilleEnv(task)
    monkeypatch.setattr(engine, "is_compiled", lambda: True)
    fast = RobotouilleEnv(task)
    fast._play._begin = BatchRollout
    rng = np.random.default_rng(2)
    slow.reset(), fast.reset()
    for _ in range(80):
        mask = slow.action_masks()
        number = int(rng.choice(np.flatnonzero(mask)))
        slow.step(number), fast.step(number)
        assert np.array_equal(fast.action_masks(), slow.action_masks())
    assert fast.state.fact_names() == slow.state.fact_names()
    assert fast.state.digest == slow.state.digest


@pytest.mark.slow
def test_instances_have_equal_sizes(in_the_engine: None) -> None:
    from robotouille import load_task

    names = load_task(TEAM).instances()[:2]
    env = parallel_env(TEAM, instances=names, max_steps=4)
    for name in (TEAM, *names):
        observations, infos = env.reset(options={"instance": load_task(name).name})
        assert observations["robot1"] in env.observation_space("robot1")
        for agent in env.agents:
            assert len(infos[agent]["action_mask"]) == env.action_space(agent).n
        while env.agents:
            env.step(
                {agent: int(np.flatnonzero(env.action_mask(agent))[0]) for agent in env.agents}
            )


@pytest.mark.process
def test_single_player_needs_no_compiler() -> None:
    program = (
        "import sys, robotouille.envs\n"
        "robotouille.envs.RobotouilleEnv('synchronous/01').reset()\n"
        "assert 'numba' not in sys.modules"
    )
    environment = {k: v for k, v in os.environ.items() if k != "ROBOTOUILLE_COMPILE"}
    subprocess.run([sys.executable, "-c", program], env=environment, check=True)


@pytest.mark.slow
def test_threads_play_in_parallel(in_the_engine: None) -> None:
    def played(seed: int) -> list[bytes]:
        env, rng = parallel_env(TEAM, max_steps=10**6), np.random.default_rng(seed)
        env.reset()
        rollout = []
        for _ in range(25):
            env.step(some(env, rng))
            rollout.append(env.state().tobytes())
        return rollout

    expected = [played(seed) for seed in range(4)]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(played, range(4))) == expected
