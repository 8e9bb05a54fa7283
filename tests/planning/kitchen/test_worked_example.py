"""The worked example of `robotouille.planners.kitchen.heuristic`, number by number."""

from __future__ import annotations

from robotouille import World
from robotouille.planners.kitchen.heuristic.cycle_packing import cycle_packing
from robotouille.planners.kitchen.heuristic.lower_bound import heuristic, longest_chain
from robotouille.planners.kitchen.heuristic.obstacles import clearing_work
from robotouille.planners.kitchen.heuristic.scratch import Scratch, new_scratch
from robotouille.planners.kitchen.kernels import record
from robotouille.planners.kitchen.solver import KitchenSearch, kitchen_search
from robotouille.planning.solvers import solve
from tests.planning.kitchen.rows import placed, row, term
from tests.world.kitchens import kitchen

STATIONS = "board table table table table"
THINGS = {"cheese": 0, "bread": 1, "lettuce": 2, "tomato": 2}
GOAL = [
    ("item_on", "bread+1 table+2"),
    ("iscut", "lettuce+3"),
    ("atop", "lettuce+3 bread+1"),
    ("atop", "cheese+4 lettuce+3"),
]


def one_cook() -> World:
    things = " ".join(f"{kind}@{place}" for kind, place in THINGS.items())
    return row(STATIONS, *GOAL, things=things, at=1, num_cuts=2)


def two_cooks() -> World:
    items = [{"name": kind, "x": x, "y": 0, "stack-level": int(kind == "tomato"),
              "predicates": ["iscuttable"] if kind == "lettuce" else []}
             for kind, x in THINGS.items()]  # fmt: skip
    players = [{"name": "robot", "x": x, "y": 1, "direction": [0, -1]} for x in (1, 3)]
    return kitchen(
        width=5,
        stations=placed((kind, x) for x, kind in enumerate(STATIONS.split())),
        items=items,
        players=players,
        config={"num_cuts": {"default": 2}},
        goal=[term(predicate, arguments) for predicate, arguments in GOAL],
    )


def estimated(world: World) -> tuple[KitchenSearch, Scratch, int]:
    """A search, what the parts of its heuristic noted, and the heuristic."""
    search, scratch = kitchen_search(world, world.initial), record(new_scratch())
    assert search is not None
    assert len(search.goals) == 1
    found = heuristic(search.model.record, search.goals[0], search.compact, scratch)
    return search, scratch, found


def test_work() -> None:
    search, scratch, found = estimated(one_cook())
    kitchen, goal, state = search.model.record, search.goals[0], search.compact
    work = {name: scratch.work[o] for o, name in enumerate(search.model.objects)}
    assert work == {"bread1": 0, "lettuce1": 9, "cheese1": 4, "tomato1": 4}
    assert clearing_work(kitchen, state, scratch) == 0
    assert cycle_packing(kitchen, goal, state, scratch) == 4
    assert found == 21


def test_chain() -> None:
    search, scratch, _ = estimated(one_cook())
    chains = {name: scratch.chain[o] for o, name in enumerate(search.model.objects)}
    assert chains == {"bread1": 0, "lettuce1": 9, "cheese1": 4, "tomato1": 0}
    assert longest_chain(search.model.record, search.goals[0], scratch) == 13


def test_the_shortest_plan_is_as_long() -> None:
    answer = solve(one_cook())
    assert answer.plan is not None
    assert len(answer.plan) == answer.bound == 21


def test_two_cooks() -> None:
    search, scratch, found = estimated(two_cooks())
    assert sum(scratch.work[: search.model.kitchen.objects]) == 17
    assert longest_chain(search.model.record, search.goals[0], scratch) == 11
    assert found == 11
