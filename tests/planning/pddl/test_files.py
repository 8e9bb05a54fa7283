"""PDDL files of two tiny tasks, refused tasks, and optimal plans of Fast Downward."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import robotouille
from robotouille import FileError, World, load_task
from robotouille.domain.json_files import read_model
from robotouille.domain.schema import DomainFile, ProblemFile
from robotouille.domain.task import build_task
from robotouille.planning.pddl import EncodingStyle, PddlError, encode, read_pddl_plan
from robotouille.planning.plan import read_plan, replay
from robotouille_client.cli.main import app
from tests.planning.pddl.fast_downward import needs_planner, solve
from tests.planning.pddl.interpreter import Interpreter, parse
from tests.support.broken_files import DOMAIN, PROBLEM, changed
from tests.support.pages import blocks

GOLDEN = Path(__file__).parent / "golden"
TINY = ("tiny_kitchen", "tiny_lamps")


@pytest.mark.parametrize("task", TINY)
@pytest.mark.parametrize("style", EncodingStyle)
def test_golden_files(task: str, style: EncodingStyle) -> None:
    # Renew with `robotouille pddl golden/TASK.json --encoding STYLE --out golden/TASK-STYLE`.
    encoding = encode(World(load_task(str(GOLDEN / f"{task}.json"))), style)
    folder = GOLDEN / f"{task}-{style.value}"
    assert encoding.domain == (folder / "domain.pddl").read_text()
    assert encoding.problem == (folder / "problem.pddl").read_text()


@pytest.mark.parametrize("task", ["asynchronous/06_potato_soup", "workshop/02_two_workers"])
def test_durative_files_are_well_formed(task: str) -> None:
    encoding = encode(World(load_task(task)), EncodingStyle.DURATIVE)
    blocks = parse(encoding.domain)[0]
    assert {b[0] for b in blocks[2:]} >= {":durative-action", ":functions", ":predicates"}
    assert parse(encoding.problem)[0][-1] == [":metric", "minimize", ["total-time"]]


def test_command_writes_both_files(tmp_path: Path) -> None:
    out = tmp_path / "new" / "folder"
    result = CliRunner().invoke(app, ["pddl", "synchronous/01", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert (out / "domain.pddl").read_text() == encode(World("synchronous/01")).domain
    assert "define (problem" in (out / "problem.pddl").read_text()
    result = CliRunner().invoke(app, ["pddl", "nowhere", "--out", str(out)])
    assert result.exit_code == 1


def test_file_states_the_bound_of_created_objects() -> None:
    encoding = encode(World("asynchronous/06"), created=3)
    assert "; Bound: at most 3 of water are created." in encoding.domain
    assert "water3 - meal" in encoding.problem
    assert "water4" not in encoding.problem


def test_names_are_valid_and_distinct() -> None:
    world = World(load_task(str(GOLDEN / "tiny_lamps.json")))
    encoding = encode(world)
    assert encoding.names.predicate("At") == "at-2"
    assert encoding.names.symbol("Oil-lamp1") == "oil-lamp1"
    plan = read_pddl_plan("(LIGHT keeper1 oil-lamp1 wall1 clock)\n(tick keeper1)", world)
    assert str(plan.steps[0][0]) == "light(keeper1, Oil-lamp1, wall1)"


def test_example_of_the_page() -> None:
    names: dict[str, Any] = {}
    (block,) = [b for b in blocks("planners.md", "python") if "read_pddl_plan(" in b]
    exec(compile(block, "planners.md", "exec"), names)
    assert str(names["plan"].steps) == "((<move(robot1, table3, table2)>,),)"


def test_durative_plans_are_read() -> None:
    world = World(load_task(str(GOLDEN / "tiny_kitchen.json")))
    text = """
    0.000: (pick-up-item robot1 patty1 table1) [1.000]
    1.001: (move robot1 table1 stove1) [1.000]
    2.002: (place-item robot1 patty1 stove1) [1.000]
    3.003: (cook robot1 patty1 stove1) [1.000]
    3.004: (delay-cook-0-1 patty1 stove1) [2.000]
    5.005: (pick-up-item robot1 patty1 stove1) [1.000]
    """
    expected = (
        "pick-up-item(robot1, patty1, table1)\nmove(robot1, table1, stove1)\n"
        "place-item(robot1, patty1, stove1)\ncook(robot1, patty1, stove1)\n-\n"
        "pick-up-item(robot1, patty1, stove1)\n"
    )
    assert read_pddl_plan(text, world) == read_plan(expected, world)


@pytest.mark.parametrize("line", ["move robot1", "(jump robot1)", "(move robot1 table1 nowhere)"])
def test_invalid_lines_are_rejected(line: str) -> None:
    with pytest.raises(FileError, match="line 2"):
        read_pddl_plan(f"; a plan\n{line}\n", World("synchronous/01"))


def world_of(*effects: dict[str, Any]) -> World:
    """Return the small domain with other effects of its one action."""
    domain = changed(DOMAIN, "action_defs", 0, "sfx", to=list(effects))
    problem = changed(PROBLEM, "config", to={})
    parsed = DomainFile.model_validate(domain), ProblemFile.model_validate(problem)
    return World(build_task("small", *parsed))


CUT = {"predicate": "iscut", "params": ["i"]}
AWAY = {"predicate": "at", "params": ["i", "s"], "is_true": False}
LATER = {"type": "delayed", "param": "i"}


def test_dependent_effects_are_refused() -> None:
    waits = {"type": "conditional", "param": "i", "conditions": [CUT], "fx": [AWAY]}
    with pytest.raises(PddlError, match="changes 'iscut'"):
        encode(world_of({**LATER, "fx": [CUT]}, waits))


def test_timing_for_people_is_refused() -> None:
    with pytest.raises(PddlError, match="benchmark"):
        encode(World(load_task("synchronous/01", timing="people")))


def test_durative_encoding_refuses_nested_delays() -> None:
    nested = {**LATER, "sfx": [{**LATER, "fx": [CUT]}]}
    with pytest.raises(PddlError, match="'cut' has an effect of another shape"):
        encode(world_of(nested), EncodingStyle.DURATIVE)
    encode(world_of(nested))


@pytest.mark.parametrize("kind", ["delayed", "repetitive"])
def test_nested_counts_agree_with_the_world(kind: str) -> None:
    world = world_of({**LATER, "default": 2, "sfx": [{"type": kind, "param": "i", "fx": [CUT]}]})
    encoding = encode(world)
    pddl = Interpreter(encoding.domain, encoding.problem)
    state = world.initial
    for _ in range(12):
        (action,) = state.actions("robot1")
        pddl.apply("cut", *action.arguments, "clock")
        pddl.apply("tick", "robot1")
        state = state.step(action).state
        assert (("iscut", "leek1") in pddl.facts) == state.holds("iscut", "leek1")
    assert state.holds("iscut", "leek1")


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


@pytest.mark.process
@needs_planner
@pytest.mark.parametrize("task", PROVEN)
def test_optimal_cost_equals_plan_length(task: str, tmp_path: Path) -> None:
    world = robotouille.World(task)
    cost, text = solve(encode(world), tmp_path)
    assert cost == PROVEN[task]
    plan = read_pddl_plan(text, world)
    assert len(plan) == cost
    assert replay(plan, world).ok


@pytest.mark.process
@needs_planner
def test_domain_with_creation_and_deletion(tmp_path: Path) -> None:
    world = robotouille.World("workshop/01_painted_gear")
    cost, text = solve(encode(world), tmp_path)
    assert cost == 18
    assert replay(read_pddl_plan(text, world), world).ok


@pytest.mark.process
@needs_planner
@pytest.mark.skipif(not UPSTREAM.is_dir(), reason="no published files next to the project")
@pytest.mark.parametrize("name", PUBLISHED)
def test_published_layouts_have_equal_lengths(name: str, tmp_path: Path) -> None:
    domain = read_model(UPSTREAM / "domain/robotouille.json", DomainFile)
    world = robotouille.World(
        robotouille.load_task(str(UPSTREAM / f"problems/{name}.json"), domain=domain)
    )
    cost, text = solve(encode(world), tmp_path)
    assert cost == PUBLISHED[name]
    assert replay(read_pddl_plan(text, world), world).ok
