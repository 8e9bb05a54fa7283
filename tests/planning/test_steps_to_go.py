"""Steps to go: exact distances or valid bounds, and the command that prints them."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from robotouille import State, World, load_task
from robotouille.certification.certificate import Deadline
from robotouille.certification.step_limit import retimed_length
from robotouille.episode import ActionRequest, Episode, Rules
from robotouille.planning.plan import Limits
from robotouille.planning.solvers import AnytimePlanner, solve
from robotouille.planning.steps_to_go import Range, StepsLeft, StepsToGo, quotient
from robotouille_client.cli.main import app
from tests.planning.kitchen.kitchens import explored, row
from tests.planning.kitchen.random_kitchens import random_kitchen
from tests.support.games import record, recorded_game
from tests.support.oracle import explore
from tests.support.samples import quick_sample
from tests.world.kitchens import act, kitchen

NOTHING = Limits(expansions=0)

LETTUCE = {"name": "lettuce", "x": 0, "y": 0, "predicates": ["iscuttable"]}
PATTY = {"name": "patty", "x": 1, "y": 0, "predicates": ["iscookable"]}
STATIONS = [
    {"name": "table", "x": 0, "y": 0},
    {"name": "board", "x": 1, "y": 0},
    {"name": "stove", "x": 2, "y": 0},
]
TINY: dict[str, dict[str, Any]] = {
    "cut": {
        "stations": STATIONS,
        "items": [LETTUCE],
        "config": {"num_cuts": {"default": 2}},
        "goal": [{"predicate": "iscut", "args": ["lettuce"], "ids": [1]}],
    },
    "cook": {
        "stations": STATIONS,
        "items": [PATTY],
        "config": {"cook_time": {"default": 3}},
        "goal": [{"predicate": "iscooked", "args": ["patty"], "ids": [1]}],
    },
    "out of the way": {
        "stations": STATIONS[:2],
        "items": [LETTUCE, {**LETTUCE, "x": 1}],
        "config": {"num_cuts": {"default": 1}},
        "goal": [{"predicate": "iscut", "args": ["lettuce"], "ids": [1]},
                 {"predicate": "iscut", "args": ["lettuce"], "ids": [2]}],
    },
    "with longer delays": {
        "stations": STATIONS,
        "items": [PATTY],
        "config": {"cook_time": {"default": 1}},
        "goal": [{"predicate": "iscooked", "args": ["patty"], "ids": [1]}],
        "timing": "people",
    },
}  # fmt: skip


def optimal_course(world: World) -> list[State]:
    """Return the states along a shortest plan."""
    *_, answer = AnytimePlanner(world).search(world.initial, Limits(expansions=500))
    assert answer.plan is not None
    assert answer.optimal
    states = [world.initial]
    for joint in answer.plan:
        states.append(states[-1].step(joint).state)
    return states


def wandering(world: World, seed: int, steps: int) -> list[State]:
    states, rng = [world.initial], random.Random(seed)
    for _ in range(steps):
        joint = [rng.choice([None, *states[-1].actions(p)]) for p in world.players]
        states.append(states[-1].step(joint).state)
    return states


@pytest.mark.parametrize("name", TINY)
def test_steps_to_go_match_brute_force(name: str) -> None:
    world = kitchen(**TINY[name])
    oracle = explore(world.task, world, 1500)
    assert oracle.complete
    exact, distance = oracle.distances(), StepsToGo(world)
    keys = list(oracle.states)
    for key in random.Random(1).sample(keys, min(len(keys), 60)):
        left = distance(oracle.states[key])
        assert left.exact
        assert (left.steps, left.dead) == (exact.get(key), key not in exact)


@pytest.mark.parametrize("block", quick_sample(range(4)))
def test_random_walks_match_brute_force(block: int) -> None:
    checked = 0
    for seed in range(500 + 15 * block, 515 + 15 * block):
        found = explored(World(random_kitchen(seed, 1 + seed % 2)), 600)
        if found is None:
            continue
        exact = dict(zip(found.states, found.distances, strict=True))
        distance, before = StepsToGo(found.world), None
        for state in wandering(found.world, seed, 12):
            left = distance(state, after=before)
            assert left.exact
            assert (left.steps, left.dead) == (exact[state], exact[state] is None)
            before, checked = state, checked + 1
    assert checked > 25


@pytest.mark.parametrize("name", ["synchronous/03", "asynchronous/02", "asynchronous/07"])
def test_shortest_plan_comes_one_nearer_each_step(name: str) -> None:
    world = World(name)
    states = optimal_course(world)
    found = [StepsToGo(world)(state) for state in states]
    assert [left.steps for left in found] == list(range(len(states) - 1, -1, -1))
    assert all(left.exact for left in found)


@pytest.mark.slow
@pytest.mark.parametrize("expansions", quick_sample([5, 0, 1, 20]))
def test_limited_search_leaves_valid_bounds(expansions: int) -> None:
    world = World("asynchronous/08")
    exact, distance, before = StepsToGo(world), StepsToGo(world), None
    for state in wandering(world, 4, 10):
        left, right = distance(state, Limits(expansions=expansions), after=before), exact(state)
        assert right.steps is not None
        assert left.bound <= right.steps
        assert left.steps is None or left.steps >= right.steps
        assert not left.dead
        before = state


def test_dead_state_stays_dead() -> None:
    goal = [("addedto", "onion+1 water+2"), ("iscut", "onion+1")]
    world = row("stove board", *goal, things="pot@0 water@0 onion@1", at=1)
    distance, before = StepsToGo(world), world.initial
    assert not distance(before).dead
    for name, *arguments in (
        ("pick-up-item", "onion1", "board1"),
        ("move", "board1", "stove1"),
        ("add-to", "onion1", "water1", "pot1", "stove1"),
    ):
        state = act(before, name, "robot1", *arguments)
        left, before = distance(state, after=before), state
    assert left == StepsLeft(None, dead=True)
    assert left.exact
    assert distance(state.step([]).state, NOTHING, after=state).dead


def test_states_of_other_worlds_are_rejected() -> None:
    with pytest.raises(ValueError, match="another world"):
        StepsToGo(World("synchronous/01"))(World("synchronous/01").initial)


@pytest.mark.parametrize(
    ("above", "below", "expected"),
    [
        (StepsLeft(5, 5), StepsLeft(10, 10), Range(0.5, 0.5)),
        (StepsLeft(6, 4), StepsLeft(10, 8), Range(0.4, 0.75)),
        (StepsLeft(None, 4), StepsLeft(10, 8), Range(0.4, None)),
        (StepsLeft(0), StepsLeft(None, 8), Range(0.0, 0.0)),
        (StepsLeft(None, dead=True), StepsLeft(10, 10), None),
        (StepsLeft(5, 5), StepsLeft(0), None),
    ],
)
def test_quotients(above: StepsLeft, below: StepsLeft, expected: Range | None) -> None:
    assert quotient(above, below) == expected


# The command


def steps(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["replay", "steps", *map(str, arguments)])


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    file = tmp_path / "game.rbt.part"
    file.write_bytes(recorded_game("synchronous/02", steps=15, seed=1))
    return file


def test_command_prints_steps_to_go(recording: Path) -> None:
    result = steps(recording)
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[1].split() == ["0", "14"]
    assert lines[2].startswith("    1     1")
    assert lines[-1].startswith("normalized steps to go  1.")
    assert lines[-2].split() == ["optimality", "rate", "-"]


def test_command_prints_json(recording: Path) -> None:
    answer = json.loads(steps(recording, "--json").stdout)
    first = {"step": 0, "steps": 14, "bound": 14, "dead": False, "exact": True}
    assert answer["steps"][0] == first
    assert len(answer["steps"]) == 16
    assert answer["success"] is False
    assert answer["optimality_rate"] is None
    left = answer["steps"][-1]["steps"] / 14
    assert answer["normalized_steps_to_go"] == {"least": left, "most": left}


def test_success_has_an_optimality_rate(tmp_path: Path) -> None:
    world = World("synchronous/01")
    episode, plan = Episode(world, Rules(max_steps=30)), solve(world).plan
    episode.join("robot1", "ada", "bot", 0.0)
    for seq, action in enumerate([None, None, *(action for (action,) in plan or ())], 1):
        episode.submit("robot1", ActionRequest(seq, action), float(seq))
    file = tmp_path / "game.rbt.part"
    file.write_bytes(record(episode, episode.events()))
    answer = json.loads(steps(file, "--json").stdout)
    assert answer["success"]
    assert answer["optimality_rate"] == {"least": 1.25, "most": 1.25}
    assert answer["normalized_steps_to_go"] == {"least": 0, "most": 0}
    assert "optimality rate         1.25" in steps(file).stdout


def test_the_summary_names_the_timings_of_both_lengths(tmp_path: Path) -> None:
    file = tmp_path / "game.rbt.part"
    file.write_bytes(recorded_game("asynchronous/01", steps=15, timing="people"))
    result = steps(file)
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines()[1].split() == ["0", "17"]
    known = retimed_length(load_task("asynchronous/01", timing="people"))
    assert "fewest possible         17 in the timing benchmark" in result.stdout
    assert f"best known              {known} in the timing people" in result.stdout


def test_limited_search_prints_ranges(tmp_path: Path) -> None:
    file = tmp_path / "game.rbt.part"
    file.write_bytes(recorded_game("asynchronous/09", steps=3))
    lines = steps(file, "--expansions", 60).stdout.splitlines()
    assert lines[1].split() == ["0", "58-65"]
    assert " to " in lines[-1].split("go")[1]


def test_seconds_limit_leaves_bounds(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def after_three(deadline: Deadline) -> bool:
        asked.append(deadline)
        deadline.struck = len(asked) > 3
        return deadline.struck

    monkeypatch.setattr(Deadline, "__call__", after_three)
    result = steps(recording, "--seconds", 5)
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert lines[1].split() == ["0", "14"]
    assert lines[16].split()[1].endswith("-?")
    assert "stopped after 5 s" in result.stderr
    assert (
        json.loads(steps(recording, "--json", "--seconds", 5).stdout)["steps"][-1]["steps"] is None
    )


def test_command_rejects_other_files(tmp_path: Path) -> None:
    file = tmp_path / "other.txt"
    file.write_text("no recording")
    result = steps(file)
    assert result.exit_code == 1
    assert "not a recording" in result.stderr
    assert steps(tmp_path / "none.rbt").exit_code == 1
