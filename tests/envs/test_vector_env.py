"""Many copies in one process, and in several processes."""

from __future__ import annotations

import copy
import pickle
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import MultiDiscrete
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv

from robotouille import InapplicableError, RobotouilleError, World, WrongArgumentError, load_task
from robotouille.envs import RobotouilleEnv, RobotouilleVectorEnv
from robotouille.envs import rules as engine
from robotouille.envs.compiled_engine import BatchCopies
from robotouille.envs.vector_env import PlayedCopies
from robotouille.errors import SlotOverflowError
from robotouille.planning import solve
from robotouille.world.sight import Sight
from tests.batch.agreement import world_of
from tests.envs.agreement import alike
from tests.support.samples import quick_sample

ONE, TEAM = "synchronous/01", "multi_agent/01@2"


def choices(info: dict, rng: np.random.Generator) -> np.ndarray:
    return np.array([rng.choice(np.flatnonzero(mask)) for mask in info["action_mask"]])


def run(envs, steps: int = 40) -> list[tuple]:
    """Return a rollout of random valid actions."""
    rng = np.random.default_rng(7)
    seen, info = envs.reset(seed=5)
    rollout = [(seen.copy(), info["action_mask"])]
    for _ in range(steps):
        seen, reward, reached, truncated, info = envs.step(choices(info, rng))
        rollout.append((seen.copy(), info["action_mask"], reward, reached, truncated))
    return rollout


def same(one: list[tuple], other: list[tuple]) -> None:
    for mine, theirs in zip(one, other, strict=True):
        for a, b in zip(mine, theirs, strict=True):
            assert np.array_equal(a, b)


MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP]


def some(envs, info: dict, rng: np.random.Generator) -> np.ndarray:
    """Return mostly valid actions."""
    space = envs.single_action_space
    sizes = np.atleast_1d(space.nvec if isinstance(space, MultiDiscrete) else space.n)
    ends = np.cumsum(sizes)[:-1]
    chosen = []
    for mask in info["action_mask"]:
        for part in np.split(mask, ends):
            valid = rng.random() < 0.9 and part.any()
            chosen.append(rng.choice(np.flatnonzero(part) if valid else np.arange(-1, len(part))))
    return np.array(chosen).reshape(envs.action_space.shape)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    "task", quick_sample([ONE, TEAM, "asynchronous/06", "multi_agent/01@3"], 2)
)
def test_engine_matches_copies_played_one_by_one(
    task: str, mode: AutoresetMode, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "is_compiled", lambda: False)
    slow = RobotouilleVectorEnv(task, 4, max_steps=30, autoreset_mode=mode)
    monkeypatch.setattr(engine, "is_compiled", lambda: True)
    fast = RobotouilleVectorEnv(task, 4, max_steps=30, autoreset_mode=mode)
    assert isinstance(slow._copies, PlayedCopies)
    assert isinstance(fast._copies, BatchCopies)
    assert fast.action_space == slow.action_space
    assert fast.observation_space == slow.observation_space
    rng = np.random.default_rng(8)
    found, expected = fast.reset(seed=1), slow.reset(seed=1)
    for _ in range(80):
        alike(found, expected)
        actions = some(slow, expected[-1], rng)
        found, expected = fast.step(actions), slow.step(actions)
    assert expected[-1]["valid"].shape == (4,)


@pytest.mark.parametrize("options", [{"goal": True}, {"goal": True, "sight": Sight(1)}])
def test_goal_and_sight_are_those_of_single_environments(options: dict[str, Any]) -> None:
    envs = RobotouilleVectorEnv(ONE, 2, max_steps=9, **options)
    make = partial(RobotouilleEnv, ONE, max_steps=9, **options)
    assert envs.single_observation_space == make().observation_space
    assert envs.columns == make().columns
    same(run(copy.deepcopy(envs), 20), run(SyncVectorEnv([make] * 2), 20))


def test_engine_reaches_goals(in_the_engine: None) -> None:
    envs = RobotouilleVectorEnv(ONE, 2, autoreset_mode="SameStep")
    envs.reset()
    plan = solve(World(ONE)).plan
    assert plan is not None
    env = RobotouilleEnv(ONE)
    env.reset()
    idle = int(np.flatnonzero(env.action_masks())[-1])
    for (action,) in plan:
        number = env.state.action_number(action)
        env.step(number)
        _, rewards, reached, _, info = envs.step([number, idle])
    assert rewards.tolist() == [1.0, 0.0]
    assert reached.tolist() == info["_final_obs"].tolist() == [True, False]
    assert np.array_equal(info["final_obs"][0], env.state.vector())


def test_engine_rejects_invalid_actions(in_the_engine: None) -> None:
    envs = RobotouilleVectorEnv(TEAM, 2, invalid="raise")
    _, info = envs.reset()
    first = info["action_mask"].copy()
    wrong = int(np.flatnonzero(info["action_mask"][0][: envs.single_action_space.nvec[0]] == 0)[0])
    with pytest.raises(InapplicableError):
        envs.step(np.array([[wrong, 0], [wrong, 0]]))
    for number in (-2, 10**6):
        with pytest.raises(WrongArgumentError, match=f"robot2 has .* found number {number}"):
            envs.step(np.array([[0, 0], [0, number]]))
    assert np.array_equal(envs.action_masks(), first)
    assert envs.step(np.full((2, 2), -1))[-1]["valid"].all()


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(
    "actions", [np.zeros(3, int), np.zeros((2, 2), int), np.zeros(2), np.full(2, np.nan), "ab"]
)
def test_wrong_actions_are_rejected(
    actions: object, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "is_compiled", lambda: compiled)
    envs = RobotouilleVectorEnv(ONE, 2)
    envs.reset()
    with pytest.raises(WrongArgumentError, match=r"expected integers of shape \(2,\)"):
        envs.step(actions)


@pytest.mark.slow
def test_overflow_is_an_error_and_changes_nothing(in_the_engine: None) -> None:
    task = world_of("workshop/01").task
    envs = RobotouilleVectorEnv(task, 30, slots={"bolt": 1})
    envs.reset()
    rng = np.random.default_rng(1)
    with pytest.raises(SlotOverflowError, match="'bolt'"):
        for _ in range(200):
            before = envs.action_masks()
            envs.step(some(envs, {"action_mask": before}, rng))
    assert np.array_equal(envs.action_masks(), before)


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda envs: pickle.loads(pickle.dumps(envs))])
def test_engine_can_be_copied(twin: Any, in_the_engine: None) -> None:
    envs, rng = RobotouilleVectorEnv(ONE, 3, max_steps=7), np.random.default_rng(1)
    _, info = envs.reset(seed=2)
    for _ in range(5):
        info = envs.step(choices(info, rng))[-1]
    other = twin(envs)
    for _ in range(6):
        actions = choices(info, rng)
        found, expected = other.step(actions), envs.step(actions)
        alike(found, expected)
        info = expected[-1]


@pytest.mark.parametrize("mode", MODES)
def test_matches_gymnasiums_vector_environment(mode: AutoresetMode) -> None:
    make = partial(RobotouilleEnv, ONE, max_steps=9)
    theirs = SyncVectorEnv([make] * 3, autoreset_mode=mode)
    ours = RobotouilleVectorEnv(ONE, 3, max_steps=9, autoreset_mode=mode)
    same(run(ours), run(theirs))
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space


def test_final_observation_is_reported() -> None:
    envs = RobotouilleVectorEnv(ONE, 2, max_steps=2, autoreset_mode="SameStep")
    _, info = envs.reset()
    idle = np.array([np.flatnonzero(mask)[-1] for mask in info["action_mask"]])
    envs.step(idle)
    seen, _, _, truncated, info = envs.step(idle)
    assert truncated.all() and info["_final_obs"].all()
    assert info["final_obs"][0] in envs.single_observation_space
    assert seen in envs.observation_space


def test_copies_are_seeded_in_order() -> None:
    names = load_task(ONE).instances()[:2]

    def played(envs: RobotouilleVectorEnv) -> list[str]:
        assert isinstance(envs._copies, PlayedCopies)
        return [play.view.world.task.name for play in envs._copies.plays]

    for number in (1, 3):
        one, two = (RobotouilleVectorEnv(ONE, number, instances=names) for _ in range(2))
        with pytest.raises(RobotouilleError, match="no episode has begun"):
            one.step(np.zeros(number, dtype=int))
        rollouts = []
        for envs in (one, two):
            envs.reset(seed=4)
            first = played(envs)
            rollouts.append([first, *(envs.reset() and played(envs) for _ in range(6))])
        assert rollouts[0] == rollouts[1]
        assert len({name for each in rollouts[0] for name in each}) > 1
        with pytest.raises(WrongArgumentError, match=f"seed: expected {number}"):
            two.reset(seed=[1] * (number + 1))
        two.reset(seed=[4 + i for i in range(number)])
        assert played(two) == rollouts[0][0]


@pytest.mark.slow
@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_ten_thousand_copies_fit_into_a_process(
    compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "is_compiled", lambda: compiled)
    envs = RobotouilleVectorEnv(ONE, 10_000)
    _, info = envs.reset(seed=1)
    actions = info["action_mask"].argmax(axis=1)
    seen, _, _, _, info = envs.step(actions)
    assert len(np.unique(seen, axis=0)) == 1 and info["valid"].all()


def test_shaped_rewards_equal_those_of_one_environment() -> None:
    env, envs = RobotouilleEnv(ONE, reward="shaped"), RobotouilleVectorEnv(ONE, 2, reward="shaped")
    env.reset(seed=1)
    _, info = envs.reset(seed=1)
    actions = info["action_mask"].argmax(axis=1)
    expected = [env.step(int(actions[0]))[1]] * 2
    for twin in (pickle.loads(pickle.dumps(envs)), copy.deepcopy(envs), envs):
        assert twin.step(actions)[1].tolist() == expected


def test_environment_is_made_by_name() -> None:
    name = "robotouille/synchronous-01-v0"
    envs = gymnasium.make_vec(name, 4, vectorization_mode="vector_entry_point")
    assert isinstance(envs, RobotouilleVectorEnv)
    assert envs.num_envs == 4


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"num_envs": 0}, "num_envs"),
        ({"autoreset_mode": "Disabled"}, "autoreset_mode"),
        ({"observation": "text"}, "observation: copies in one process have vectors"),
    ],
)
def test_invalid_options_are_rejected(options: dict, words: str) -> None:
    with pytest.raises(WrongArgumentError, match=words):
        RobotouilleVectorEnv(ONE, **options)


@pytest.mark.process
@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_process_environments_agree(context: str) -> None:
    make = partial(RobotouilleEnv, ONE, max_steps=9)
    envs = AsyncVectorEnv([make] * 2, context=context)
    try:
        found = run(envs, 20)
    finally:
        envs.close()
    same(found, run(SyncVectorEnv([make] * 2), 20))


@pytest.mark.process
@pytest.mark.parametrize("observation", ["text", "graph"])
def test_text_and_graphs_in_other_processes(observation: str) -> None:
    make = partial(RobotouilleEnv, ONE, observation=observation)
    envs = AsyncVectorEnv([make] * 2, context="spawn", shared_memory=False)
    try:
        seen, _ = envs.reset(seed=1)
        assert len(seen) == 2
        assert str(seen[0]) == str(make().reset()[0])
    finally:
        envs.close()
