"""New instances in each episode, and the levels of a curriculum."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from robotouille import World, WrongArgumentError, load_task
from robotouille.envs import (
    Level,
    RobotouilleEnv,
    RobotouilleParallelEnv,
    RobotouilleVectorEnv,
    parallel_env,
)
from robotouille.generation.shuffling import shuffled
from robotouille.planning import solve
from robotouille.world.world import State
from tests.support.samples import quick_sample

ONE, TEAM = "synchronous/01", "multi_agent/01@3"


def first_states(env: RobotouilleEnv, count: int, seed: int) -> list[str]:
    """Return the digests of the first states of some episodes."""
    env.reset(seed=seed)
    found = [env.state.digest]
    for _ in range(count - 1):
        env.reset()
        found.append(env.state.digest)
    return found


def can_go_back(state: State) -> bool:
    """Return whether some player can take a step and undo it."""
    return any(
        after.step(back).state == state
        for player in state.world.players
        for action in state.actions(player)
        for after in [state.step(action).state]
        for back in after.actions(player)
    )


@pytest.mark.parametrize("name", quick_sample([ONE, "asynchronous/07", "multi_agent/05@2"], 1))
def test_shuffled_states_are_connected_with_the_first_one(name: str) -> None:
    world = World(name)
    state = shuffled(world, 3)
    assert state.digest == shuffled(World(name), 3).digest != shuffled(world, 4).digest
    assert not state.timers and not state.goal_reached
    assert state.vector().shape == world.initial.vector().shape
    assert can_go_back(state)
    moved = set(world.initial.fact_names()) - set(state.fact_names())
    assert len(moved) > len(world.players)


@pytest.mark.parametrize("seed", range(5))
def test_shuffled_states_have_plans(seed: int) -> None:
    world = World(ONE)
    state = shuffled(world, seed)
    assert solve(world, state).plan is not None


def test_each_reset_begins_elsewhere() -> None:
    env = RobotouilleEnv(ONE, instances="endless")
    found = first_states(env, 12, seed=5)
    assert len(set(found)) > 10
    assert env.world is RobotouilleEnv(ONE).world
    assert found == first_states(RobotouilleEnv(ONE, instances="endless"), 12, seed=5)
    assert found != first_states(env, 12, seed=6)


def test_instance_of_a_number_is_always_the_same() -> None:
    env = RobotouilleEnv(ONE, instances="endless")
    env.reset(seed=3, options={"instance": 7})
    assert env.state == shuffled(env.world, 7)
    # The option does not change what comes next.
    env.reset()
    assert env.state.digest == first_states(env, 2, seed=3)[1]


def test_engine_begins_where_the_world_does(
    in_the_engine: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    fast = parallel_env(TEAM, instances="endless")
    slow = parallel_env(TEAM, instances="endless", observation="graph")
    for _ in range(2):
        fast.reset(seed=2), slow.reset(seed=2)
        assert np.array_equal(fast.state(), slow.state())
        number = {p: int(np.flatnonzero(fast.action_mask(p))[0]) for p in fast.agents}
        fast.step(number), slow.step(number)
        assert fast.world_state == slow.world_state
        assert pickle.loads(pickle.dumps(fast)).world_state == fast.world_state


@pytest.mark.parametrize("compiled", [False, True])
def test_copies_begin_elsewhere_in_each_episode(
    compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    from robotouille.envs import rules

    monkeypatch.setattr(rules, "is_compiled", lambda: compiled)
    envs = RobotouilleVectorEnv(ONE, 3, instances="endless", max_steps=1, autoreset_mode="SameStep")
    seen, info = envs.reset(seed=4)
    found = [seen.copy()]
    for _ in range(3):
        found.append(envs.step(info["action_mask"].argmax(axis=1))[0].copy())
    for copy in range(3):
        env = RobotouilleEnv(ONE, instances="endless")
        expected = [env.reset(seed=4 + copy)[0], *(env.reset()[0] for _ in range(3))]
        assert np.array_equal([each[copy] for each in found], expected)


def test_levels_are_played_until_another_is_requested() -> None:
    levels = [Level(), Level(cells=(7, 8), items=3)]
    env = RobotouilleEnv(ONE, instances="endless", levels=levels)
    played = []
    for options in (None, {"level": 1}, None, {"level": 0}):
        seen, info = env.reset(seed=1, options=options)
        assert seen in env.observation_space and info["action_mask"].shape == (env.action_space.n,)
        played.append((len(env.world.floor.stations), len(env.world.placed)))
    assert played[0] == played[3] and played[1] == played[2]
    assert (played[1][0] - played[0][0], played[1][1] - played[0][1]) == (3, 6)
    env.reset(options={"level": 1})
    assert (env.world.floor.width, env.world.floor.height) == (7, 8)
    assert env.world.task == Level((7, 8), items=3).task_for(load_task(ONE))


@pytest.mark.parametrize("compiled", [False, True])
def test_levels_can_have_smaller_teams(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    from robotouille.envs import rules

    monkeypatch.setattr(rules, "is_compiled", lambda: compiled)
    env: RobotouilleParallelEnv = parallel_env(TEAM, levels=[Level(seats=2), Level()])
    for level, agents in ((0, 2), (1, 3)):
        seen, infos = env.reset(options={"level": level})
        assert env.agents == env.possible_agents[:agents]
        assert all(seen[agent] in env.observation_space(agent) for agent in env.agents)
        number = {p: int(np.flatnonzero(infos[p]["action_mask"])[0]) for p in env.agents}
        assert list(env.step(number)[0]) == env.agents


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"levels": [3]}, "levels: expected a list of Level"),
        ({"levels": [Level(seats=2)]}, "levels: other numbers of seats: only parallel_env"),
        ({"levels": [Level(cells=(2, 2), items=30)]}, "levels: "),
        ({"levels": [Level()], "instances": "generated"}, "levels: they need"),
    ],
)
def test_impossible_levels_are_rejected(options: dict[str, Any], words: str) -> None:
    with pytest.raises(WrongArgumentError, match=words):
        RobotouilleEnv(ONE, **options)
    with pytest.raises(WrongArgumentError, match="levels: synchronous/01_cheese_sandwich has no 4"):
        parallel_env(ONE, levels=[Level(seats=4)])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"level": 1}, "level: the environment was made without levels"),
        ({"instance": -1}, "instance: expected 0 to"),
    ],
)
def test_wrong_options_of_reset_are_rejected(options: dict[str, Any], words: str) -> None:
    with pytest.raises(WrongArgumentError, match=words):
        RobotouilleEnv(ONE, instances="endless").reset(options=options)
    with pytest.raises(WrongArgumentError, match="level: expected 0 to 0, found 3"):
        RobotouilleEnv(ONE, levels=[Level()]).reset(options={"level": 3})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"levels": None}, "levels: expected a list of Level, found None"),
        ({"levels": Level}, "levels: expected a list of Level"),
        ({"instances": 5}, "instances: expected a list, found 5"),
    ],
)
def test_options_that_are_no_lists_are_refused(options: Any, message: str) -> None:
    with pytest.raises(WrongArgumentError, match=message):
        RobotouilleEnv("synchronous/01", **options)
