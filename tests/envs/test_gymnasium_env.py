"""The Gymnasium environment: API, seeds, masks, rewards, and agreement with the world."""

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
from robotouille.envs import RobotouilleEnv, StepsToGoPotential, env_id, register_envs
from robotouille.planning import solve
from tests.support.samples import quick_sample

TASKS = [name for name in task_names() if not name.startswith("examples/")]
ONE, TEAM = "synchronous/01", "multi_agent/01@3"


def numbers(env: RobotouilleEnv, rng: np.random.Generator):
    """Return random valid actions."""
    mask = env.action_masks()
    if isinstance(env.action_space, gymnasium.spaces.Discrete):
        return int(rng.choice(np.flatnonzero(mask)))
    parts = np.split(mask, np.cumsum(env.action_space.nvec)[:-1])
    return [int(rng.choice(np.flatnonzero(part))) for part in parts]


@pytest.mark.parametrize("name", quick_sample(sorted(TASKS, reverse=True), 2))
def test_api_check_passes_on_every_task(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(env_id(name), max_steps=20).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("observation", ["vector", "graph", "text"])
@pytest.mark.parametrize("task", [ONE, TEAM, "asynchronous/07"])
def test_api_check_passes_for_every_observation(task: str, observation: str) -> None:
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
def test_environment_matches_the_world(name: str) -> None:
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


def test_plan_earns_the_reward() -> None:
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
    with pytest.raises(RobotouilleError, match="the episode has ended"):
        env.step(0)


def test_episode_is_truncated_at_its_budget() -> None:
    env = RobotouilleEnv(ONE, max_steps=3)
    env.reset()
    idle = env.action_masks().nonzero()[0][-1]
    assert [env.step(idle)[2:4] for _ in range(3)] == [
        (False, False),
        (False, False),
        (False, True),
    ]
    with pytest.raises(RobotouilleError, match="ended"):
        env.step(idle)


def test_rejected_action_costs_a_step() -> None:
    env = RobotouilleEnv(ONE, max_steps=2)
    before, info = env.reset()
    wrong = int(np.flatnonzero(info["action_mask"] == 0)[0])
    seen, reward, _, truncated, info = env.step(wrong)
    assert np.array_equal(seen, before)
    assert (reward, truncated, info["valid"]) == (0.0, False, False)
    assert env.step(wrong)[3]


def test_invalid_action_can_raise() -> None:
    env = RobotouilleEnv(ONE, max_steps=2, invalid="raise")
    _, info = env.reset()
    wrong = int(np.flatnonzero(info["action_mask"] == 0)[0])
    state = env.state
    for _ in range(5):
        with pytest.raises(InapplicableError):
            env.step(wrong)
    assert env.state is state


def test_unknown_actions_are_rejected() -> None:
    env = RobotouilleEnv(ONE)
    for read in (lambda: env.step(0), env.action_masks):
        with pytest.raises(RobotouilleError, match="no episode has begun"):
            read()
    env.reset()
    for wrong in (-2, env.action_space.n, 10**9):
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
        ({"instances": "all"}, "instances: expected 'generated', 'endless' or a list"),
        ({"instances": ["multi_agent/01@2"]}, "has 2 seats"),
        ({"render_mode": "human"}, "render_mode"),
        ({"slots": 5}, "slots: expected a dictionary of integers by kind, found 5"),
        ({"slots": {"water": 1.5}}, "slots: expected a dictionary of integers by kind"),
        ({"slots": {"water": 0}}, "slots: expected 1 or more for 'water', found 0"),
        ({"slots": {"wine": 1}}, "slots: play cannot create objects of kind 'wine'"),
        ({"observations": "text"}, "unknown option 'observations'; did you mean 'observation'"),
    ],
)
def test_invalid_options_are_rejected(options: dict, words: str) -> None:
    with pytest.raises(WrongArgumentError, match=words):
        RobotouilleEnv(ONE, **options)


def test_unknown_option_is_rejected_by_name() -> None:
    with pytest.raises(WrongArgumentError, match="did you mean 'observation'"):
        gymnasium.make(env_id(ONE), observations="text")


def test_specification_has_the_step_budget() -> None:
    spec = gymnasium.make(env_id("synchronous/01_cheese_sandwich"), max_steps=70).spec
    assert spec.max_episode_steps == 70
    assert gymnasium.make(env_id("shifts/01_sandwich_bar")).spec.max_episode_steps > 0
    again = gymnasium.make(spec)
    again.reset()
    steps = [again.step(-1)[3] for _ in range(70)]
    assert steps == [False] * 69 + [True]


@pytest.mark.parametrize("task", [ONE, TEAM])
def test_minus_one_does_nothing(task: str) -> None:
    env = RobotouilleEnv(task, invalid="raise")
    env.reset()
    before = env.state
    players = len(env.world.players)
    info = env.step(-1 if players == 1 else [-1, None, -1])[4]
    assert info["valid"]
    assert env.state == before.step(None).state


def test_unknown_tasks_are_rejected() -> None:
    with pytest.raises(UnknownTaskError):
        RobotouilleEnv("synchronous/99")
    with pytest.raises(UnknownTaskError):
        RobotouilleEnv(ONE, instances=["nowhere"])


@pytest.mark.parametrize("observation", ["vector", "graph", "text"])
@pytest.mark.parametrize("task", [ONE, TEAM])
def test_copies_continue_equally(task: str, observation: str) -> None:
    env, rng = (
        RobotouilleEnv(task, observation=observation, reward="sparse"),
        np.random.default_rng(2),
    )
    env.reset(seed=1)
    for _ in range(5):
        env.step(numbers(env, rng))
    twins = [copy.copy(env), copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    rollout = [numbers(env, rng)]
    expected = env.step(rollout[0])
    for twin in twins[1:]:
        found = twin.step(rollout[0])
        assert str(found[0]) == str(expected[0])
        assert found[1:4] == expected[1:4]
        assert np.array_equal(twin.action_masks(), env.action_masks())
        assert twin.world is env.world
    assert len(pickle.dumps(env)) < 20_000


def test_instances_are_chosen_by_seed_or_name() -> None:
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
    with pytest.raises(WrongArgumentError, match="options: expected a dictionary, found 5"):
        env.reset(options=5)


@pytest.mark.parametrize("worth", [math.nan, math.inf])
def test_potential_must_be_a_number(worth: float) -> None:
    env = RobotouilleEnv(ONE, reward="shaped", potential=lambda state: worth)
    with pytest.raises(WrongArgumentError, match=f"potential: expected a number, found {worth}"):
        env.reset()


def test_changed_task_file_is_detected_between_processes(tmp_path: Path) -> None:
    env = RobotouilleEnv(ONE)
    digest = env.world.task.digest
    other = "0" * len(digest)
    with pytest.raises(WrongWorldError, match="has changed since this state was pickled"):
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
def test_wrong_number_of_actions_is_rejected(number: list[int]) -> None:
    env = RobotouilleEnv(TEAM)
    env.reset()
    with pytest.raises(WrongArgumentError, match="expected 3 numbers"):
        env.step(number)


def test_every_shipped_task_is_registered() -> None:
    register_envs()
    for name in task_names():
        assert gymnasium.spec(env_id(name)).kwargs["task"] == name
    assert env_id("synchronous/01_cheese_sandwich") == "robotouille/synchronous-01-v0"
    env = gymnasium.make("robotouille.envs:robotouille/synchronous-01-v0", reward="shaped")
    assert isinstance(env, RobotouilleEnv)


def test_render_text() -> None:
    env = RobotouilleEnv(ONE, render_mode="ansi")
    env.reset()
    assert env.render() == env.state.text_view()
    assert RobotouilleEnv(ONE).render() is None


@pytest.mark.slow
def test_render_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = RobotouilleEnv(ONE, render_mode="rgb_array")
    env.reset()
    picture = env.render()
    assert picture.dtype == np.uint8
    assert picture.shape == (540, 960, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20


@pytest.mark.parametrize("action", [1.7, float("nan"), "1", [1]], ids=str)
def test_actions_must_be_integers(action: Any) -> None:
    env = RobotouilleEnv("synchronous/01")
    env.reset(seed=0)
    with pytest.raises(WrongArgumentError, match="expected the number of an action"):
        env.step(action)


REWARD_TASK = "synchronous/01"


def rollout(env: RobotouilleEnv, seed: int, steps: int = 30) -> tuple[list[float], list[float]]:
    """Return the sparse rewards of a random rollout, and the environment's rewards."""
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    sparse, found = [], []
    for _ in range(steps):
        number = int(rng.choice(np.flatnonzero(env.action_masks())))
        _, reward, reached, truncated, _ = env.step(number)
        sparse.append(float(reached))
        found.append(reward)
        if reached or truncated:
            break
    return sparse, found


@pytest.mark.parametrize("seed", range(3))
def test_discounted_sum_differs_only_by_end_potentials(seed: int) -> None:
    gamma, weight = 0.9, 2.0
    env = RobotouilleEnv(REWARD_TASK, reward="shaped", gamma=gamma, weight=weight)
    potential = StepsToGoPotential()
    sparse, found = rollout(env, seed)
    gained = sum(gamma**i * (b - a) for i, (a, b) in enumerate(zip(sparse, found, strict=True)))
    last, first = potential(env.state), potential(env.world.initial)
    assert gained == pytest.approx(weight * (gamma ** len(found) * last - first))


def test_good_steps_are_rewarded() -> None:
    env = RobotouilleEnv(REWARD_TASK, reward="shaped", gamma=1.0)
    env.reset()
    plan = solve(env.world).plan
    assert plan is not None
    away = next(
        a for a in env.state.actions("robot1") if a != plan.steps[0][0] and a.name == "move"
    )
    assert env.step(env.state.action_number(away))[1] <= 0
    env.reset()
    rewards = [env.step(env.state.action_number(a))[1] for (a,) in plan]
    assert rewards == pytest.approx([1 / 8] * 7 + [1 + 1 / 8])


def test_custom_potential() -> None:
    def conditions(state) -> float:
        return sum(holds for _, holds in state.world.goal_terms(state)) / 10

    env = RobotouilleEnv(REWARD_TASK, reward="shaped", gamma=1.0, potential=conditions)
    sparse, found = rollout(env, 1)
    gained = conditions(env.state) - conditions(env.world.initial)
    assert sum(found) - sum(sparse) == pytest.approx(gained)
