"""Steps to go are the exact distances of the world, or bounds that hold; what is told of them."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from robotouille import State, World
from robotouille.certification.certificate import Deadline
from robotouille.episode import Clock
from robotouille.planning.anytime import AnytimePlanner
from robotouille.planning.search_result import Limits
from robotouille.planning.steps_to_go import Range, StepsLeft, StepsToGo, quotient
from robotouille_client.cli.main import app
from tests.planning.kitchen.exact import explored
from tests.planning.kitchen.random_kitchens import random_kitchen
from tests.support.games import recorded_game
from tests.support.oracle import explore
from tests.support.samples import first_quickly
from tests.world.kitchens import kitchen

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
    """The states along a shortest plan."""
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
def test_equal_to_brute_force(name: str) -> None:
    world = kitchen(**TINY[name])
    oracle = explore(world.task, world, 1500)
    assert oracle.complete
    exact, distance = oracle.distances(), StepsToGo(world)
    keys = list(oracle.states)
    for key in random.Random(1).sample(keys, min(len(keys), 60)):
        left = distance(oracle.states[key])
        assert left.exact
        assert (left.steps, left.dead) == (exact.get(key), key not in exact)


@pytest.mark.parametrize("block", first_quickly(range(4)))
def test_on_random_walks_in_random_kitchens(block: int) -> None:
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
def test_every_step_of_a_shortest_plan_comes_nearer_by_one(name: str) -> None:
    world = World(name)
    states = optimal_course(world)
    found = [StepsToGo(world)(state) for state in states]
    assert [left.steps for left in found] == list(range(len(states) - 1, -1, -1))
    assert all(left.exact for left in found)


def test_what_was_found_out_once_is_known() -> None:
    world = World("asynchronous/08")
    distance, states = StepsToGo(world), optimal_course(world)
    assert distance(states[0]).exact
    for state in states:
        for wait in (state, state.step([]).state):
            left = distance(wait, NOTHING, after=state)
            assert left.bound >= distance(state, NOTHING).bound - 1
    assert [distance(s, NOTHING).steps for s in states] == [*range(len(states) - 1, -1, -1)]


@pytest.mark.parametrize("expansions", first_quickly([5, 0, 1, 20]))
def test_limits_leave_bounds_that_hold(expansions: int) -> None:
    world = World("asynchronous/08")
    exact, distance, before = StepsToGo(world), StepsToGo(world), None
    for state in wandering(world, 4, 10):
        left, right = distance(state, Limits(expansions=expansions), after=before), exact(state)
        assert right.steps is not None
        assert left.bound <= right.steps
        assert left.steps is None or left.steps >= right.steps
        assert not left.dead
        before = state


def spoiled() -> list[State]:
    """A course in which the onion gets into the soup whole; the last state is beyond repair."""
    world = World("asynchronous/07")
    state, course = world.initial, [world.initial]
    for before in optimal_course(world)[:-1]:
        for action in before.actions("robot1"):
            if action.name == "add-to" and not before.holds("iscut", action.arguments[1]):
                return [*course, before, before.step(action).state]
    plan = AnytimePlanner(world).first(world.initial).plan
    assert plan is not None
    for (action,) in (joint for joint in plan if joint):
        if action.name != "cut" and world.applicable(state, action):
            state = world.successor(state, action)
            course.append(state)
        if action.name == "add-to":
            break
    return course


def test_a_dead_state_has_no_number_and_no_way_back() -> None:
    course = spoiled()
    world = course[0].world
    distance, before = StepsToGo(world), None
    found = []
    for state in course:
        found.append(distance(state, after=before))
        before = state
    assert found[-1] == StepsLeft(None, dead=True)
    assert found[-1].exact
    assert not found[0].dead
    after = course[-1].step([]).state
    assert distance(after, NOTHING, after=course[-1]).dead


def test_the_goal_is_no_steps_away() -> None:
    world = World("synchronous/01")
    assert StepsToGo(world)(optimal_course(world)[-1], NOTHING) == StepsLeft(0)


def test_states_of_other_worlds_are_refused() -> None:
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


def test_a_state_is_searched_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who waits in a real-time game is in one state for many steps."""
    world = World("asynchronous/09")
    distance, limits, searched = StepsToGo(world), Limits(expansions=60), []
    search = StepsToGo._search

    def counted(self: StepsToGo, *arguments: Any) -> None:
        searched.append(arguments)
        search(self, *arguments)

    monkeypatch.setattr(StepsToGo, "_search", counted)
    first = distance(world.initial, limits)
    assert not first.exact
    assert distance(world.initial, Limits(expansions=60), after=world.initial) == first
    assert len(searched) == 1
    distance(world.initial, Limits(expansions=61))
    assert len(searched) == 2


# The command


def steps(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["replay", "steps", *map(str, arguments)])


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    file = tmp_path / "game.rbt.part"
    file.write_bytes(recorded_game("synchronous/02", steps=15, seed=1))
    return file


def test_the_command_says_how_far_the_goal_was(recording: Path) -> None:
    result = steps(recording)
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[1].split() == ["0", "14"]
    assert lines[2].startswith("    1     1")
    assert lines[-1].startswith("normalized steps to go  1.")
    assert lines[-2].split() == ["optimality", "rate", "-"]


def test_the_command_as_json(recording: Path) -> None:
    answer = json.loads(steps(recording, "--json").stdout)
    first = {"step": 0, "steps": 14, "bound": 14, "dead": False, "exact": True}
    assert answer["steps"][0] == first
    assert len(answer["steps"]) == 16
    assert answer["success"] is False
    assert answer["optimality_rate"] is None
    left = answer["steps"][-1]["steps"] / 14
    assert answer["normalized_steps_to_go"] == {"least": left, "most": left}


def test_a_success_has_an_optimality_rate(tmp_path: Path) -> None:
    from robotouille.episode import Episode, Rules
    from tests.support.games import play_through, record

    plan = iter(optimal_course(World("synchronous/01"))[1:])
    idle = [True, True]

    def choose(episode: Episode, player: str) -> Any:
        if idle:
            idle.pop()
            return None
        wanted = next(plan).facts
        fitting = (a for a in episode.state.actions(player)
                   if episode.state.step(a).state.facts == wanted)  # fmt: skip
        return next(fitting)

    rules = Rules(clock=Clock.LOCKSTEP, max_steps=30)
    file = tmp_path / "game.rbt.part"
    file.write_bytes(record(*play_through("synchronous/01", rules, choose)))
    answer = json.loads(steps(file, "--json").stdout)
    assert answer["success"]
    assert answer["optimality_rate"] == {"least": 1.25, "most": 1.25}
    assert answer["normalized_steps_to_go"] == {"least": 0, "most": 0}
    assert "optimality rate         1.25" in steps(file).stdout


def test_a_recording_with_longer_delays_is_measured_without_them(tmp_path: Path) -> None:
    file = tmp_path / "game.rbt.part"
    file.write_bytes(recorded_game("asynchronous/01", steps=15, timing="people"))
    result = steps(file)
    assert result.exit_code == 0, result.output
    assert "without the longer delays" in result.stdout
    assert result.stdout.splitlines()[1].split() == ["0", "17"]


def test_a_search_that_gave_up_gives_ranges(tmp_path: Path) -> None:
    file = tmp_path / "game.rbt.part"
    file.write_bytes(recorded_game("asynchronous/09", steps=3))
    lines = steps(file, "--expansions", 60).stdout.splitlines()
    assert lines[1].split() == ["0", "58-65"]
    assert " to " in lines[-1].split("go")[1]


def test_lines_are_printed_as_they_come(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was found out is told, whatever happens to the rest."""
    searched = StepsToGo.__call__

    def failing(self: StepsToGo, state: State, *limits: Any, **after: Any) -> StepsLeft:
        if after["after"] is not None:
            raise KeyboardInterrupt
        return searched(self, state, *limits, **after)

    monkeypatch.setattr(StepsToGo, "__call__", failing)
    result = steps(recording)
    assert result.exit_code == 130
    assert [line.split() for line in result.stdout.splitlines()] == [
        ["step", "to", "go"],
        ["0", "14"],
    ]


def test_after_so_many_seconds_the_rest_are_bounds(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    assert "5 seconds were over: of the rest only bounds are given (--seconds)" in result.stderr
    assert (
        json.loads(steps(recording, "--json", "--seconds", 5).stdout)["steps"][-1]["steps"] is None
    )


def test_the_command_refuses_other_files(tmp_path: Path) -> None:
    file = tmp_path / "other.txt"
    file.write_text("no recording")
    result = steps(file)
    assert result.exit_code == 1
    assert "not a recording" in result.stderr
    assert steps(tmp_path / "none.rbt").exit_code == 1
