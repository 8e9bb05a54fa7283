"""Seats that plan for themselves finish together, and with partners who do as they like."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest

from robotouille import GroundAction, State, World, load_task, task_names
from robotouille.episode import Clock, Episode, Outcome, Phase, Rules, Stepped
from robotouille.planning.policy import PlannerPolicy
from robotouille.planning.script import Did

MULTI = [name for name in task_names() if name.startswith("multi_agent/")]


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


@pytest.mark.parametrize("name", MULTI)
def test_a_team_of_two_is_faster_than_one_could_be(name: str) -> None:
    outcome = play(name, Clock.LOCKSTEP)
    assert outcome.success
    assert all(tally.applied > 5 for tally in outcome.seats)
    assert outcome.steps <= 60


@pytest.mark.parametrize("name", ["multi_agent/01@3", "multi_agent/05@4", "multi_agent/07@3"])
def test_larger_teams(name: str) -> None:
    assert play(name, Clock.LOCKSTEP).success


@pytest.mark.parametrize("name", ["multi_agent/01@3", "multi_agent/04@2", "multi_agent/07@4"])
def test_turn_by_turn(name: str) -> None:
    assert play(name, Clock.TURN, limit=600).success


@pytest.mark.parametrize("name", ["multi_agent/01", "multi_agent/04", "multi_agent/07"])
def test_in_real_time_where_walking_takes_time(name: str) -> None:
    assert play(name, Clock.REALTIME, timing="people", limit=900).success


@pytest.mark.parametrize("partner", [Chance, Idler])
@pytest.mark.parametrize("name", ["multi_agent/01", "multi_agent/05"])
def test_with_a_partner_who_is_no_help(name: str, partner: type[Chance]) -> None:
    assert play(name, Clock.LOCKSTEP, partner=partner).success


def test_one_seed_one_course() -> None:
    first, second = (play("multi_agent/03", Clock.LOCKSTEP) for _ in range(2))
    assert first == second
