"""Many copies in one process, and in several."""

from __future__ import annotations

from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv

from robotouille import RobotouilleError, WrongArgumentError, load_task
from robotouille.envs import RobotouilleEnv, RobotouilleVectorEnv

ONE, TEAM = "synchronous/01", "multi_agent/01@2"


def choices(info: dict, rng: np.random.Generator) -> np.ndarray:
    return np.array([rng.choice(np.flatnonzero(mask)) for mask in info["action_mask"]])


def run(envs, steps: int = 40) -> list[tuple]:
    """A course of random valid actions."""
    rng = np.random.default_rng(7)
    seen, info = envs.reset(seed=5)
    course = [(seen.copy(), info["action_mask"])]
    for _ in range(steps):
        seen, reward, reached, truncated, info = envs.step(choices(info, rng))
        course.append((seen.copy(), info["action_mask"], reward, reached, truncated))
    return course


def same(one: list[tuple], other: list[tuple]) -> None:
    for mine, theirs in zip(one, other, strict=True):
        for a, b in zip(mine, theirs, strict=True):
            assert np.array_equal(a, b)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_it_does_what_gymnasiums_own_vectors_do(mode: AutoresetMode) -> None:
    make = partial(RobotouilleEnv, ONE, max_steps=9)
    theirs = SyncVectorEnv([make] * 3, autoreset_mode=mode)
    ours = RobotouilleVectorEnv(ONE, 3, max_steps=9, autoreset_mode=mode)
    same(run(ours), run(theirs))
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space


def test_the_last_of_an_episode_is_told() -> None:
    envs = RobotouilleVectorEnv(ONE, 2, max_steps=2, autoreset_mode="SameStep")
    _, info = envs.reset()
    idle = np.array([np.flatnonzero(mask)[-1] for mask in info["action_mask"]])
    envs.step(idle)
    seen, _, _, truncated, info = envs.step(idle)
    assert truncated.all() and info["_final_obs"].all()
    assert info["final_obs"][0] in envs.single_observation_space
    assert seen in envs.observation_space


def test_seeds_are_those_of_the_copies() -> None:
    """With instances to choose from, the only thing that is random."""
    names = load_task(ONE).instances()[:2]

    def played(envs: RobotouilleVectorEnv) -> list[str]:
        return [play.view.world.task.name for play in envs._plays]

    for copies in (1, 3):
        one, two = (RobotouilleVectorEnv(ONE, copies, instances=names) for _ in range(2))
        with pytest.raises(RobotouilleError, match="no episode has begun"):
            one.step(np.zeros(copies, dtype=int))
        courses = []
        for envs in (one, two):
            envs.reset(seed=4)
            first = played(envs)
            courses.append([first, *(envs.reset() and played(envs) for _ in range(6))])
        assert courses[0] == courses[1]
        assert len({name for each in courses[0] for name in each}) > 1
        two.reset(seed=[4 + i for i in range(copies)])
        assert played(two) == courses[0][0]


def test_teams() -> None:
    envs = RobotouilleVectorEnv(TEAM, 2, max_steps=5)
    _, info = envs.reset(seed=1)
    sizes = envs.single_action_space.nvec
    rng = np.random.default_rng(1)
    for _ in range(12):
        parts = [np.split(mask, np.cumsum(sizes)[:-1]) for mask in info["action_mask"]]
        chosen = [[rng.choice(np.flatnonzero(part)) for part in each] for each in parts]
        seen, _, _, _, info = envs.step(np.array(chosen))
        assert seen.shape == envs.observation_space.shape
    assert np.array_equal(envs.action_masks(), info["action_mask"])


def test_ten_thousand_fit_into_a_process() -> None:
    envs = RobotouilleVectorEnv(ONE, 10_000)
    _, info = envs.reset(seed=1)
    actions = info["action_mask"].argmax(axis=1)
    seen, _, _, _, info = envs.step(actions)
    assert len(np.unique(seen, axis=0)) == 1 and info["valid"].all()
    assert len({id(play.view) for play in envs._plays}) == 1


def test_it_is_made_by_name() -> None:
    name = "robotouille/synchronous-01-v0"
    envs = gymnasium.make_vec(name, 4, vectorization_mode="vector_entry_point")
    assert isinstance(envs, RobotouilleVectorEnv)
    assert envs.num_envs == 4


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"num_envs": 0}, "num_envs"),
        ({"autoreset_mode": "Disabled"}, "autoreset_mode"),
        ({"observation": "text"}, "observation: copies in one process see vectors"),
    ],
)
def test_options_that_there_are_not(options: dict, words: str) -> None:
    with pytest.raises(WrongArgumentError, match=words):
        RobotouilleVectorEnv(ONE, **options)


@pytest.mark.process
@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_processes_agree(context: str) -> None:
    make = partial(RobotouilleEnv, ONE, max_steps=9)
    envs = AsyncVectorEnv([make] * 2, context=context)
    try:
        found = run(envs, 20)
    finally:
        envs.close()
    same(found, run(SyncVectorEnv([make] * 2), 20))


@pytest.mark.process
@pytest.mark.parametrize("observation", ["text", "graph"])
def test_other_processes_see_words_and_graphs(observation: str) -> None:
    make = partial(RobotouilleEnv, ONE, observation=observation)
    envs = AsyncVectorEnv([make] * 2, context="spawn", shared_memory=False)
    try:
        seen, _ = envs.reset(seed=1)
        assert len(seen) == 2
        assert str(seen[0]) == str(make().reset()[0])
    finally:
        envs.close()
