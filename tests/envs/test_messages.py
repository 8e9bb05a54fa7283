"""Messages between the agents of an environment."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from robotouille import WrongArgumentError
from robotouille.envs import RobotouilleEnv, RobotouilleVectorEnv, aec_env, parallel_env

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test

TEAM = "multi_agent/01@3"
pytestmark = [
    pytest.mark.filterwarnings("ignore:We recommend agents to be named"),
    pytest.mark.filterwarnings("ignore:Action space for each agent probably should be"),
]


@pytest.mark.parametrize("observation", ["vector", "graph", "text"])
def test_api_tests_pass_with_messages(observation: str) -> None:
    options: Any = {"tokens": 3, "observation": observation, "max_steps": 8}
    parallel_api_test(parallel_env(TEAM, **options), num_cycles=20)
    if observation == "vector":
        parallel_seed_test(lambda: parallel_env(TEAM, **options), num_cycles=10)
        api_test(aec_env(TEAM, **options), num_cycles=20)
        seed_test(lambda: aec_env(TEAM, **options), num_cycles=10)


def sent(env: Any) -> Any:
    """Return what all agents observe after the second and third one have sent a message."""
    env.reset(seed=1)
    return env.step({"robot2": [-1, 3], "robot3": (-1, 1)})[0]


def test_vectors_contain_the_messages_of_all_seats() -> None:
    env = parallel_env(TEAM, tokens=3)
    for vector in sent(env).values():
        assert vector[-9:].reshape(3, 3).tolist() == [[0, 0, 0], [0, 0, 1], [1, 0, 0]]
    assert env.columns[-1] == "said[3](robot3)"
    # Messages last for one step.
    assert not any(vector[-9:].any() for vector in env.step({})[0].values())


def test_egocentric_messages_begin_with_the_agents_own() -> None:
    seen = sent(parallel_env(TEAM, tokens=3, perspective="egocentric"))
    assert seen["robot2"][-9:].reshape(3, 3).tolist() == [[0, 0, 1], [1, 0, 0], [0, 0, 0]]


def test_graphs_contain_messages_at_their_players() -> None:
    env = parallel_env(TEAM, tokens=3, observation="graph", goal=True)
    said = env.features.index("said[3]")
    players = [env.world.encoding.objects[i].name
               for i in sent(env)["robot1"].nodes[:, said].nonzero()[0]]  # fmt: skip
    assert players == ["robot2"]


def test_texts_contain_messages() -> None:
    env = parallel_env(TEAM, tokens=3, observation="text")
    assert "Messages of the last step:\n- robot2: 3\n- robot3: 1" in sent(env)["robot1"]
    assert "Messages of the last step:\n- none" in env.step({})[0]["robot1"]


def test_message_comes_with_an_action() -> None:
    env = parallel_env(TEAM, tokens=2)
    _, infos = env.reset()
    actions, messages = infos["robot1"]["action_mask"]
    assert messages.tolist() == [1, 1, 1]
    number = int(np.flatnonzero(actions)[0])
    before = env.world_state
    env.step({"robot1": [number, 2]})
    assert env.world_state == before.step(before.action("robot1", number)).state


@pytest.mark.parametrize("wrong", [[0, 4], [0, -1], 0, [0, 1, 2], [0, "a"]], ids=str)
def test_wrong_messages_are_rejected(wrong: Any) -> None:
    env = parallel_env(TEAM, tokens=3)
    env.reset()
    with pytest.raises(WrongArgumentError, match="robot1: expected an action and a message"):
        env.step({"robot1": wrong})


@pytest.mark.parametrize("make", [RobotouilleEnv, RobotouilleVectorEnv])
def test_one_agent_sends_no_messages(make: Any) -> None:
    with pytest.raises(WrongArgumentError, match="tokens: only parallel_env"):
        make(TEAM, tokens=3)
    with pytest.raises(WrongArgumentError, match="tokens: expected 0 to 1000, found -1"):
        make(TEAM, tokens=-1)
    # Each message has a column, so a million would take minutes.
    with pytest.raises(WrongArgumentError, match="tokens: expected 0 to 1000, found 1000000"):
        make(TEAM, tokens=1_000_000)
