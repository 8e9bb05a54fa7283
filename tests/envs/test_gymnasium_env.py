"""The Gymnasium environment: its API, its seeds, its masks, and that it is the world."""

from __future__ import annotations

import copy
import math
import pickle
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from robotouille import (
    InapplicableError,
    RobotouilleError,
    UnknownTaskError,
    World,
    WrongArgumentError,
    WrongWorldError,
    load_task,
    task_names,
)
from robotouille.envs import RobotouilleEnv, env_id, register_envs
from robotouille.planning import solve
from tests.support.samples import first_quickly

TASKS = [name for name in task_names() if not name.startswith("examples/")]
ONE, TEAM = "synchronous/01", "multi_agent/01@3"


def numbers(env: RobotouilleEnv, rng: np.random.Generator):
    """Valid actions at random."""
    mask = env.action_masks()
    if isinstance(env.action_space, gymnasium.spaces.Discrete):
        return int(rng.choice(np.flatnonzero(mask)))
    parts = np.split(mask, np.cumsum(env.action_space.nvec)[:-1])
    return [int(rng.choice(np.flatnonzero(part))) for part in parts]


@pytest.mark.parametrize("name", first_quickly(sorted(TASKS, reverse=True), 2))
def test_the_api_check_passes_on_every_task(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(env_id(name), max_steps=20).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("observation", ["vector", "graph", "text"])
@pytest.mark.parametrize("task", [ONE, TEAM, "asynchronous/07"])
def test_the_api_check_passes_whatever_is_seen(task: str, observation: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = RobotouilleEnv(task, observation=observation, max_steps=20, reward="sparse")
        check_env(env, skip_render_check=True)
        rng = np.random.default_rng(1)
        seen, _ = env.reset(seed=1)
        for _ in range(20):
            assert seen in env.observation_space
            seen = env.step(numbers(env, rng))[0]


@pytest.mark.parametrize("name", [ONE, "asynchronous/07", TEAM])
def test_the_environment_is_the_world(name: str) -> None:
    env, world, rng = RobotouilleEnv(name), World(name), np.random.default_rng(3)
    seen, info = env.reset(seed=5)
    state = world.initial
    for _ in range(120):
        assert np.array_equal(seen, state.vector())
        masks = [state.mask(player) for player in world.players]
        assert np.array_equal(env.action_masks(), np.concatenate(masks))
        chosen = numbers(env, rng)
        each = [chosen] if isinstance(chosen, int) else chosen
        actions = [state.action(p, n) for p, n in zip(world.players, each, strict=True)]
        step = state.step(actions)
        seen, reward, reached, truncated, info = env.step(chosen)
        assert (reward, reached, truncated) == (step.reward, step.goal_reached, False)
        assert info["valid"] == all(attempt.applied for attempt in step.attempts)
        state = step.state


def test_a_plan_reaches_the_goal_and_the_reward() -> None:
    env = RobotouilleEnv(ONE)
    env.reset()
    plan = solve(env.world).plan
    assert plan is not None
    rewards = []
    for (action,) in plan:
        _, reward, reached, truncated, _ = env.step(env.state.action_number(action))
        rewards.append(reward)
    assert rewards == [0.0] * 7 + [1.0]
    assert reached and not truncated
    with pytest.raises(RobotouilleError, match="the episode is over"):
        env.step(0)


def test_an_episode_is_truncated_at_its_budget() -> None:
    env = RobotouilleEnv(ONE, max_steps=3)
    env.reset()
    idle = env.action_masks().nonzero()[0][-1]
    assert [env.step(idle)[2:4] for _ in range(3)] == [
        (False, False),
        (False, False),
        (False, True),
    ]
    with pytest.raises(RobotouilleError, match="over"):
        env.step(idle)


def test_an_invalid_action_changes_nothing_and_costs_a_step() -> None:
    env = RobotouilleEnv(ONE, max_steps=2)
    before, info = env.reset()
    wrong = int(np.flatnonzero(info["action_mask"] == 0)[0])
    seen, reward, _, truncated, info = env.step(wrong)
    assert np.array_equal(seen, before)
    assert (reward, truncated, info["valid"]) == (0.0, False, False)
    assert env.step(wrong)[3]


def test_an_invalid_action_is_an_error_where_that_is_wanted() -> None:
    env = RobotouilleEnv(ONE, max_steps=2, invalid="raise")
    _, info = env.reset()
    wrong = int(np.flatnonzero(info["action_mask"] == 0)[0])
    state = env.state
    for _ in range(5):
        with pytest.raises(InapplicableError):
            env.step(wrong)
    assert env.state is state


def test_actions_that_there_are_not() -> None:
    env = RobotouilleEnv(ONE)
    with pytest.raises(RobotouilleError, match="no episode has begun"):
        env.step(0)
    env.reset()
    for wrong in (-1, env.action_space.n, 10**9):
        with pytest.raises(WrongArgumentError, match="found number"):
            env.step(wrong)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"weight": math.nan}, "weight: expected a number, found nan"),
        ({"weight": math.inf}, "weight"),
        ({"gamma": 0.0}, "gamma: expected above 0"),
        ({"gamma": math.nan}, "gamma"),
        ({"max_steps": 0}, "max_steps: expected 1 or more"),
        ({"max_steps": 2.5}, "max_steps: expected an integer"),
        ({"observation": "pixels"}, "observation: expected one of 'vector', 'graph', 'text'"),
        ({"reward": "dense"}, "reward: expected one of 'sparse', 'shaped'"),
        ({"invalid": "ignore"}, "invalid: expected one of 'reject', 'raise'"),
        ({"instances": "all"}, "instances: expected 'generated' or a list"),
        ({"instances": ["multi_agent/01@2"]}, "has 2 seats"),
        ({"render_mode": "human"}, "render_mode"),
    ],
)
def test_options_that_there_are_not(options: dict, words: str) -> None:
    with pytest.raises(WrongArgumentError, match=words):
        RobotouilleEnv(ONE, **options)


def test_tasks_that_there_are_not() -> None:
    with pytest.raises(UnknownTaskError):
        RobotouilleEnv("synchronous/99")
    with pytest.raises(UnknownTaskError):
        RobotouilleEnv(ONE, instances=["nowhere"])


@pytest.mark.parametrize("observation", ["vector", "graph", "text"])
@pytest.mark.parametrize("task", [ONE, TEAM])
def test_copies_go_on_alike(task: str, observation: str) -> None:
    env, rng = (
        RobotouilleEnv(task, observation=observation, reward="sparse"),
        np.random.default_rng(2),
    )
    env.reset(seed=1)
    for _ in range(5):
        env.step(numbers(env, rng))
    twins = [copy.copy(env), copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    course = [numbers(env, rng)]
    expected = env.step(course[0])
    for twin in twins[1:]:
        found = twin.step(course[0])
        assert str(found[0]) == str(expected[0])
        assert found[1:4] == expected[1:4]
        assert np.array_equal(twin.action_masks(), env.action_masks())
        assert twin.world is env.world
    assert len(pickle.dumps(env)) < 20_000


def test_environments_share_what_is_large() -> None:
    envs = [RobotouilleEnv(load_task(ONE)) for _ in range(5)]
    assert len({id(env.world) for env in envs}) == 1
    assert len({id(env._play.view) for env in envs}) == 1


def test_instances_are_chosen_by_the_seed_or_by_name() -> None:
    env = RobotouilleEnv(ONE, instances=load_task(ONE).instances()[:2], max_steps=5)
    played = []
    for seed in (*range(12), *range(12)):
        seen, _ = env.reset(seed=seed)
        assert seen in env.observation_space
        played.append(env.world.task.name)
    assert played[:12] == played[12:]
    assert len(set(played)) == 3
    name = load_task(ONE).instances()[1]
    _, info = env.reset(options={"instance": name})
    assert env.world.task.name == name
    assert info["action_mask"].shape == (env.action_space.n,)
    env.step(int(np.flatnonzero(info["action_mask"])[0]))
    env.reset(options={"instance": 0})
    assert env.world.task == load_task(ONE)
    with pytest.raises(WrongArgumentError, match="instance: expected one of"):
        env.reset(options={"instance": "synchronous/02"})


def test_a_mask_of_another_instance() -> None:
    """Gymnasium refuses one of another length; what it allows is looked at here as any action."""
    ours, theirs = RobotouilleEnv(ONE, invalid="raise"), RobotouilleEnv("asynchronous/07")
    (_, info), (_, other) = ours.reset(seed=1), theirs.reset(seed=1)
    with pytest.raises(AssertionError, match=r"expected shape of the .*mask"):
        ours.action_space.sample(other["action_mask"])
    longer = ours if ours.action_space.n < theirs.action_space.n else theirs
    with pytest.raises(WrongArgumentError, match="found number"):
        longer.step(max(ours.action_space.n, theirs.action_space.n) - 1)
    wrong = np.flatnonzero(other["action_mask"])
    wrong = next(n for n in wrong if n < len(info["action_mask"]) and not info["action_mask"][n])
    with pytest.raises(InapplicableError):
        ours.step(wrong)


@pytest.mark.parametrize("worth", [math.nan, math.inf])
def test_a_potential_that_is_no_number(worth: float) -> None:
    env = RobotouilleEnv(ONE, reward="shaped", potential=lambda state: worth)
    with pytest.raises(WrongArgumentError, match=f"potential: expected a number, found {worth}"):
        env.reset()


def test_a_task_that_has_changed_on_disk_between_processes(tmp_path: Path) -> None:
    """A shipped task travels by its name, and its digest tells; a file of one's own travels whole,
    so the other process plays what this one does."""
    env = RobotouilleEnv(ONE)
    digest = env.world.task.digest
    other = "0" * len(digest)
    with pytest.raises(WrongWorldError, match="not the task that it was where this was pickled"):
        pickle.loads(pickle.dumps(env).replace(digest.encode(), other.encode()))
    file = tmp_path / "mine.json"
    file.write_text(load_task(ONE).problem.model_dump_json(by_alias=True), encoding="utf-8")
    mine = RobotouilleEnv(str(file))
    seen, _ = mine.reset()
    sent = pickle.dumps(mine)
    file.write_text("{}", encoding="utf-8")
    twin = pickle.loads(sent)
    assert np.array_equal(twin.reset()[0], seen)


@pytest.mark.parametrize("number", [[0], [0, 0, 0, 0]])
def test_actions_for_more_or_fewer_players(number: list[int]) -> None:
    env = RobotouilleEnv(TEAM)
    env.reset()
    with pytest.raises(WrongArgumentError, match="expected 3 numbers"):
        env.step(number)


def test_masks_sample_valid_actions() -> None:
    for task in (ONE, TEAM):
        env = RobotouilleEnv(task)
        _, info = env.reset(seed=1)
        env.action_space.seed(1)
        for _ in range(10):
            info = env.step(env.action_space.sample(info["action_mask"]))[4]


def test_every_shipped_task_has_a_name() -> None:
    register_envs()
    for name in task_names():
        assert gymnasium.spec(env_id(name)).kwargs["task"] == name
    assert env_id("synchronous/01_cheese_sandwich") == "robotouille/synchronous-01-v0"
    env = gymnasium.make("robotouille.envs:robotouille/synchronous-01-v0", reward="shaped")
    assert isinstance(env, RobotouilleEnv)


def test_it_is_shown_in_words() -> None:
    env = RobotouilleEnv(ONE, render_mode="ansi")
    env.reset()
    assert env.render() == env.state.text_view()
    assert RobotouilleEnv(ONE).render() is None


@pytest.mark.slow
def test_it_is_shown_as_a_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = RobotouilleEnv(ONE, render_mode="rgb_array")
    env.reset()
    picture = env.render()
    assert picture.dtype == np.uint8
    assert picture.shape == (540, 960, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20


@pytest.mark.parametrize("action", [1.7, float("nan"), "1", [1]], ids=str)
def test_what_is_no_number_of_an_action_is_not_made_one(action: Any) -> None:
    env = RobotouilleEnv("synchronous/01")
    env.reset(seed=0)
    with pytest.raises(WrongArgumentError, match="expected the number of an action"):
        env.step(action)
