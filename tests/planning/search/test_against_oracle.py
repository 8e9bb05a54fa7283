"""Comparison of lengths, proofs and bounds with brute force on many small tasks.

`ROBOTOUILLE_ORACLE_TASKS=5000` tries that number of tasks of each kind, new ones in each run.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from robotouille import Task, World
from robotouille.planning.plan import Limits, replay
from robotouille.planning.search.best_first import astar_search
from robotouille.planning.search.heuristics import BLIND, CriticalPath, Heuristic, LandmarkCut
from robotouille.planning.search.unsolvable import unreachable_goal
from tests.planning.search.small_tasks import deep_tasks, tiny_kitchens
from tests.support.oracle import Oracle, explore
from tests.support.thorough import thorough
from tests.world.random_tasks import tasks

ORDERED = os.environ.get("ROBOTOUILLE_ORACLE_TASKS")
KINDS = [
    pytest.param(deep_tasks(30), 40, 10, id="random-solvable"),
    pytest.param(tasks(), 30, 15, id="random"),
    pytest.param(tiny_kitchens(), 400, 15, id="tiny-kitchens"),
    pytest.param(
        tiny_kitchens(players=2), 120, 10, id="tiny-kitchens-for-two", marks=pytest.mark.slow
    ),
]
FOR_THE_NIGHT = 7
"""Factor of the number of examples in nightly runs."""


def quickly(examples: int) -> Callable[[Callable[..., None]], Callable[..., None]]:
    wanted = thorough(int(ORDERED or examples))
    return settings(wanted, derandomize=ORDERED is None, phases=[Phase.generate])


@pytest.mark.parametrize(
    "factor", [1, pytest.param(FOR_THE_NIGHT, marks=[pytest.mark.slow, pytest.mark.nightly])]
)
@pytest.mark.parametrize(("strategy", "cap", "examples"), KINDS)
def test_small_tasks_match_brute_force(
    strategy: st.SearchStrategy[Task], cap: int, examples: int, factor: int
) -> None:
    @quickly(examples * factor)
    @given(task=strategy)
    def agree(task: Task) -> None:
        world = World(task)
        oracle = explore(task, world, cap)
        check_answers(world, oracle, 4 * cap)
        if oracle.complete:
            check_heuristics(oracle, LandmarkCut(world))
            check_heuristics(oracle, CriticalPath(world))

    agree()


def check_answers(world: World, oracle: Oracle, states: int) -> None:
    """Check results with and without symmetry and heuristics against brute force."""
    guides: tuple[Heuristic | None, ...] = (None, BLIND)
    for guide in guides:
        for symmetry in (True, False):
            limits = Limits(states=states)
            answer = astar_search(world, heuristic=guide, symmetry=symmetry, limits=limits)
            if answer.plan is not None:
                assert replay(answer.plan, world).ok
            if oracle.depth is not None:
                assert answer.bound <= oracle.depth
                assert answer.optimal or (oracle.depth > 0 and not oracle.complete)
                assert answer.plan is None or len(answer.plan) >= oracle.depth
            elif oracle.complete:
                assert answer.unsolvable
                assert answer.plan is None
            else:
                assert answer.plan is None or len(answer.plan) > oracle.layers
            if oracle.depth is not None and answer.optimal:
                assert answer.plan is not None
                assert len(answer.plan) == oracle.depth


def check_heuristics(oracle: Oracle, estimate: Heuristic) -> None:
    """Check that no heuristic exceeds the distance, and that only dead ends are infinite."""
    distances = oracle.distances()
    for key, state in oracle.states.items():
        if key not in oracle.goals:
            least = estimate(state.facts, state.timers)
            assert least <= distances.get(key, math.inf)


@pytest.mark.slow
@quickly(30)
@given(task=tiny_kitchens())
def test_unreachable_predicates_never_hold(task: Task) -> None:
    world = World(task)
    oracle = explore(task, world, 300)
    parts = unreachable_goal(world)
    if oracle.goals:
        assert not parts
    elif oracle.complete:
        seen = 0
        for state in oracle.states.values():
            seen |= state.facts
        missing = [t for t in world.goal.terms if not seen & world.goal.possible_mask(t)]
        assert len(parts) == len(missing)
