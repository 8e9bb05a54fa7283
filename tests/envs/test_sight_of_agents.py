"""Agents that observe only what their players see."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from robotouille import Sight, WrongArgumentError, seen_by
from robotouille.envs import RobotouilleEnv, RobotouilleVectorEnv, parallel_env

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import parallel_api_test

TEAM = "multi_agent/07@2"
pytestmark = pytest.mark.filterwarnings("ignore:We recommend agents to be named")


@pytest.mark.parametrize("observation", ["vector", "graph", "text"])
def test_api_test_passes(observation: str) -> None:
    env = parallel_env(TEAM, sight=Sight(2), observation=observation, max_steps=10)
    parallel_api_test(env, num_cycles=25)


@pytest.mark.parametrize("perspective", ["identity", "egocentric"])
def test_observations_contain_what_players_see(perspective: str) -> None:
    options: Any = {"perspective": perspective, "sight": Sight(2), "goal": True}
    env = parallel_env(TEAM, **options)
    graphs = parallel_env(TEAM, observation="graph", **options)
    rng = np.random.default_rng(1)
    seen, infos = env.reset(seed=1)
    nodes, _ = graphs.reset(seed=1)
    flags = [i for i, name in enumerate(env.columns) if name.startswith("seen(")]
    names = [env.columns[i][5:-1] for i in flags]
    for _ in range(12):
        for seat, agent in enumerate(env.agents):
            shown = seen_by(env.world_state, agent, Sight(2))
            turned = dict(zip(env.agents, env.agents[seat:] + env.agents[:seat], strict=True))
            own = turned if perspective == "egocentric" else {}
            expected = [own.get(name, name) in shown.things for name in names]
            assert seen[agent][flags].tolist() == expected
            in_graph = nodes[agent].nodes[: len(names), graphs.features.index("seen")]
            assert in_graph.tolist() == expected
            number = env.world_state.action_number
            assert np.flatnonzero(infos[agent]["action_mask"]).tolist() == sorted(
                number(action, agent) for action in shown.actions
            )
            assert np.array_equal(env.action_mask(agent), infos[agent]["action_mask"])
            if perspective == "identity":
                size = env.world.encoding.size
                assert np.array_equal(seen[agent][:size], shown.state.vector())
        chosen = {p: int(rng.choice(np.flatnonzero(infos[p]["action_mask"]))) for p in env.agents}
        seen, *_, infos = env.step(chosen)
        nodes = graphs.step(chosen)[0]


def test_actions_can_fail_because_of_what_nobody_saw() -> None:
    env = parallel_env(TEAM, sight=Sight(1))
    env.reset()
    state = env.world_state
    shown, valid = env.action_mask("robot1"), state.mask("robot1")
    surprising = np.flatnonzero(shown & ~valid)
    assert len(surprising) and not (valid & ~shown.view(np.bool_)).any()
    infos = env.step({"robot1": int(surprising[0])})[4]
    assert not infos["robot1"]["valid"]


def test_single_player_sees_only_its_surroundings() -> None:
    env = RobotouilleEnv("asynchronous/07", sight=Sight(1), observation="text")
    text, info = env.reset()
    shown = seen_by(env.state, "robot1", Sight(1))
    assert text == shown.text_view("robot1") and "Out of sight: " in text
    assert info["action_mask"].sum() == env.action_masks().sum() == len(shown.actions)


@pytest.mark.parametrize("make", [RobotouilleEnv, RobotouilleVectorEnv])
def test_sight_needs_an_agent_for_each_player(make: Any) -> None:
    with pytest.raises(WrongArgumentError, match="sight: "):
        make(TEAM, sight=Sight(1))
    with pytest.raises(WrongArgumentError, match="sight: expected a Sight, found 3"):
        make(TEAM, sight=3)
