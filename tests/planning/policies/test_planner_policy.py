"""Seats that plan for themselves finish together, and with partners who do as they like."""

from __future__ import annotations

import logging
import random
from collections.abc import Callable
from typing import Any

import pytest

from robotouille import GroundAction, State, World, load_task, task_names
from robotouille.episode import Clock, Episode, Outcome, Phase, Rules, Stepped
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.beam.planner import BeamPlanner, Solution
from robotouille.planning.plan import Plan
from robotouille.planning.policies.planner_policy import PlannerPolicy
from robotouille.planning.policies.script import Did
from robotouille.planning.search_result import Limits
from robotouille_client.bots.kinds import BotKind, policy_maker
from tests.support.pancakes import pancake_kitchen
from tests.support.samples import first_quickly
from tests.world.kitchens import kitchen

MULTI = [name for name in task_names() if name.startswith("multi_agent/")]

PLAYED = dict(zip(MULTI, (16, 20, 24, 16, 20, 28, 23, 28, 29, 37), strict=True))
"""Steps that two planners took when this was written; where an action has to wait for another's of
the same step of the plan, that is one more than the plan has."""


class Chance:
    """A partner who does anything."""

    def __init__(self, player: str) -> None:
        self._player, self._random = player, random.Random(5)

    def observe(self, did: Did) -> None:
        pass

    def act(self, state: State) -> GroundAction | None:
        actions = state.actions(self._player)
        return self._random.choice(actions) if actions else None


class Idler(Chance):
    """A partner who does nothing at all, and stands where it stands."""

    def act(self, state: State) -> GroundAction | None:
        return None


def play(
    name: str,
    clock: Clock,
    *,
    timing: str = "benchmark",
    partner: Callable[[str], Chance] | None = None,
    limit: int = 300,
) -> Outcome:
    world = World(load_task(name, timing=timing))
    policies = {p: PlannerPolicy(World(world.task), p) for p in world.players}
    if partner is not None:
        policies |= {p: partner(p) for p in world.players[1:]}  # type: ignore[dict-item]
    episode = Episode(world, Rules(clock=clock, max_steps=limit, step_rate=10))
    for player in world.players:
        episode.join(player, player, "bot", 0.0)
    now, seq = 0.0, 0
    while episode.phase is Phase.RUNNING:
        seq, now = seq + 1, now + 0.1
        for player, policy in policies.items():
            mine = episode.on_turn in (None, player) and not episode.state.busy_steps(player)
            if mine and episode.phase is Phase.RUNNING:
                action = policy.act(episode.state)
                here = world.action(action.name, *action.arguments) if action else None
                episode.submit(player, seq, here, now)
        episode.tick(now)
        for event in episode.events():
            if isinstance(event, Stepped):
                pairs = zip(event.moves, event.attempts, strict=True)
                did = [(move.player, move.action, attempt.applied) for move, attempt in pairs]
                for policy in policies.values():
                    policy.observe(did)
    assert episode.outcome is not None
    return episode.outcome


@pytest.mark.parametrize("name", first_quickly(MULTI, 0, nightly=3))
def test_a_team_of_two_is_faster_than_one_could_be(name: str) -> None:
    outcome = play(name, Clock.LOCKSTEP)
    assert outcome.success
    assert all(tally.acted > 5 for tally in outcome.seats)
    assert outcome.steps <= PLAYED[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["multi_agent/01@3", "multi_agent/05@4", "multi_agent/07@3"])
def test_larger_teams(name: str) -> None:
    assert play(name, Clock.LOCKSTEP).success


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", first_quickly(["multi_agent/04@2", "multi_agent/01@3", "multi_agent/07@4"], nightly=2)
)
def test_turn_by_turn(name: str) -> None:
    assert play(name, Clock.TURN, limit=600).success


@pytest.mark.slow
@pytest.mark.parametrize("name", ["multi_agent/01", "multi_agent/04", "multi_agent/07"])
def test_in_real_time_where_walking_takes_time(name: str) -> None:
    assert play(name, Clock.REALTIME, timing="people", limit=900).success


@pytest.mark.parametrize("partner", first_quickly([Chance, Idler]))
@pytest.mark.parametrize("name", first_quickly(["multi_agent/01", "multi_agent/05"]))
def test_with_a_partner_who_is_no_help(name: str, partner: type[Chance]) -> None:
    assert play(name, Clock.LOCKSTEP, partner=partner).success


@pytest.mark.slow
def test_one_seed_one_course() -> None:
    first, second = (play("multi_agent/03", Clock.LOCKSTEP) for _ in range(2))
    assert first == second


def alone(world: World, interfere: Callable[[int], bool]) -> tuple[int, list[int]]:
    """A planner plays, and now and then somebody takes its seat for a step.

    The steps it took, and those in which it made a new plan.
    """
    policy, rng, state = PlannerPolicy(world, "robot1"), random.Random(8), world.initial
    planned, steps, script = [], 0, None
    while not state.goal_reached and steps < 400:
        action = policy.act(state)
        if policy._script is not script:
            planned.append(steps)
            script = policy._script
        if interfere(steps):
            action = rng.choice(state.actions("robot1"))
        step = state.step([action])
        policy.observe([("robot1", a.action, a.applied) for a in step.attempts])
        state, steps = step.state, steps + 1
    return steps, planned


@pytest.mark.parametrize("name", ["synchronous/06", "asynchronous/02", "asynchronous/07"])
def test_after_interference_a_player_who_is_alone_plans_anew(name: str) -> None:
    world = World(name)
    least = alone(world, lambda step: False)[0]
    steps, planned = alone(world, lambda step: step % 10 == 5)
    assert 6 in planned
    assert least < steps <= 3 * least


@pytest.mark.slow
def test_a_plan_that_is_not_proven_to_be_shortest_is_improved_while_playing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("robotouille.planning.policies.team_search.ALONE", Limits(expansions=60))
    world = World("asynchronous/09")
    first = AnytimePlanner(world).first(world.initial).plan
    steps, planned = alone(world, lambda step: False)
    assert len(planned) > 1
    assert steps <= 1.05 * 58 < len(first or ())


@pytest.mark.parametrize("clock", list(Clock))
@pytest.mark.parametrize(("name", "least"), [("synchronous/09", 60), ("asynchronous/08", 40)])
def test_alone_no_step_is_wasted(name: str, least: int, clock: Clock) -> None:
    outcome = play(name, clock)
    assert outcome.success
    assert outcome.steps <= 1.05 * least


def test_alone_where_walking_takes_time() -> None:
    assert play("asynchronous/10", Clock.REALTIME, timing="people", limit=900).success


def test_nothing_is_done_where_nothing_helps() -> None:
    world = kitchen(
        items=[{"name": "lettuce", "x": 0, "y": 0}],
        goal=[{"predicate": "iscut", "args": ["lettuce"], "ids": [1]}],
    )
    policy = PlannerPolicy(world, "robot1")
    assert policy.has_plan
    assert all(policy.act(world.initial) is None for _ in range(9))
    assert not policy.has_plan


STACK = [
    {"predicate": "ispancake", "args": ["pancake"], "ids": [1]},
    {"predicate": "atop", "args": ["pancake", "pancake"], "ids": [2, 1]},
]


def pancake_steps(seats: int, **kitchen: Any) -> int:
    """The steps that planners in so many seats take to the goal in a domain of their own."""
    world = pancake_kitchen(**kitchen)
    players = world.players[:seats]
    policies = {p: PlannerPolicy(World(world.task), p, alone=seats == 1) for p in players}
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
    first_quickly(
        [
            (10, 1, {}),
            (12, 2, {"players": 2}),
            (10, 1, {"players": 2}),
            (22, 1, {"batter": 2, "goal": STACK}),
        ],
        2,
    ),
)
def test_where_an_object_takes_the_place_of_another(
    most: int, seats: int, kitchen: dict[str, Any]
) -> None:
    """Batter becomes a pancake: what the goal wants is still to be made of something else."""
    assert pancake_steps(seats, **kitchen) <= most


@pytest.mark.parametrize("seats", [1, 2])
def test_where_a_beam_search_is_blind_a_plan_is_found_otherwise(
    monkeypatch: pytest.MonkeyPatch, seats: int
) -> None:
    nothing = Solution(Plan(()), False, 9.0, 1)
    monkeypatch.setattr(BeamPlanner, "solve", lambda *_, **__: nothing)
    assert pancake_steps(seats, players=seats) <= 14


def test_a_bot_notes_that_it_finds_no_plan_and_prints_nothing(
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


@pytest.mark.slow
def test_the_shipped_pancakes_are_made() -> None:
    """The dish of the page on formats: nothing of it is known to any planner beforehand."""
    outcome = play("examples/pancakes", Clock.TURN, limit=60)
    assert outcome.reason == "goal"
