"""Shipped tasks, teams, limits and goals that cannot be reached."""

from __future__ import annotations

from typing import Any

import pytest

from robotouille import World, load_task
from robotouille.planning.search.astar import astar_search
from robotouille.planning.search.heuristics import BLIND, CriticalPath, LandmarkCut
from robotouille.planning.search.relaxation.relaxed_task import Relaxation
from robotouille.planning.search.relaxation.schema_grounding import TooLargeError
from robotouille.planning.search.symmetry import interchangeable
from robotouille.planning.search.unsolvable import unreachable_goal
from robotouille.planning.search_result import Limits, Proof, SearchResult
from robotouille.planning.validation import replay
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
        ("synchronous/04", 11),
        ("asynchronous/06", 19),
        pytest.param("workshop/01", 18, marks=pytest.mark.slow),
    ],
)
def test_shipped_tasks(name: str, length: int) -> None:
    world = World(load_task(name))
    check(world, astar_search(world), length)


@pytest.mark.parametrize(("name", "length"), [("synchronous/02", 14), ("training/01", 18)])
def test_without_estimates(name: str, length: int) -> None:
    world = World(load_task(name))
    answer = astar_search(world, heuristic=BLIND)
    check(world, answer, length)
    assert answer.proof is Proof.EXHAUSTED


@pytest.mark.slow
def test_estimates_save_work() -> None:
    world = World(load_task("synchronous/02"))
    guided = astar_search(world, symmetry=False)
    check(world, guided, 14)
    assert guided.expansions * 5 < astar_search(world, heuristic=BLIND, symmetry=False).expansions


@pytest.mark.slow
def test_symmetry_saves_work() -> None:
    world = World(load_task("synchronous/02"))
    assert astar_search(world).expansions * 2 < astar_search(world, symmetry=False).expansions


@pytest.mark.parametrize("seat", [0, 1])
def test_one_uses_what_another_did_in_the_same_step(seat: int) -> None:
    """One cook leaves a place, and in the same step the other one takes it."""
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


@pytest.mark.parametrize("timing", ["benchmark", "people"])
def test_all_ways_to_search_agree(timing: str) -> None:
    world = team_kitchen(timing)
    answers = [astar_search(world, heuristic=guide) for guide in (None, BLIND, CriticalPath(world))]
    assert all(answer.optimal for answer in answers)
    assert len({answer.bound for answer in answers}) == 1


def test_a_busy_player_waits() -> None:
    world = team_kitchen("people")
    state = act(world.initial, "move", "robot1", "table1", "board1")
    assert state.busy_steps("robot1") > 0
    answer = astar_search(world, state)
    assert answer.optimal
    assert answer.plan is not None
    assert replay(answer.plan, world, state).ok


def test_nothing_to_do() -> None:
    world = kitchen(goal=[{"predicate": "loc", "args": ["robot", "table"], "ids": [1, 2]}])
    check(world, astar_search(world), 0)


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


def test_an_impossible_goal() -> None:
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


def test_progress_is_told() -> None:
    told: list[tuple[int, int, int | None]] = []
    world = World(load_task("training/01"))
    astar_search(world, heuristic=BLIND, watch=lambda *news: told.append(news))
    assert told
    assert [bound for _, bound, _ in told] == sorted(bound for _, bound, _ in told)
    assert all(bound <= 18 for _, bound, _ in told)


def test_created_objects_without_end() -> None:
    """A pot is filled, emptied into the other one and filled again, for ever."""
    world = kitchen(
        containers=[{"name": "pot", "x": 5, "y": 0}, {"name": "bowl", "x": 0, "y": 0}],
        players=[{"name": "robot", "x": 5, "y": 1, "direction": [0, -1]}],
        config={"fill_time": {"default": 1}},
        goal=[{"predicate": "in", "args": ["water", "bowl"], "ids": [1, 2]}],
    )
    answer = astar_search(world)
    check(world, answer, 5)
    assert astar_search(world, heuristic=BLIND).plan is not None


def test_large_goals() -> None:
    goal = [{"predicate": "clear", "args": ["bread"], "ids": [number]} for number in range(1, 301)]
    world = kitchen(items=[{"name": "bread", "x": 1, "y": 0}], goal=goal)
    assert astar_search(world, limits=Limits(states=200)).plan is None


def test_what_is_interchangeable() -> None:
    world = World(load_task("synchronous/01"))
    tables = tuple(f"table{n}" for n in range(1, 6))
    assert interchangeable(world) == [tables, ("bread1", "bread2")]
    walking = World(load_task("synchronous/01", timing="people"))
    assert interchangeable(walking) == [("bread1", "bread2")]


def test_what_holds_anyway_is_not_to_blame() -> None:
    world = kitchen(
        stations=[{"name": "table", "x": 0, "y": 0}],
        goal=[
            {"predicate": "loc", "args": ["robot", "board"], "ids": [1, 2]},
            {"predicate": "nothing", "args": ["robot"], "ids": [1]},
        ],
    )
    assert unreachable_goal(world) == ("robot stands at board",)


def test_where_so_much_is_created_that_a_relaxation_is_too_large(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The goal is one step away at least, and A* goes on."""
    world = World(load_task("synchronous/01"))
    heuristic = LandmarkCut(world)

    def too_large(*_: object) -> None:
        raise TooLargeError

    monkeypatch.setattr(Relaxation, "task", too_large)
    assert heuristic(world.initial.facts, world.initial.timers) == 1
    assert len(astar_search(world, heuristic=heuristic).plan or ()) == 8
