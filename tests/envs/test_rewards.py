"""Shaped rewards: what a course gains depends on where it begins and ends alone."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from robotouille import World
from robotouille.envs import RobotouilleEnv, StepsToGoPotential
from robotouille.planning import solve

ONE = "synchronous/01"


def course(env: RobotouilleEnv, seed: int, steps: int = 30) -> tuple[list[float], list[float]]:
    """The sparse rewards of a random course, and the environment's."""
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
def test_the_discounted_sum_differs_by_the_potentials_of_the_ends_alone(seed: int) -> None:
    gamma, weight = 0.9, 2.0
    env = RobotouilleEnv(ONE, reward="shaped", gamma=gamma, weight=weight)
    potential = StepsToGoPotential()
    sparse, found = course(env, seed)
    gained = sum(gamma**i * (b - a) for i, (a, b) in enumerate(zip(sparse, found, strict=True)))
    last, first = potential(env.state), potential(env.world.initial)
    assert gained == pytest.approx(weight * (gamma ** len(found) * last - first))


def test_steps_to_go_are_those_of_shortest_plans() -> None:
    world, potential = World(ONE), StepsToGoPotential()
    plan = solve(world).plan
    assert plan is not None
    state, found = world.initial, [potential(world.initial)]
    for joint in plan:
        state = state.step(joint).state
        found.append(potential(state))
    assert found == pytest.approx([-(8 - i) / 8 for i in range(9)])


def test_good_steps_are_rewarded_and_bad_ones_are_not() -> None:
    env = RobotouilleEnv(ONE, reward="shaped", gamma=1.0)
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


def test_a_potential_of_ones_own() -> None:
    def conditions(state) -> float:
        return sum(holds for _, holds in state.world.goal_terms(state)) / 10

    env = RobotouilleEnv(ONE, reward="shaped", gamma=1.0, potential=conditions)
    sparse, found = course(env, 1)
    gained = conditions(env.state) - conditions(env.world.initial)
    assert sum(found) - sum(sparse) == pytest.approx(gained)


def test_a_potential_travels_without_what_it_knows() -> None:
    potential = StepsToGoPotential()
    value = potential(World(ONE).initial)
    assert copy.deepcopy(potential) is potential
    assert pickle.loads(pickle.dumps(potential))(World(ONE).initial) == value == -1.0


@pytest.mark.slow
def test_where_there_is_no_plan_is_as_far_away_as_can_be() -> None:
    world = World("multi_agent/01@2")
    assert StepsToGoPotential()(world.initial) == -1.0
