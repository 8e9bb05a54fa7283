"""Brute force agrees: heuristics, lengths and proofs on random kitchens, from any state of theirs.

`ROBOTOUILLE_ORACLE_TASKS=5000` tries as many kitchens more, larger ones and new ones each time.
"""

from __future__ import annotations

import os
import random

import pytest

from robotouille import World
from robotouille.planners.kitchen.solver import kitchen_search
from tests.planning.kitchen.exact import check_answer, check_heuristic, explored
from tests.planning.kitchen.random_kitchens import random_kitchen
from tests.support.samples import first_quickly

ORDERED = int(os.environ.get("ROBOTOUILLE_ORACLE_TASKS", "0"))
SAMPLE = 14
BLOCK = 20


SMALL = {
    "sandwich": [13, 15, 17, 25, 32, 33, 34],
    "stack": [7, 13, 15, 18, 21, 36],
    "loose pieces": [35, 37, 40, 52, 55, 59, 64],
    "side dish": [4, 5, 20, 22, 36, 103],
    "two plates": [20, 30, 36, 51],
    "soup": [6, 55, 86, 121, 164, 201],
    "soup with more vessels": [137, 200, 222, 241, 246, 259],
    "two soups": [14, 28, 31, 32, 37, 67],
    "soup and sandwich": [6, 70],
}
"""Seeds of kitchens with some hundreds of states."""


def check_kitchen(seed: int, cap: int, sample: int) -> bool:
    """Answers from some states; False if there are too many states."""
    world = World(random_kitchen(seed))
    found = explored(world, cap)
    if found is None or kitchen_search(world, world.initial) is None:
        return False
    rng = random.Random(seed)
    numbers = {0, *rng.sample(range(len(found.states)), min(sample, len(found.states)))}
    for number in sorted(numbers):
        check_heuristic(found.states[number], found.distances[number])
        check_answer(found.states[number], found.distances[number])
    return True


def small_kitchens() -> list[object]:
    """Dishes and seeds of `SMALL`: the first of a few are quickly done, all together are not."""
    firsts = [(dish, seeds[0]) for dish, seeds in SMALL.items()]
    others = [(dish, seed) for dish, seeds in SMALL.items() for seed in seeds[1:]]
    return first_quickly([*firsts, *others], 4, nightly=3 * len(firsts))


@pytest.mark.parametrize("block", first_quickly(range(16), 1, nightly=4))
def test_answers(block: int) -> None:
    checked = [check_kitchen(1000 * block + n, 1000, SAMPLE) for n in range(BLOCK)]
    assert sum(checked) > 2


@pytest.mark.parametrize(("dish", "seed"), small_kitchens())
def test_heuristics_of_all_states(dish: str, seed: int) -> None:
    """Of every state that can be reached."""
    found = explored(World(random_kitchen(seed, dish=dish)), 1000)
    assert found is not None
    for state, distance in zip(found.states, found.distances, strict=True):
        assert check_heuristic(state, distance)


@pytest.mark.skipif(not ORDERED, reason="ROBOTOUILLE_ORACLE_TASKS orders no more")
def test_many_more() -> None:
    first = random.randrange(1 << 40)
    for seed in range(first, first + ORDERED):
        check_kitchen(seed, 20_000, 40)


@pytest.mark.skipif(not ORDERED, reason="ROBOTOUILLE_ORACLE_TASKS orders no more")
def test_heuristics_of_many_more_states() -> None:
    first = random.randrange(1 << 40)
    for seed in range(first, first + ORDERED):
        found = explored(World(random_kitchen(seed)), 20_000)
        for state, distance in zip(found.states, found.distances, strict=True) if found else ():
            check_heuristic(state, distance)
