"""Recognition of kitchens that the planner accepts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from robotouille import Task, World, load_task
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task, read_domain
from robotouille.installation import data_folder
from robotouille.planning.kitchen.recognition import recognise
from robotouille.planning.kitchen.solver import PLANNER, kitchen_search
from robotouille.planning.plan import Limits
from robotouille.planning.solvers import solve
from tests.world.kitchens import kitchen, problem

Json = dict[str, Any]


def changed(name: str, **fields: Any) -> Task:
    """Return a shipped task with other fields of its problem."""
    task = load_task(name)
    raw = json.loads(Path(task.source).read_text())
    return build_task("changed", task.domain, ProblemFile.model_validate({**raw, **fields}))


def is_left_to_others(task: Task) -> bool:
    world = World(task)
    return kitchen_search(world, world.initial) is None


def test_uneven_pots_are_declined() -> None:
    pots = [
        {"name": "pot", "x": 0, "y": 2},
        {"name": "pot", "x": 4, "y": 1},
        {"name": "bowl", "x": 0, "y": 1},
    ]
    goal = [{"predicate": "in", "args": ["water", "bowl"], "ids": [1, 2]}]
    slow = {"fill_time": {"default": 1, "pot2": 25}}
    task = changed("asynchronous/06", containers=pots, goal=goal, config=slow)
    assert is_left_to_others(task)
    assert solve(World(task)).bound == 9


@pytest.mark.parametrize(
    "extra",
    [
        {"predicate": "item_on", "args": ["bread", "table"], "ids": [1, 9]},
        {"predicate": "atop", "args": ["bread", "cheese"], "ids": [1, 3]},
        {"predicate": "item_at", "args": ["cheese", "table"], "ids": [3, 9]},
    ],
)
def test_contradictory_goals_are_declined(extra: Json) -> None:
    goal = [
        {"predicate": "item_on", "args": ["bread", "table"], "ids": [1, 2]},
        {"predicate": "item_at", "args": ["cheese", "table"], "ids": [3, 2]},
        extra,
    ]
    assert is_left_to_others(changed("synchronous/01", goal=goal))


def test_too_long_plans_are_not_reported_as_unsolvable() -> None:
    whole = {"name": "lettuce", "stack-level": 0, "predicates": ["iscuttable"]}
    places = ((0, 1), (0, 2), (1, 4), (3, 4))
    lettuces = [{**whole, "x": x, "y": y} for x, y in places]
    goal = [{"predicate": "iscut", "args": ["lettuce"], "ids": [i]} for i in range(4)]
    slow = {"num_cuts": {"default": 60}}
    task = changed("synchronous/02", items=lettuces, goal=goal, config=slow)
    answer = solve(World(task), limits=Limits(expansions=200))
    assert not answer.unsolvable
    assert answer.bound >= 240


@pytest.mark.parametrize("needs", ["iscut", "iscooked"])
def test_chained_processes_are_declined(needs: str) -> None:
    raw = json.loads((data_folder("domains") / "robotouille.json").read_text())
    fry = next(a for a in raw["action_defs"] if a["name"] == "fry")
    for condition in fry["precons"]:
        if condition["predicate"] == "isfryable":
            condition["predicate"] = needs
    assert recognise(load_task("synchronous/01").domain) is not None
    assert recognise(DomainFile.model_validate(raw)) is None


def with_another_cooking(forbidden: str, fry_forbids: str = "") -> DomainFile:
    """Return the shipped domain, but a fact other than `iscooking` holds while items cook."""
    raw = json.loads((data_folder("domains") / "robotouille.json").read_text())
    cook = json.dumps(next(a for a in raw["action_defs"] if a["name"] == "cook"))
    for number, action in enumerate(raw["action_defs"]):
        if action["name"] == "cook":
            raw["action_defs"][number] = json.loads(cook.replace("iscooking", forbidden))
        if action["name"] == "fry" and fry_forbids:
            fry = cook.replace("iscooking", fry_forbids).replace("isstove", "isfryer")
            fry = fry.replace("iscookable", "isfryable").replace("iscooked", "isfried")
            raw["action_defs"][number] = {**json.loads(fry), "name": "fry"}
    return DomainFile.model_validate(raw)


@pytest.mark.parametrize(
    ("forbidden", "fry_forbids"),
    [("iscut", ""), ("iscuttable", ""), ("isfryableifcut", ""), ("isfryable", ""), ("clear", ""),
     ("iscooking", "iscooking"), ("iscooking", "iscooked")],
)  # fmt: skip
def test_facts_with_two_meanings_are_declined(forbidden: str, fry_forbids: str) -> None:
    assert recognise(with_another_cooking("iscooking")) is not None
    assert recognise(with_another_cooking(forbidden, fry_forbids)) is None


def test_item_is_cut_while_it_cooks() -> None:
    domain = with_another_cooking("iscut")
    goal = [{"predicate": "iscut", "args": ["chicken"], "ids": [1]}]
    items = [
        {"name": "chicken", "x": 3, "y": 0, "predicates": ["iscookable"]},
        {"name": "chicken", "x": 0, "y": 0, "predicates": ["iscuttable"]},
    ]
    players = [{"name": "robot", "x": 3, "y": 1, "direction": [0, -1]}]
    fields = problem(items=items, goal=goal, players=players)
    task = build_task("hot", domain, ProblemFile.model_validate(fields))
    answer = solve(World(task))
    assert answer.plan is not None
    assert (len(answer.plan), answer.optimal) == (1, True)


def one_item(kind: str, facts: list[str], goal: str) -> World:
    """Return a world with an item on a stove."""
    return kitchen(
        items=[{"name": kind, "x": 3, "y": 0, "predicates": facts}],
        goal=[{"predicate": goal, "args": [kind], "ids": [1]}],
    )


def test_item_that_cooks_without_a_delay_never_gets_cooked() -> None:
    answer = solve(one_item("patty", ["iscookable", "iscooking"], "iscooked"))
    assert answer.plan is None
    assert answer.unsolvable


def test_fried_item_need_not_be_cut() -> None:
    facts = ["iscuttable", "isfryableifcut", "isfried"]
    answer = solve(one_item("potato", facts, "isfried"))
    assert answer.plan is not None
    assert (len(answer.plan), answer.planner) == (0, PLANNER)


def test_pot_that_is_a_bowl_is_declined() -> None:
    pots = [{"name": "pot", "x": 5, "y": 0, "predicates": ["isbowl"]}]
    goal = [{"predicate": "isboiling", "args": ["water"], "ids": [1]}]
    world = kitchen(containers=pots, goal=goal)
    assert kitchen_search(world, world.initial) is None


@pytest.mark.parametrize(("boils", "steps"), [(True, 7), (False, 2)])
def test_meals_that_stay_in_a_pot_are_left_to_another_planner(boils: bool, steps: int) -> None:
    goal = [{"predicate": "in", "args": ["water", "pot"], "ids": [1, 2]}]
    if boils:
        goal.append({"predicate": "isboiling", "args": ["water"], "ids": [1]})
    world = kitchen(
        containers=[{"name": "pot", "x": 5, "y": 0}],
        players=[{"name": "robot", "x": 5, "y": 1, "direction": [0, -1]}],
        config={"fill_time": {"default": 1}, "boil_time": {"default": 1}},
        goal=goal,
    )
    answer = solve(world)
    assert answer.plan is not None
    assert (len(answer.plan), answer.optimal) == (steps, True)
    assert answer.planner != PLANNER


def test_workshop_is_not_a_kitchen() -> None:
    assert recognise(read_domain("workshop")) is None
    world = World("workshop/01")
    assert kitchen_search(world, world.initial) is None


def test_timing_for_people_is_declined() -> None:
    world = World(load_task("synchronous/01", timing="people"))
    assert kitchen_search(world, world.initial) is None


CUT = [{"predicate": "iscut", "args": ["lettuce"], "ids": [1]}]


def lettuces(*places: int, cuttable: int = 9, level: int = 0) -> World:
    items = [
        {"name": "lettuce", "x": x, "y": 0, "stack-level": level * number,
         "predicates": ["iscuttable"] if number < cuttable else []}
        for number, x in enumerate(places)
    ]  # fmt: skip
    stations = [{"name": kind, "x": x, "y": 0} for x, kind in enumerate(KINDS)]
    return kitchen(stations=stations, items=items, goal=CUT)


KINDS = ["table", "table", "table", "table", "board"]
