"""Compact states and their transitions mean what the world's do."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotouille import State, World, load_task, task_names
from robotouille.domain.task import read_domain
from robotouille.planners.kitchen.compact_state import (
    ADD,
    BOIL,
    FILL,
    LOOSE,
    PICK,
    PLACE,
    POUR,
    PROCESS,
    PUT,
    ROOT,
    ROWS,
    SIZE,
    WORDS,
)
from robotouille.planners.kitchen.decode import decode
from robotouille.planners.kitchen.goal_assignments import goals_of
from robotouille.planners.kitchen.kernels import Ints, ints, zeros
from robotouille.planners.kitchen.model import KitchenModel, model_of
from robotouille.planners.kitchen.recognition import recognise
from robotouille.planners.kitchen.solver import KitchenSearch, kitchen_search
from robotouille.planners.kitchen.transitions import act, options, pack, spot, tick, unpack
from robotouille.planning.plan import Plan
from robotouille.planning.search_result import Limits
from tests.planning.kitchen.random_kitchens import DISHES, random_kitchen
from tests.world.kitchens import kitchen

ALONE = [
    name
    for name in task_names()
    if name.startswith(("synchronous/", "asynchronous/", "training/"))
    and load_task(name).seats == 1
]


def walk(world: World, rng: random.Random, steps: int) -> Iterator[KitchenSearch]:
    """A search from every state of a course of play at random, in which things get on."""
    state = world.initial
    for _ in range(steps):
        search = kitchen_search(world, state)
        if search is None or not search.goals[ROWS]:
            return
        yield search
        useful = (
            list(possible(search, rng.randrange(search.goals[ROWS]))) if search.goals[ROWS] else []
        )
        progress = [action for action, _ in useful if action % 16 not in (PICK, PUT)]
        if useful and rng.random() < 0.8:
            action = (
                rng.choice(progress) if progress and rng.random() < 0.5 else rng.choice(useful)[0]
            )
            state = after_plan(state, decode(search.model, state, list(search.code), [[action]]))
        else:
            state = world.successor(state, rng.choice(state.actions(world.players[0])))


def on_the_way(world: World) -> Iterator[KitchenSearch]:
    """A search from every state of a shortest course of play."""
    state, search = world.initial, kitchen_search(world, world.initial)
    plan = search.solve(Limits(expansions=400)).plan if search is not None else None
    for joint in plan or ():
        search = kitchen_search(world, state)
        assert search is not None
        yield search
        state = state.step(joint).state


def after_plan(state: State, plan: Plan) -> State:
    for joint in plan:
        step = state.step(joint)
        assert all(attempt.applied for attempt in step.attempts), step.attempts
        state = step.state
    return state


def after(search: KitchenSearch, row: int, action: int, here: bool) -> Ints:
    """The compact state after an action, and after the walk before it."""
    k, s = search.model.kitchen, ints(search.code)
    s[ROOT] = row
    if not here:
        tick(k, s)
        s[k[PLACE]] = spot(k, s, action)
    act(k, s, 0, action)
    tick(k, s)
    return s


def possible(search: KitchenSearch, row: int) -> Iterator[tuple[int, bool]]:
    """What the player can do, here and elsewhere."""
    k, out = search.model.kitchen, zeros(1024)
    for here in (True, False):
        s = ints(search.code)
        s[ROOT] = row
        if not here:
            tick(k, s)
        for i in range(options(k, search.goals, s, 0, here, out, 0)):
            yield int(out[i]), here


def same_kitchen(model: KitchenModel, state: State) -> KitchenModel:
    """The model of an earlier state, with names for the meals made since."""
    return replace(model, meals=[o.name for o in state.objects if o.type == "meal"])


def check_transitions(search: KitchenSearch, row: int) -> list[int]:
    """Each action that is possible leads where the world leads; their kinds."""
    kinds = []
    for action, here in possible(search, row):
        plan = decode(search.model, search.start, list(search.code), [[action]])
        assert len(plan) == (1 if here else 2)
        state = after_plan(search.start, plan)
        expected = same_kitchen(search.model, state).encode(state)
        found = list(after(search, row, action, here))
        found[ROOT] = expected[ROOT]
        found[LOOSE] = expected[LOOSE]
        assert found == expected, (search.start.fact_names(), list(map(str, plan)))
        kinds.append(action % 16)
    return kinds


@pytest.mark.parametrize("dish", sorted(DISHES))
def test_actions_lead_where_the_world_leads(dish: str) -> None:
    kinds: set[int] = set()
    for seed in range(20):
        rng, world = random.Random(seed), World(random_kitchen(seed, dish=dish))
        for search in chain(walk(world, rng, 25), on_the_way(world)):
            kinds.update(check_transitions(search, rng.randrange(search.goals[ROWS])))
    assert kinds >= ({PICK, PUT, FILL, BOIL, ADD, POUR} if "soup" in dish else {PICK, PUT, PROCESS})


@pytest.mark.parametrize("name", ["synchronous/09", "asynchronous/05", "asynchronous/10"])
def test_in_shipped_kitchens(name: str) -> None:
    rng = random.Random(1)
    found = [
        check_transitions(search, rng.randrange(search.goals[ROWS]))
        for search in walk(World(name), rng, 30)
    ]
    assert sum(map(len, found)) > 100


def test_time_that_passes() -> None:
    """Where nobody acts the counters run, and water is made."""
    for seed in range(40):
        for search in walk(World(random_kitchen(seed)), random.Random(seed), 15):
            s = ints(search.code)
            tick(search.model.kitchen, s)
            later = search.start.step([]).state
            expected = same_kitchen(search.model, later).encode(later)
            assert list(s) == expected


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10_000), steps=st.integers(1, 40))
def test_keys_round_trip(seed: int, steps: int) -> None:
    """A state comes back from its key, and different states have different keys."""
    world = World(random_kitchen(seed))
    keys: dict[tuple[int, ...], list[int]] = {}
    model = model_of(world, world.initial)
    assert model is not None
    k = model.kitchen
    for search in walk(world, random.Random(seed), steps):
        state = search.start
        if any(o.type == "meal" and o.name not in model.meals for o in state.objects):
            return
        code = model.encode(state)
        key, back = zeros(k[WORDS] + 3), zeros(k[SIZE])
        pack(k, ints(code), key, 3)
        unpack(k, key, 3, back)
        assert list(back) == code
        assert keys.setdefault(tuple(key), code) == code


@pytest.mark.parametrize("name", ALONE)
def test_shipped_kitchens_are_recognised(name: str) -> None:
    world = World(load_task(name))
    assert recognise(world.task.domain) is not None
    assert kitchen_search(world, world.initial) is not None


def test_there_are_shipped_kitchens_for_one() -> None:
    assert len(ALONE) >= 20


def test_a_workshop_is_no_kitchen() -> None:
    assert recognise(read_domain("workshop")) is None
    world = World("workshop/01")
    assert kitchen_search(world, world.initial) is None


def test_people_walk_step_by_step() -> None:
    world = World(load_task("synchronous/01", timing="people"))
    assert kitchen_search(world, world.initial) is None


def choices(world: World) -> int:
    """How many choices of objects are searched."""
    model = model_of(world, world.initial)
    assert model is not None
    goals = goals_of(model, model.encode(world.initial))
    assert goals is not None
    return int(goals[ROWS])


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


@pytest.mark.parametrize(
    ("world", "count"),
    [
        (lettuces(1, 2, 3), 1),
        (lettuces(0, 1, 2), 2),
        (lettuces(1, 2, 4), 2),
        (lettuces(1, 2, 3, cuttable=1), 2),
        (lettuces(1, 1, 1, level=1), 3),
    ],
    ids=["alike", "one is here", "one is on the board", "one is different", "a pile"],
)
def test_objects_that_are_alike_are_one_choice(world: World, count: int) -> None:
    assert choices(world) == count


def test_pieces_of_a_shipped_kitchen_that_are_alike() -> None:
    assert choices(World("synchronous/01")) == 1
