"""Planner policies reach goals together, and with partners who act at random."""

from __future__ import annotations

import logging
import random
from collections.abc import Callable
from typing import Any

import pytest

from robotouille import World, load_task, task_names
from robotouille.episode import Clock, Outcome
from robotouille.generation import generate
from robotouille.planning.beam.planner import BeamPlanner, Solution
from robotouille.planning.plan import Plan
from robotouille.planning.policies import PlannerOptions, PlannerPolicy, Policy
from robotouille_client.bots.kinds import BotKind, policy_maker
from tests.support.pancakes import pancake_kitchen
from tests.support.samples import quick_sample
from tests.support.team_games import Idle, RandomWalker, play_team
from tests.world.kitchens import kitchen

MULTI = [name for name in task_names() if name.startswith("multi_agent/")]

PLAYED = dict(zip(MULTI, (16, 20, 24, 16, 20, 28, 23, 28, 29, 37), strict=True))
"""Steps that two planners took when this was written; where an action has to wait for another's of
the same step of the plan, that is one more than the plan has."""


def play(
    name: str,
    clock: Clock,
    *,
    timing: str = "benchmark",
    partner: Callable[[str], Policy] | None = None,
    limit: int = 300,
) -> Outcome:
    """Play with planners, or with a planner and partners in all other seats."""
    task = load_task(name, timing=timing)
    others = {p: partner(p) for p in World(task).players[1:]} if partner else {}
    outcome = play_team(task, others, clock=clock, limit=limit).outcome
    assert outcome is not None
    return outcome


def stranger(player: str) -> Policy:
    return RandomWalker(player, travel=False)


@pytest.mark.parametrize("name", quick_sample(MULTI, 0, nightly=3))
def test_team_of_two_is_faster_than_one_player(name: str) -> None:
    outcome = play(name, Clock.LOCKSTEP)
    assert outcome.success
    assert all(tally.acted > 5 for tally in outcome.seats)
    assert outcome.steps <= PLAYED[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["multi_agent/01@3", "multi_agent/05@4", "multi_agent/07@3"])
def test_larger_teams_reach_the_goal(name: str) -> None:
    assert play(name, Clock.LOCKSTEP).success


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", quick_sample(["multi_agent/04@2", "multi_agent/01@3", "multi_agent/07@4"], nightly=2)
)
def test_turns_reach_the_goal(name: str) -> None:
    assert play(name, Clock.TURN, limit=600).success


@pytest.mark.slow
@pytest.mark.parametrize("name", ["multi_agent/01", "multi_agent/04", "multi_agent/07"])
def test_real_time_with_timing_for_people(name: str) -> None:
    assert play(name, Clock.REALTIME, timing="people", limit=900).success


@pytest.mark.parametrize("partner", quick_sample([stranger, Idle]))
@pytest.mark.parametrize("name", quick_sample(["multi_agent/01", "multi_agent/05"], 0))
def test_unhelpful_partner_does_not_prevent_the_goal(
    name: str, partner: Callable[[str], Policy]
) -> None:
    assert play(name, Clock.LOCKSTEP, partner=partner).success


def alone(world: World, interfere: Callable[[int], bool]) -> int:
    """Return the steps of a planner whose seat is sometimes played at random for a step."""
    policy, rng, state, steps = PlannerPolicy(world, "robot1"), random.Random(8), world.initial, 0
    while not state.goal_reached and steps < 400:
        action = policy.act(state)
        if interfere(steps):
            action = rng.choice(state.actions("robot1"))
        step = state.step([action])
        policy.observe([("robot1", a.action, a.applied) for a in step.attempts])
        state, steps = step.state, steps + 1
    return steps


@pytest.mark.parametrize("name", ["synchronous/06", "asynchronous/02", "asynchronous/07"])
def test_single_player_plans_again_after_interference(name: str) -> None:
    world = World(name)
    least = alone(world, lambda step: False)
    assert least < alone(world, lambda step: step % 10 == 5) <= 3 * least


@pytest.mark.parametrize("clock", quick_sample(Clock))
@pytest.mark.parametrize(("name", "least"), [("synchronous/09", 60), ("asynchronous/08", 40)])
def test_single_player_wastes_no_step(name: str, least: int, clock: Clock) -> None:
    outcome = play(name, clock)
    assert outcome.success
    assert outcome.steps <= 1.05 * least


def test_single_player_with_timing_for_people() -> None:
    assert play("asynchronous/10", Clock.REALTIME, timing="people", limit=900).success


STACK = [
    {"predicate": "ispancake", "args": ["pancake"], "ids": [1]},
    {"predicate": "atop", "args": ["pancake", "pancake"], "ids": [2, 1]},
]


def pancake_steps(seats: int, **kitchen: Any) -> int:
    """Return the steps of planners to the goal in a domain of their own."""
    world = pancake_kitchen(**kitchen)
    players = world.players[:seats]
    policies = {
        p: PlannerPolicy(World(world.task), p, PlannerOptions(alone=seats == 1)) for p in players
    }
    state, steps = world.initial, 0
    while not state.goal_reached and steps < 100:
        actions = [policy.act(state) for policy in policies.values()]
        step = state.step([world.action(a.name, *a.arguments) for a in actions if a is not None])
        did = [(a.action.player or "", a.action, a.applied) for a in step.attempts]
        for policy in policies.values():
            policy.observe(did)
        assert all(policy.has_plan for policy in policies.values())
        state, steps = step.state, steps + 1
    return steps


@pytest.mark.parametrize(
    ("most", "seats", "kitchen"),
    quick_sample(
        [
            (10, 1, {}),
            (12, 2, {"players": 2}),
            (10, 1, {"players": 2}),
            (22, 1, {"batter": 2, "goal": STACK}),
        ],
        2,
    ),
)
def test_object_that_replaces_another(most: int, seats: int, kitchen: dict[str, Any]) -> None:
    assert pancake_steps(seats, **kitchen) <= most


@pytest.mark.slow
@pytest.mark.parametrize("seats", [1, 2])
def test_greedy_search_replaces_a_failed_beam_search(
    monkeypatch: pytest.MonkeyPatch, seats: int
) -> None:
    nothing = Solution(Plan(()), False, 9.0, 1)
    monkeypatch.setattr(BeamPlanner, "solve", lambda *_, **__: nothing)
    assert pancake_steps(seats, players=seats) <= 14


def test_missing_plan_is_logged_not_printed(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    world = kitchen(
        items=[{"name": "lettuce", "x": 0, "y": 0}],
        goal=[{"predicate": "iscut", "args": ["lettuce"], "ids": [1]}],
    )
    policy = policy_maker(BotKind.PLANNER)(world.initial, "robot1")
    with caplog.at_level(logging.DEBUG):
        assert all(policy.act(world.initial) is None for _ in range(9))
    assert caplog.messages == ["robot1 finds no plan from here"]
    assert capsys.readouterr() == ("", "")


HARD = [("02", 42), ("10", 546), ("09", 504), ("09", 630)]
"""Kitchens in which planners once took up to 1.24 times the shortest plan, or stopped half way."""


@pytest.mark.parametrize(("task", "seed"), quick_sample(HARD, nightly=2))
def test_a_bot_alone_is_nearly_as_fast_as_the_best_plan(task: str, seed: int) -> None:
    instance = generate(load_task(f"asynchronous/{task}"), seed)
    best = instance.results[1]
    outcome = play_team(instance.task).outcome
    assert outcome is not None
    assert outcome.success
    assert outcome.steps <= 1.05 * len(best.plan or ())
