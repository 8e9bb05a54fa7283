"""Teams of two to four: bounds at the start, agreement of lengths, and bounds along known plans."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robotouille import World
from robotouille.planning.kitchen.solver import kitchen_search
from robotouille.planning.plan import Plan, read_plan, replay
from robotouille.planning.solvers import solve
from tests.planning.kitchen.kitchens import check_heuristic, least_heuristic
from tests.support.samples import quick_sample

PROBLEMS = Path(__file__).resolve().parents[3] / "problems"

# An earlier version of the planner proved these lengths with a weaker heuristic and without partial
# expansions.
PROVEN_BEFORE = {
    "multi_agent/01@2": 14,
    "training/03@2": 13,
    "multi_agent/01@3": 14,
    "multi_agent/04@2": 14,
    "multi_agent/04@3": 14,
    "training/03@3": 13,
    "training/03@4": 13,
    "multi_agent/02@2": 18,
    "multi_agent/03@2": 21,
    "multi_agent/05@2": 18,
    "multi_agent/06@3": 19,
    "multi_agent/07@2": 21,
    "multi_agent/09@2": 27,
    "multi_agent/08@2": 26,
    "multi_agent/06@2": 23,
}

LEAST = {
    "multi_agent/03@4": 20,  # two items on one board
    "multi_agent/02@4": 16,  # three pieces and a top reach one pile
    "multi_agent/07@4": 20,  # two ingredients hold up the pot
    "multi_agent/10@4": 27,  # one sink for two pots
    "multi_agent/09@3": 19,  # only two players have work in the last steps
    "multi_agent/09@4": 15,
}
"""Bounds without any search."""


@pytest.mark.parametrize(("name", "length"), quick_sample(PROVEN_BEFORE.items(), 4, nightly=11))
def test_proven_lengths_agree_with_the_earlier_planner(name: str, length: int) -> None:
    world = World(name)
    answer = solve(world)
    assert answer.optimal
    assert answer.plan is not None
    assert len(answer.plan) == length
    assert replay(answer.plan, world).ok


@pytest.mark.parametrize(("name", "bound"), LEAST.items())
def test_bound_at_the_start(name: str, bound: int) -> None:
    world = World(name)
    search = kitchen_search(world, world.initial)
    assert search is not None
    assert least_heuristic(search) == bound


def team_plans(folder: str) -> list[tuple[str, Path]]:
    """Return the names of a folder's team tasks and their certificates."""
    found = sorted((PROBLEMS / folder).glob("*@*.certificate.json"))
    return [(f"{folder}/{path.name.split('.')[0]}", path) for path in found]


def shipped_plan(path: Path, world: World) -> Plan:
    steps = json.loads(path.read_text(encoding="utf-8"))["plan"]
    return read_plan("\n".join(steps), world)


@pytest.mark.parametrize(
    ("name", "path"),
    quick_sample(
        [*team_plans("multi_agent")[::-4], *team_plans("generated/multi_agent")[::7]],
        8,
        nightly=40,
    ),
)
def test_bound_never_exceeds_the_rest_of_a_plan(name: str, path: Path) -> None:
    world = World(name)
    state, plan = world.initial, shipped_plan(path, world)
    for number, joint in enumerate(plan):
        assert check_heuristic(state, len(plan) - number)
        state = state.step(joint).state
    assert state.goal_reached
