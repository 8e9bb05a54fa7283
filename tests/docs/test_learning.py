"""The page on learning, and its examples, do what they say."""

from __future__ import annotations

import importlib.util
import math
import re
import runpy
from typing import Any

import numpy as np
import pytest

from robotouille import World
from robotouille.planning import AnytimePlanner
from tests.support.pages import blocks, read
from tests.support.sources import ROOT

pytest.importorskip("gymnasium")
pytest.importorskip("pettingzoo")


def example(name: str) -> dict[str, Any]:
    return runpy.run_path(str(ROOT / f"examples/learning/{name}.py"))


@pytest.mark.slow
def test_the_examples_of_the_page() -> None:
    names: dict[str, Any] = {}
    for block in blocks("train.md", "python"):
        exec(compile(block, "train.md", "exec"), names)
    assert names["env"].action_masks().any()
    imitation = example("imitate")
    recording = imitation["record"](AnytimePlanner(World("synchronous/01")), seed=1)
    assert len(names["lessons"](recording)) == recording.measures().steps


def test_every_option_and_name_is_on_the_page() -> None:
    from robotouille import envs

    page = read("train.md")
    for name in (*envs.EnvOptions.__annotations__, *envs.__all__):
        if name not in ("EnvOptions", "InvalidAction", "EnvObservation", "Reward", "env_id",
                        "register_envs", "RobotouilleParallelEnv"):  # fmt: skip
            assert re.search(rf"\b{name}\b", page), name


@pytest.mark.slow
def test_a_policy_learns_from_recordings() -> None:
    imitation = example("imitate")
    planner = AnytimePlanner(World("synchronous/01"))
    recordings = [imitation["record"](planner, seed) for seed in range(25)]
    assert all(recording.verify().ok for recording in recordings[:3])
    assert imitation["play"](imitation["imitate"](recordings), "synchronous/01") == (True, 8)


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("sb3_contrib") is None, reason="needs sb3-contrib")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.process
def test_stable_baselines_trains_on_copies() -> None:
    names = example("vec_env")
    envs = names["KitchenVecEnv"]("synchronous/01", 3, seed=1, max_steps=2)
    seen = envs.reset()
    assert seen in envs.envs.observation_space
    for _ in range(2):
        masks = np.stack(envs.env_method("action_masks"))
        _, rewards, dones, infos = envs.step(masks.argmax(axis=1))
    assert dones.all() and rewards.shape == (3,)
    assert (
        infos[0]["TimeLimit.truncated"]
        and infos[0]["terminal_observation"] in envs.envs.single_observation_space
    )
    assert names["learn"]("synchronous/01", 512, copies=8).num_timesteps == 512


@pytest.mark.nightly
@pytest.mark.skipif(importlib.util.find_spec("sb3_contrib") is None, reason="needs sb3-contrib")
@pytest.mark.filterwarnings("ignore")
def test_a_policy_learns_from_nothing() -> None:
    rows = example("ppo")["learn"]("synchronous/01", 57_000, "sparse")
    assert rows[0][1] == 0 and math.isnan(rows[0][2])
    _, reached, length = rows[-1]
    assert reached >= 0.9 and length < 10
