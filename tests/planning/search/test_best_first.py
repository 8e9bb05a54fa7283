"""A* and greedy search: shipped tasks, teams, limits and unreachable goals."""

from __future__ import annotations

from typing import Any

import pytest

from robotouille import World, load_task
from robotouille.planning.plan import Limits, Proof, SearchResult, replay
from robotouille.planning.search.best_first import astar_search, greedy_search
from robotouille.planning.search.heuristics import BLIND, CriticalPath, LandmarkCut
from robotouille.planning.search.unsolvable import unreachable_goal
from tests.support.pancakes import pancake_kitchen
from tests.world.kitchens import act, kitchen

SANDWICH = [
    {"predicate": "item_on", "args": ["bread", "table"], "ids": [1, 2]},
    {"predicate": "atop", "args": ["lettuce", "bread"], "ids": [3, 1]},
]
TWO_COOKS = [
    {"name": "robot", "x": 0, "y": 1, "direction": [0, -1]},
    {"name": "robot", "x": 1, "y": 1, "direction": [0, -1]},
]


def team_kitchen(timing: str = "benchmark") -> World:
    return kitchen(
        timing=timing,
        width=4,
        height=2,
        stations=[{"name": n, "x": x, "y": 0} for x, n in enumerate(["table", "table", "board"])],
        items=[{"name": "bread", "x": 0, "y": 0}, {"name": "lettuce", "x": 2, "y": 0}],
        players=TWO_COOKS,
        goal=SANDWICH,
    )


def check(world: World, answer: SearchResult, length: int) -> None:
    assert answer.optimal
    assert answer.plan is not None
    assert len(answer.plan) == length
    assert replay(answer.plan, world).ok


@pytest.mark.parametrize(
    ("name", "length"),
    [
        ("synchronous/01", 8),
        ("synchronous/02", 14),
        pytest.param("synchronous/04", 11, marks=pytest.mark.slow),
        pytest.param("asynchronous/06", 19, marks=pytest.mark.slow),
        pytest.param("workshop/01", 18, marks=pytest.mark.slow),
    ],
)
def test_shipped_tasks_are_solved(name: str, length: int) -> None:
    world = World(load_task(name))
    check(world, astar_search(world), length)


@pytest.mark.parametrize(("name", "length"), [("synchronous/02", 14), ("training/01", 18)])
def test_blind_search_finds_the_same_lengths(name: str, length: int) -> None:
    world = World(load_task(name))
    answer = astar_search(world, heuristic=BLIND)
    check(world, answer, length)
    assert answer.proof is Proof.EXHAUSTED


@pytest.mark.parametrize("seat", [0, 1])
def test_player_uses_an_earlier_action_of_the_same_step(seat: int) -> None:
    places = ["table", "board"]
    players: list[dict[str, Any]] = [
        {"name": "robot", "x": x, "y": 1, "direction": [0, -1]} for x in range(2)
    ]
    players[seat]["id"] = "me"
    world = kitchen(
        stations=[{"name": n, "x": x, "y": 0} for x, n in enumerate([*places, "stove"])],
        players=players,
        goal=[{"predicate": "loc", "args": ["robot", places[1 - seat]], "ids": ["me", 2]}],
    )
    for guide in (None, BLIND, CriticalPath(world)):
        answer = astar_search(world, heuristic=guide)
        check(world, answer, 1)


def test_a_busy_player_waits() -> None:
    world = team_kitchen("people")
    state = act(world.initial, "move", "robot1", "table1", "board1")
    assert state.busy_steps("robot1") > 0
    answer = astar_search(world, state)
    assert answer.optimal
    assert answer.plan is not None
    assert replay(answer.plan, world, state).ok


def test_waiting_is_part_of_a_plan() -> None:
    world = kitchen(
        items=[{"name": "patty", "x": 0, "y": 0, "predicates": ["iscookable"]}],
        stations=[{"name": "stove", "x": 0, "y": 0}],
        config={"cook_time": {"default": 4}},
        goal=[{"predicate": "iscooked", "args": ["patty"], "ids": [1]}],
    )
    answer = astar_search(world)
    check(world, answer, 5)
    assert answer.plan is not None
    assert answer.plan.actions == 1
    assert LandmarkCut(world)(world.initial.facts, world.initial.timers) == 5


def test_impossible_goal_is_unsolvable() -> None:
    bread = [{"name": "bread", "x": 1, "y": 0}]
    cut = {"predicate": "iscut", "args": ["bread"], "ids": [1]}
    clear = {"predicate": "clear", "args": ["bread"], "ids": [1]}
    held = {"predicate": "has_item", "args": ["robot", "bread"], "ids": [2, 1]}
    world = kitchen(items=bread, goal=[cut, clear])
    answer = astar_search(world)
    assert answer.unsolvable
    assert not answer.expansions
    assert unreachable_goal(world) == ("bread has been cut",)
    world = kitchen(items=bread, goal=[held, clear])
    assert astar_search(world).unsolvable
    assert astar_search(world, heuristic=BLIND).unsolvable
    assert unreachable_goal(world) == ()


def test_limits_leave_a_proven_bound() -> None:
    world = World(load_task("synchronous/02"))
    for limits in (Limits(expansions=20), Limits(states=50), Limits(stop=lambda: True)):
        answer = astar_search(world, limits=limits)
        assert answer.bound <= 14
        assert not answer.unsolvable
        if limits.stop is None:
            assert answer.plan is None
            assert answer.bound >= 9
    blind = astar_search(world, heuristic=BLIND, limits=Limits(states=1000), symmetry=False)
    assert 1 < blind.bound < 14


def test_endless_creation_of_objects() -> None:
    world = kitchen(
        containers=[{"name": "pot", "x": 5, "y": 0}, {"name": "bowl", "x": 0, "y": 0}],
        players=[{"name": "robot", "x": 5, "y": 1, "direction": [0, -1]}],
        config={"fill_time": {"default": 1}},
        goal=[{"predicate": "in", "args": ["water", "bowl"], "ids": [1, 2]}],
    )
    answer = astar_search(world)
    check(world, answer, 5)
    assert astar_search(world, heuristic=BLIND).plan is not None


def test_true_predicates_are_not_reported_as_unreachable() -> None:
    world = kitchen(
        stations=[{"name": "table", "x": 0, "y": 0}],
        goal=[
            {"predicate": "loc", "args": ["robot", "board"], "ids": [1, 2]},
            {"predicate": "nothing", "args": ["robot"], "ids": [1]},
        ],
    )
    assert unreachable_goal(world) == ("robot stands at board",)


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


def test_part_of_a_team_plans_for_itself() -> None:
    world = pancake_kitchen(players=2)
    found = greedy_search(world, world.initial, team=["robot1"])
    assert found.plan is not None
    assert found.plan.share("robot2") == 0
    assert replay(found.plan, world).ok


@pytest.mark.slow
def test_failure_of_part_of_a_team_proves_nothing() -> None:
    goal = [
        {"predicate": "ispancake", "args": ["pancake"], "ids": [1]},
        {"predicate": "atop", "args": ["pancake", "pancake"], "ids": [2, 1]},
    ]
    world = pancake_kitchen(batter=2, players=2, goal=goal)
    found = greedy_search(world, world.initial, team=["robot1"])
    assert (found.plan, found.unsolvable) == (None, False)


def test_unsolvable_after_visiting_every_state() -> None:
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
