"""While somebody stands in the way, bots do first what needs no way."""

from __future__ import annotations

import pytest

from robotouille import State, World, load_task
from robotouille.episode import Clock
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.plan import Plan
from robotouille.planning.policies.deferral import defer_blocked
from robotouille.planning.policies.making_way import with_others_aside
from robotouille.planning.search_result import Limits
from tests.support.team_games import Idle, play_team


def planned(task: str, person: str) -> tuple[Plan, State, State, list[str]]:
    """A plan as if a person had walked aside, the state for it, and the one in which they stand."""
    world = World(task)
    team = [player for player in world.players if player != person]
    here = world.initial
    aside = with_others_aside(here, [person])
    found = next(
        AnytimePlanner(world).search(aside, Limits(expansions=1), team=team, beam=1_000, brief=True)
    )
    assert found.plan is not None
    return found.plan, aside, here, team


def after(plan: Plan, state: State) -> State:
    for joint in plan:
        state = state.step(list(joint)).state
    return state


def possible(plan: Plan, state: State) -> int:
    """The deeds of one player's plan before the first action that is not possible."""
    deeds = 0
    for joint in plan:
        for action in joint:
            if not state.world.applicable(state, action):
                return deeds
            deeds += action.destination is None
        state = state.step(list(joint)).state
    return deeds


@pytest.mark.parametrize(
    ("task", "person"), [("02@2", "robot1"), ("10@2", "robot1"), ("04@2", "robot1")]
)
def test_what_can_be_done_comes_first(task: str, person: str) -> None:
    plan, aside, here, team = planned(f"multi_agent/{task}", person)
    other = defer_blocked(plan, aside, here, team)
    assert after(other, aside).goal_reached
    assert possible(other, here) > possible(plan, here)
    assert len(other) <= len(plan) + 6


@pytest.mark.parametrize("task", ["07@4", "03@3", "04@4"])
def test_whatever_the_order_it_leads_to_the_goal(task: str) -> None:
    plan, aside, here, team = planned(f"multi_agent/{task}", "robot1")
    assert after(defer_blocked(plan, aside, here, team), aside).goal_reached


def test_where_nobody_is_in_the_way_nothing_changes() -> None:
    plan, aside, _, team = planned("multi_agent/02@2", "robot1")
    assert defer_blocked(plan, aside, aside, team) is plan


def test_a_bot_cuts_and_stacks_while_a_person_stands_at_the_stove() -> None:
    game = play_team(
        load_task("multi_agent/02@2", timing="people"),
        {"robot1": Idle("robot1")},
        clock=Clock.REALTIME,
        limit=120,
    )
    done = [str(action) for did in game.steps for _, action, applied in did if applied]
    assert "stack(robot2, lettuce1, bottombun1, table3)" in done
    assert sum(each.startswith("cut(") for each in done) == 6
