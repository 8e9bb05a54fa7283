"""Observations that tell agents apart, from their own point of view, and with the goal."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robotouille import World, WrongArgumentError
from robotouille.envs import (
    Perspective,
    RobotouilleEnv,
    RobotouilleParallelEnv,
    RobotouilleVectorEnv,
    parallel_env,
)
from robotouille.planning import solve
from robotouille.world.sight import Sight

TEAM = "multi_agent/01@3"


def wandering(env: RobotouilleParallelEnv, steps: int = 25) -> dict[str, Any]:
    """Return the observations after some random valid actions."""
    rng = np.random.default_rng(1)
    seen, infos = env.reset(seed=1)
    for _ in range(steps):
        chosen = {p: int(rng.choice(np.flatnonzero(infos[p]["action_mask"]))) for p in env.agents}
        seen, *_, infos = env.step(chosen)
    return seen


@pytest.mark.parametrize("perspective", [None, "egocentric"])
def test_vectors_differ_between_agents(perspective: str | None) -> None:
    seen = wandering(parallel_env(TEAM, perspective=perspective))
    assert len({vector.tobytes() for vector in seen.values()}) == 3


def test_vector_marks_the_agents_player() -> None:
    env = parallel_env(TEAM)
    seen = wandering(env)
    assert env.columns[-3:] == ("self(robot1)", "self(robot2)", "self(robot3)")
    assert seen["robot2"][-3:].tolist() == [0, 1, 0]
    assert np.array_equal(seen["robot2"][:-3], env.state())


def test_shared_vectors_are_those_of_the_world() -> None:
    env = parallel_env(TEAM, perspective="shared")
    seen = wandering(env)
    assert env.columns == env.world.encoding.columns
    assert all(np.array_equal(vector, env.state()) for vector in seen.values())


@pytest.mark.parametrize("task", [TEAM, "shifts/04"])
def test_egocentric_vector_puts_the_agent_first(task: str) -> None:
    env = parallel_env(task, perspective="egocentric")
    seen = wandering(env)
    players = env.world.players
    facts = set(env.world_state.fact_names())
    own = {name for name in env.columns if name.startswith("loc(")}
    for seat, player in enumerate(players):
        turned = {p: players[(i + seat) % len(players)] for i, p in enumerate(players)}
        shown = {env.columns[i] for i in seen[player].nonzero()[0]}
        for name in own:
            who, _, where = name.removeprefix("loc(").partition(",")
            assert (name in shown) == (f"loc({turned[who]},{where}" in facts)


def test_egocentric_agents_number_actions_alike() -> None:
    world = World(TEAM)
    names = [str(action) for action in world.ground_actions("robot1")]
    assert [str(a).replace("robot2", "robot1") for a in world.ground_actions("robot2")] == names


@pytest.mark.parametrize("perspective", ["identity", "egocentric"])
def test_graph_marks_the_agents_player(perspective: str) -> None:
    env = parallel_env(TEAM, observation="graph", perspective=perspective)
    seen = wandering(env)
    feature = env.features.index("self")
    names = [thing.name for thing in env.world.encoding.objects]
    loc = env.world.encoding.relations.index("loc")
    for player, graph in seen.items():
        assert graph in env.observation_space(player)
        (marked,) = np.flatnonzero(graph.nodes[:, feature])
        first = perspective == "egocentric"
        assert names[marked] == ("robot1" if first else player)
        at = [to for edge, (node, to) in zip(graph.edges, graph.edge_links, strict=True)
              if edge[0] == loc and node == marked]  # fmt: skip
        assert f"loc({player}, {names[at[0]]})" in env.world_state.fact_names()


def test_goal_conditions_are_in_vectors() -> None:
    env = RobotouilleEnv("synchronous/01", goal=True)
    seen, _ = env.reset()
    plan = solve(env.world).plan
    assert plan is not None
    for (action,) in plan:
        holding = [holds for _, holds in env.world.goal_terms(env.state)]
        assert seen in env.observation_space
        assert seen[-len(holding) :].tolist() == holding
        seen = env.step(env.state.action_number(action))[0]
    assert seen[-len(holding) :].all()
    assert env.columns[-1] == f"goal[{len(holding) - 1}]"


def test_goal_is_part_of_graphs() -> None:
    env = parallel_env(TEAM, observation="graph", goal=True)
    graph = wandering(env)["robot1"]
    feature = {name: i for i, name in enumerate(env.features)}
    wanted = {
        name: np.flatnonzero(graph.nodes[:, feature["goal"]] * graph.nodes[:, feature[name]])
        for name in ("ispatty", "iscooked", "istable", "clear", "istopbun")
    }
    assert wanted["ispatty"].tolist() == wanted["iscooked"].tolist()
    assert wanted["clear"].tolist() == wanted["istopbun"].tolist()
    at = env.world.encoding.relations.index("item_at")
    links = [tuple(link) for edge, link in zip(graph.edges, graph.edge_links, strict=True)
             if edge[0] == at]  # fmt: skip
    assert (wanted["ispatty"][0], wanted["istable"][0]) in links


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"perspective": "mine"}, "perspective: expected one of 'shared', 'identity'"),
        ({"perspective": Perspective.IDENTITY}, "perspective: only parallel_env"),
        ({"goal": "yes"}, "goal: expected True or False, found 'yes'"),
    ],
)
def test_invalid_options_are_rejected(options: dict[str, Any], words: str) -> None:
    with pytest.raises(WrongArgumentError, match=words):
        RobotouilleEnv(TEAM, **options)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"observation": "graph"}, "a graph has no fixed size; use .*AsyncVectorEnv"),
        ({"sight": Sight(1)}, "sight: only parallel_env and aec_env have several agents"),
        ({"tokens": 2}, "tokens: only parallel_env"),
    ],
)
def test_copies_refuse_what_needs_other_environments(options: dict[str, Any], words: str) -> None:
    with pytest.raises(WrongArgumentError, match=words):
        RobotouilleVectorEnv(TEAM, **options)
    assert RobotouilleVectorEnv(TEAM, goal=True).columns[-1].startswith("goal[")


def test_shift_has_no_goal_to_observe() -> None:
    with pytest.raises(WrongArgumentError, match="goal: a shift has no goal"):
        parallel_env("shifts/01", goal=True)
