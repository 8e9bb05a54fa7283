"""Answers on shipped and published kitchens, and what limits and watchers are promised."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotouille import World, load_task, task_names
from robotouille.domain.files import read_model
from robotouille.domain.schema import DomainFile
from robotouille.planners.kitchen.solver import PLANNER, kitchen_search
from robotouille.planning.plan import write_plan
from robotouille.planning.search_result import Limits, Proof, SearchResult
from robotouille.planning.solvers import solve
from robotouille.planning.validation import replay
from tests.support.samples import first_quickly
from tests.world.kitchens import kitchen

UPSTREAM = Path(__file__).resolve().parents[4] / "shared/compat/upstream"
PUBLISHED = {
    "synchronous/0_cheese_sandwich": 8,
    "synchronous/2_lettuce_tomato_sandwich": 24,
    "synchronous/4_cheeseburger": 15,
    "synchronous/6_lettuce_tomato_cheeseburger": None,
    "synchronous/8_two_lettuce_tomato_burger": None,
    "asynchronous/0_cheese_chicken_sandwich": 21,
    "asynchronous/2_lettuce_tomato_fried_chicken_sandwich": None,
    "asynchronous/4_onion_cheese_burger_and_fried_onion": None,
    "asynchronous/6_onion_soup": None,
    "asynchronous/8_onion_tomato_soup_and_two_chicken_sandwich": None,
}
"""Lengths that an independent planner proves; None where it finds no proof in good time."""

LENGTHS = {
    "synchronous": [8, 14, 24, 11, 15, 23, 36, 36, 60, 54],
    "asynchronous": [17, 23, 33, 42, 46, 19, 42, 40, 58, 72],
}
SHIPPED = {
    name: length
    for folder, lengths in LENGTHS.items()
    for name, length in zip(
        [name for name in task_names() if name.startswith(f"{folder}/")], lengths, strict=True
    )
}
LARGE = "asynchronous/10"
"""A kitchen that takes more than a hundred expansions."""


def check(world: World, answer: SearchResult, length: int | None) -> None:
    assert answer.optimal
    assert answer.plan is not None
    assert answer.planner == PLANNER
    assert answer.proof is Proof.HEURISTIC
    assert len(answer.plan) == answer.bound == (length or answer.bound)
    assert replay(answer.plan, world).ok


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_kitchens(name: str) -> None:
    world = World(name)
    answer = solve(world)
    check(world, answer, SHIPPED[name])
    assert answer.expansions < 1000


@pytest.mark.slow
def test_few_expansions() -> None:
    assert sum(solve(World(name)).expansions for name in SHIPPED) < 2000


@pytest.mark.skipif(not UPSTREAM.is_dir(), reason="no published files beside the project")
@pytest.mark.parametrize("name", first_quickly(PUBLISHED, 3, nightly=9))
def test_published_kitchens(name: str) -> None:
    domain = read_model(UPSTREAM / "domain/robotouille.json", DomainFile)
    path = UPSTREAM / f"problems/{name}.json"
    world = World(load_task(str(path), domain=domain))
    check(world, solve(world), PUBLISHED[name])


@pytest.mark.parametrize("most", [0, 1, 7, 50, 120])
def test_a_limit_of_expansions(most: int) -> None:
    world = World(LARGE)
    answer = solve(world, limits=Limits(expansions=most))
    assert answer.expansions <= most
    check_within_limits(world, answer)


@pytest.mark.parametrize("most", first_quickly([100, 1, 10_000]))
def test_a_limit_of_states(most: int) -> None:
    world = World(LARGE)
    check_within_limits(world, solve(world, limits=Limits(states=most)))


def check_within_limits(world: World, answer: SearchResult) -> None:
    length = SHIPPED[world.task.name]
    assert answer.bound <= length
    assert not answer.unsolvable
    assert answer.optimal == (answer.plan is not None and answer.bound == len(answer.plan))
    if answer.plan is not None:
        assert len(answer.plan) >= length
        assert replay(answer.plan, world).ok


def test_a_bound_is_known_at_once() -> None:
    answer = solve(World(LARGE), limits=Limits(expansions=0))
    assert answer.plan is None
    assert not answer.optimal
    assert 40 < answer.bound <= SHIPPED[World(LARGE).task.name]


def test_stopped_before_it_begins() -> None:
    asked: list[bool] = []

    def stop() -> bool:
        asked.append(True)
        return True

    world = World(LARGE)
    answer = solve(world, limits=Limits(stop=stop))
    assert asked
    assert answer.expansions == 0
    assert answer.plan is None
    check_within_limits(world, answer)


def test_not_stopped() -> None:
    asked: list[bool] = []

    def stop() -> bool:
        asked.append(True)
        return False

    world = World(LARGE)
    check(world, solve(world, limits=Limits(stop=stop)), SHIPPED[world.task.name])
    assert asked


def test_progress_is_told() -> None:
    told: list[tuple[int, int, int | None]] = []
    world = World(LARGE)
    answer = solve(world, watch=lambda *news: told.append(news))
    assert told
    bounds = [bound for _, bound, _ in told]
    assert bounds == sorted(bounds)
    assert bounds[-1] <= answer.bound
    expansions = [done for done, _, _ in told]
    assert expansions == sorted(expansions)
    assert expansions[-1] <= answer.expansions


@pytest.mark.slow
@pytest.mark.parametrize("name", ["synchronous/10", "asynchronous/05", LARGE])
def test_one_input_one_answer(name: str) -> None:
    answers = [solve(World(name)) for _ in range(2)]
    assert answers[0].expansions == answers[1].expansions
    texts = [write_plan(a.plan, World(name)) for a in answers if a.plan is not None]
    assert len(texts) == 2
    assert texts[0] == texts[1]


def test_from_the_middle_of_play() -> None:
    """What is left of a shortest plan is a shortest plan."""
    world = World("asynchronous/07")
    answer = solve(world)
    assert answer.plan is not None
    state = world.initial
    for number, joint in enumerate(answer.plan):
        if number % 3 == 0:
            rest = solve(world, state)
            assert rest.plan is not None
            assert rest.bound == len(rest.plan) == len(answer.plan) - number
            assert replay(rest.plan, world, state).ok
        state = state.step(joint).state


def test_goals_of_other_kinds_are_left_to_another_planner() -> None:
    """A goal about where a cook is is proven elsewhere."""
    world = kitchen(goal=[{"predicate": "loc", "args": ["robot", "table"], "ids": [1, 2]}])
    assert kitchen_search(world, world.initial) is None
    answer = solve(world)
    assert answer.optimal
    assert answer.planner != PLANNER
