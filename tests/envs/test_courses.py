"""What is played in the batch engine is what is played in the world; here as plain Python."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from robotouille import InapplicableError, RobotouilleError
from robotouille.batch.single_copy import SingleCopy
from robotouille.envs import RobotouilleEnv, RobotouilleParallelEnv, engine, parallel_env
from robotouille.envs.engine.course import BatchCourse
from robotouille.envs.play import WorldCourse
from robotouille.errors import SlotOverflowError
from tests.batch.agreement import world_of
from tests.support.samples import first_quickly

TEAM = "multi_agent/01@2"


@pytest.fixture
def in_the_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "is_compiled", lambda: True)


def some(env: RobotouilleParallelEnv, rng: np.random.Generator) -> dict[str, int | None]:
    """Mostly valid actions, some that are not, some agents left out."""
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


def alike(mine: Any, theirs: Any) -> None:
    """Whether what `reset` or `step` gave is the same, whose arrays are of the same type."""
    assert len(mine) == len(theirs)
    for one, other in zip(mine, theirs, strict=True):
        assert one.keys() == other.keys()
        for agent, found in one.items():
            for name, value in found.items() if isinstance(found, dict) else [("", found)]:
                expected = other[agent][name] if name else other[agent]
                assert type(value) is type(expected)
                assert np.array_equal(value, expected)
                assert getattr(value, "dtype", None) == getattr(expected, "dtype", None)


@pytest.mark.parametrize("task", first_quickly([TEAM, "multi_agent/07@3", "multi_agent/10@4"], 2))
def test_the_engine_plays_as_the_world_does(task: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "is_compiled", lambda: False)
    slow = parallel_env(task, max_steps=60)
    monkeypatch.setattr(engine, "is_compiled", lambda: True)
    fast = parallel_env(task, max_steps=60)
    rng = np.random.default_rng(5)
    for episode in range(2):
        alike(fast.reset(seed=episode), slow.reset(seed=episode))
        assert isinstance(slow._play._course, WorldCourse)
        assert isinstance(fast._play._course, BatchCourse)
        while slow.agents:
            chosen = some(slow, rng)
            alike(fast.step(chosen), slow.step(chosen))
            assert np.array_equal(fast.state(), slow.state())
            if rng.random() < 0.1:
                assert fast.world_state == slow.world_state
        assert fast.agents == []
        assert fast.world_state.digest == slow.world_state.digest


def test_objects_have_the_names_that_they_have_in_the_world(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`BatchWorld.state` calls created objects by their slots; an environment does not."""
    task = world_of("bolts").task
    slow = RobotouilleEnv(task)
    monkeypatch.setattr(engine, "is_compiled", lambda: True)
    fast = RobotouilleEnv(task)
    fast._play._begin = BatchCourse
    rng = np.random.default_rng(2)
    slow.reset(), fast.reset()
    for _ in range(80):
        mask = slow.action_masks()
        number = int(rng.choice(np.flatnonzero(mask)))
        slow.step(number), fast.step(number)
        assert np.array_equal(fast.action_masks(), slow.action_masks())
    assert fast.state.fact_names() == slow.state.fact_names()
    assert fast.state.digest == slow.state.digest


def test_too_few_slots_are_an_error_and_no_step(in_the_engine: None) -> None:
    env = RobotouilleEnv(world_of("workshop/01").task, slots={"bolt": 1})
    env._play._begin = BatchCourse
    env.reset()
    rng = np.random.default_rng(1)
    with pytest.raises(SlotOverflowError, match="'bolt'"):
        for _ in range(2_000):
            mask, state = env.action_masks(), env.state
            env.step(int(rng.choice(np.flatnonzero(mask))))
            if env._play.over:
                env.reset()
    assert np.array_equal(env.action_masks(), mask)
    assert env.state == state
    assert np.array_equal(env._play._course._look(False).vector, state.vector())


def test_a_step_for_which_the_engine_lacks_a_slot_too_early_is_taken_in_the_world(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Which is rare: here it is so in each step."""
    monkeypatch.setattr(engine, "is_compiled", lambda: False)
    slow = parallel_env(TEAM, max_steps=25)
    monkeypatch.setattr(engine, "is_compiled", lambda: True)
    fast = parallel_env(TEAM, max_steps=25)
    step = SingleCopy.step
    monkeypatch.setattr(SingleCopy, "step", lambda copy, numbers: (*step(copy, numbers)[:2], True))
    rng = np.random.default_rng(6)
    alike(fast.reset(), slow.reset())
    while slow.agents:
        chosen = some(slow, rng)
        alike(fast.step(chosen), slow.step(chosen))
    assert fast.world_state == slow.world_state


def test_what_is_not_valid_is_refused_as_in_the_world(in_the_engine: None) -> None:
    env = parallel_env(TEAM, invalid="raise")
    with pytest.raises(RobotouilleError, match="no episode has begun"):
        env.state()
    _, infos = env.reset()
    wrong = int(np.flatnonzero(infos["robot2"]["action_mask"] == 0)[0])
    before = env.world_state
    with pytest.raises(InapplicableError):
        env.step({"robot1": 0, "robot2": wrong})
    assert env.world_state == before


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_go_on_alike(twin: Callable[[Any], Any], in_the_engine: None) -> None:
    env, rng = parallel_env(TEAM), np.random.default_rng(1)
    env.reset(seed=3)
    for _ in range(6):
        chosen = some(env, rng)
        other = twin(env)
        alike(other.step(chosen), env.step(chosen))
        assert isinstance(other._play._course, BatchCourse)
        assert other.world_state == env.world_state
    assert len(pickle.dumps(env)) < 30_000


def test_the_world_plays_where_states_are_asked_for(in_the_engine: None) -> None:
    for env in (
        parallel_env(TEAM, observation="text"),
        parallel_env(TEAM, reward="shaped", potential=lambda state: 0.0),
        RobotouilleEnv("synchronous/01"),
    ):
        env.reset()
        assert isinstance(env._play._course, WorldCourse)


def test_instances_are_of_one_size(in_the_engine: None) -> None:
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
def test_one_player_needs_no_compiler() -> None:
    """Which takes memory and time in each process."""
    program = (
        "import sys, robotouille.envs\n"
        "robotouille.envs.RobotouilleEnv('synchronous/01').reset()\n"
        "assert 'numba' not in sys.modules"
    )
    environment = {k: v for k, v in os.environ.items() if k != "ROBOTOUILLE_COMPILE"}
    subprocess.run([sys.executable, "-c", program], env=environment, check=True)


def test_threads_play_side_by_side(in_the_engine: None) -> None:
    """Each with environments of its own, all of one task."""

    def played(seed: int) -> list[bytes]:
        env, rng = parallel_env(TEAM, max_steps=10**6), np.random.default_rng(seed)
        env.reset()
        course = []
        for _ in range(60):
            env.step(some(env, rng))
            course.append(env.state().tobytes())
        return course

    expected = [played(seed) for seed in range(4)]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(played, range(4))) == expected
