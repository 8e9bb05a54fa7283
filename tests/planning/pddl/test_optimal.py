"""An independent planner finds plans of the proven lengths, and they replay in the world."""

from pathlib import Path

import pytest

import robotouille
from robotouille.domain.files import read_model
from robotouille.domain.schema import DomainFile
from robotouille.planning.pddl import encode, read_pddl_plan
from robotouille.planning.validation import replay
from tests.planning.pddl.fast_downward import needs_planner, solve

pytestmark = [pytest.mark.process, needs_planner]

PROVEN = {
    "synchronous/01_cheese_sandwich": 8,
    "synchronous/02_lettuce_sandwich": 14,
    "synchronous/04_hamburger": 11,
    "synchronous/05_cheeseburger": 15,
    "asynchronous/01_cheese_chicken_sandwich": 17,
    "asynchronous/06_potato_soup": 19,
}
"""Lengths proven by exhaustive search in the world itself."""

UPSTREAM = Path(__file__).resolve().parents[4] / "shared/compat/upstream"
PUBLISHED = {"synchronous/0_cheese_sandwich": 8, "synchronous/4_cheeseburger": 15}


@pytest.mark.parametrize("task", PROVEN)
def test_a_shortest_plan_costs_its_steps(task: str, tmp_path: Path) -> None:
    world = robotouille.World(task)
    cost, text = solve(encode(world), tmp_path)
    assert cost == PROVEN[task]
    plan = read_pddl_plan(text, world)
    assert len(plan) == cost
    assert replay(plan, world).ok


def test_another_domain(tmp_path: Path) -> None:
    """The workshop creates and deletes objects."""
    world = robotouille.World("workshop/01_painted_gear")
    cost, text = solve(encode(world), tmp_path)
    assert cost == 18
    assert replay(read_pddl_plan(text, world), world).ok


@pytest.mark.skipif(not UPSTREAM.is_dir(), reason="no published files beside the project")
@pytest.mark.parametrize("name", PUBLISHED)
def test_published_layouts(name: str, tmp_path: Path) -> None:
    domain = read_model(UPSTREAM / "domain/robotouille.json", DomainFile)
    world = robotouille.World(
        robotouille.load_task(str(UPSTREAM / f"problems/{name}.json"), domain=domain)
    )
    cost, text = solve(encode(world), tmp_path)
    assert cost == PUBLISHED[name]
    assert replay(read_pddl_plan(text, world), world).ok
