"""Greedy best-first search finds plans that replay, for teams and parts of them, within limits."""

from __future__ import annotations

import pytest

from robotouille import World
from robotouille.planning.plan import Plan
from robotouille.planning.search.greedy import greedy_search
from robotouille.planning.search_result import Limits
from robotouille.planning.validation import replay
from tests.support.pancakes import pancake_kitchen
from tests.world.kitchens import kitchen


@pytest.mark.parametrize(
    "world",
    [
        pancake_kitchen(),
        pancake_kitchen(players=2),
        World("workshop/01"),
        World("synchronous/01"),
        World("synchronous/05"),
    ],
    ids=lambda world: f"{world.task.name}@{world.task.seats}",
)
def test_plans_replay(world: World) -> None:
    found = greedy_search(world, world.initial, limits=Limits(expansions=500))
    assert found.plan is not None
    assert replay(found.plan, world).ok
    assert (found.bound, found.unsolvable) == (0, False)


def test_a_part_of_a_team_plans_for_itself() -> None:
    world = pancake_kitchen(players=2)
    found = greedy_search(world, world.initial, team=["robot1"])
    assert found.plan is not None
    assert found.plan.share("robot2") == 0
    assert replay(found.plan, world).ok


@pytest.mark.slow
def test_what_a_part_of_a_team_cannot_do_is_not_said_to_be_unsolvable() -> None:
    """robot2 stands where batter lies that robot1 needs."""
    goal = [
        {"predicate": "ispancake", "args": ["pancake"], "ids": [1]},
        {"predicate": "atop", "args": ["pancake", "pancake"], "ids": [2, 1]},
    ]
    world = pancake_kitchen(batter=2, players=2, goal=goal)
    found = greedy_search(world, world.initial, team=["robot1"])
    assert (found.plan, found.unsolvable) == (None, False)


def test_unsolvable_if_every_state_was_seen() -> None:
    world = kitchen(
        items=[{"name": "lettuce", "x": 0, "y": 0}],
        goal=[{"predicate": "iscut", "args": ["lettuce"], "ids": [1]}],
    )
    assert greedy_search(world, world.initial).unsolvable
    limited = greedy_search(
        World("synchronous/05"), World("synchronous/05").initial, limits=Limits(2)
    )
    assert (limited.plan, limited.unsolvable, limited.expansions) == (None, False, 2)
    full = greedy_search(
        World("synchronous/05"), World("synchronous/05").initial, limits=Limits(None, 20)
    )
    assert (full.plan, full.unsolvable) == (None, False)


def test_nothing_to_do() -> None:
    world = World("synchronous/01")
    end = replay(greedy_search(world, world.initial).plan or Plan(()), world).final
    assert greedy_search(world, end).plan == Plan(())
