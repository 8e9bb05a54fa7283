"""Compact states and their transitions mean what the world's do."""

from __future__ import annotations

import random
from itertools import chain

import pytest

from robotouille import World
from robotouille.planners.kitchen.compact_state import (
    ADD,
    BOIL,
    FILL,
    PICK,
    POUR,
    PROCESS,
    PUT,
)
from robotouille.planners.kitchen.encode import encode
from robotouille.planners.kitchen.solver import KitchenSearch
from robotouille.planners.kitchen.transitions import (
    advance_timers,
)
from tests.planning.kitchen.courses import (
    after,
    after_plan,
    contents,
    copied,
    kind_of,
    on_the_way,
    possible,
    same_kitchen,
    walk,
)
from tests.planning.kitchen.random_kitchens import DISHES, random_kitchen
from tests.support.samples import first_quickly


def check_transitions(search: KitchenSearch, assignment: int) -> list[int]:
    """Each action that is possible leads where the world leads; their kinds."""
    kinds, kitchen = [], search.model.kitchen
    for action, here in possible(search, assignment):
        plan = search.plan([[(0, action)]])
        assert len(plan) == (1 if here else 2)
        state = after_plan(search.start, plan)
        expected = encode(same_kitchen(search.model, state), state)
        found = after(search, action, here)
        assert contents(kitchen, found) == contents(kitchen, expected), (
            search.start.fact_names(),
            list(map(str, plan)),
        )
        kinds.append(kind_of(action))
    return kinds


@pytest.mark.parametrize("seeds", first_quickly([10, 20], nightly=1))
@pytest.mark.parametrize("dish", first_quickly(sorted(DISHES), 3))
def test_actions_lead_where_the_world_leads(dish: str, seeds: int) -> None:
    kinds: set[int] = set()
    for seed in range(seeds):
        rng, world = random.Random(seed), World(random_kitchen(seed, dish=dish))
        for search in chain(walk(world, rng, 25), on_the_way(world)):
            kinds.update(check_transitions(search, rng.randrange(len(search.goals))))
    assert kinds >= ({PICK, PUT, FILL, BOIL, ADD, POUR} if "soup" in dish else {PICK, PUT, PROCESS})


@pytest.mark.parametrize("name", ["synchronous/09", "asynchronous/05", "asynchronous/10"])
def test_in_shipped_kitchens(name: str) -> None:
    rng = random.Random(1)
    found = [
        check_transitions(search, rng.randrange(len(search.goals)))
        for search in walk(World(name), rng, 30)
    ]
    assert sum(map(len, found)) > 100


@pytest.mark.slow
def test_time_that_passes() -> None:
    """Where nobody acts the counters run, and water is made."""
    for seed in range(40):
        for search in walk(World(random_kitchen(seed)), random.Random(seed), 15):
            state = copied(search)
            advance_timers(search.model.record, state)
            later = search.start.step([]).state
            expected = encode(same_kitchen(search.model, later), later)
            kitchen = search.model.kitchen
            assert contents(kitchen, state) == contents(kitchen, expected)
