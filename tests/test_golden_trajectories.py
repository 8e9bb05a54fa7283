"""Every published trajectory is reproduced step by step (skipped where the files are absent)."""

import json
from pathlib import Path

import pytest

import robotouille
from robotouille.domain.json_files import read_model
from robotouille.domain.schema import DomainFile
from tests.support.samples import quick_sample

COMPAT = Path(__file__).resolve().parents[2] / "shared" / "compat"
TRAJECTORIES = sorted((COMPAT / "golden").glob("*.json")) if COMPAT.is_dir() else []
PROBLEMS = sorted((COMPAT / "upstream/problems").rglob("*.json")) if COMPAT.is_dir() else []

pytestmark = pytest.mark.skipif(not TRAJECTORIES, reason="no published files beside the project")


@pytest.fixture(scope="module")
def published_domain() -> DomainFile:
    return read_model(COMPAT / "upstream/domain/robotouille.json", DomainFile)


def load(domain: DomainFile, path: Path, facts: list[str] | None = None) -> robotouille.World:
    """Return the world of a problem, with the kinds that the published run drew."""
    for seed in range(5000):
        task = robotouille.load_task(str(path), domain=domain, seed=seed)
        kinds = {f"{o.name}1" for objects in task.problem.objects.values() for o in objects}
        named = {name.strip(" )") for fact in facts or [] for name in fact.split("(")[1].split(",")}
        if facts is None or kinds <= named:
            world = robotouille.World(task)
            if facts is None or world.initial.fact_names() == facts:
                return world
    pytest.fail(f"no choice of kinds gives the published initial facts of {path.stem}")


@pytest.mark.parametrize("path", quick_sample(TRAJECTORIES, 4), ids=lambda p: p.stem)
def test_trajectory(path: Path, published_domain: DomainFile) -> None:
    golden = json.loads(path.read_text())
    world = load(
        published_domain,
        COMPAT / "upstream/problems" / f"{golden['problem']}.json",
        golden["initial_facts"],
    )
    assert list(world.players) == golden["players"]
    state = world.initial
    assert state.fact_names() == golden["initial_facts"]
    if golden.get("initial_text"):
        assert_same_text(state.text(), golden["initial_text"])
    for number, step in enumerate(golden["steps"]):
        actions = state.actions(step["player"])
        if "valid_actions" in step:
            assert sorted(a.sentence for a in actions) == step["valid_actions"], number
        action = world.parse(state, step["player"], step["action"])
        before = set(state.fact_names())
        result = state.step(action)
        state = result.state
        after = set(state.fact_names())
        assert sorted(after - before) == step["added"], number
        assert sorted(before - after) == step["removed"], number
        assert result.goal_reached == step["goal_reached"], number
    assert state.fact_names() == golden["final_facts"]
    if golden.get("final_text"):
        assert_same_text(state.text(), golden["final_text"])


def assert_same_text(ours: str, published: str) -> None:
    assert split(ours) == split(published)


def split(text: str) -> tuple[str, set[str], str]:
    """Objects, valid actions as a set (their published order is not stable), and the goal."""
    head, _, rest = text.partition("\n\nValid Actions:\n")
    actions, _, goal = rest.partition("\n\nGoal: ")
    return head, set(actions.splitlines()), goal


@pytest.mark.parametrize("path", quick_sample(PROBLEMS, 10), ids=lambda p: p.stem)
def test_published_problem_loads_and_plays(path: Path, published_domain: DomainFile) -> None:
    state = load(published_domain, path).initial
    for turn in range(50):
        player = state.world.players[turn % len(state.world.players)]
        actions = state.actions(player)
        state = state.step(actions[turn % len(actions)]).state
    assert state.text()
