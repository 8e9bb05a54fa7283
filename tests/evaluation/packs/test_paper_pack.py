"""Built-in pack with instances drawn as in the paper: layouts, plans, and its use in runs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from robotouille import World, load_task
from robotouille.certification.certificate import certify
from robotouille.planning import Limits, read_plan, replay, solve
from robotouille_client.cli.main import app
from robotouille_evaluation.cli.planning import plan_run
from robotouille_evaluation.cli.run_options import RunOptions
from robotouille_evaluation.packs.checking import check_pack
from robotouille_evaluation.packs.paper import build_paper_pack

SANDWICH = "synchronous/01_cheese_sandwich"


def robotouille(*words: str | Path) -> Result:
    return CliRunner().invoke(app, [*map(str, words)])


def problems(dataset: str) -> Iterator[dict[str, Any]]:
    for instance in build_paper_pack().instances:
        if instance.task.startswith(f"{dataset}/"):
            yield json.loads(instance.problem)


def is_held(item: dict[str, Any], problem: dict[str, Any]) -> bool:
    return all((item["x"], item["y"]) != (s["x"], s["y"]) for s in problem["stations"])


def test_ten_instances_of_each_task_for_one_player() -> None:
    pack = build_paper_pack()
    assert len(pack.tasks) == 20
    for task in pack.tasks:
        seeds = [instance.seed for instance in pack.instances_of([task.name])]
        assert seeds == [*range(42, 421, 42)]
    assert {instance.kind for instance in pack.instances} == {"free"}


def test_proportions_are_those_of_the_paper() -> None:
    # Published instances of the five synchronous tasks in a checkout: 25 cells, 9.3 stations,
    # 6.9 items, no stacks, and an item in the hand in 44 % of the instances.
    drawn = [*problems("synchronous")]
    assert {problem["width"] * problem["height"] for problem in drawn} == {25}
    assert 8.8 < fmean(len(problem["stations"]) for problem in drawn) < 9.8
    assert 6.4 < fmean(len(problem["items"]) for problem in drawn) < 7.4
    assert not any(item["stack-level"] for problem in drawn for item in problem["items"])
    held = [any(is_held(item, problem) for item in problem["items"]) for problem in drawn]
    assert 0.34 < fmean(held) < 0.54


def test_tasks_are_the_shipped_ones_apart_from_the_layout() -> None:
    pack = build_paper_pack()
    for task in pack.tasks:
        shipped = load_task(task.name).problem
        (first, *_) = pack.instances_of([task.name])
        drawn = pack.load(first).problem
        assert drawn.goal == shipped.goal
        assert drawn.goal_description == shipped.goal_description


def test_every_instance_has_a_proven_plan() -> None:
    assert all(instance.optimal() for instance in build_paper_pack().instances)


def test_plans_reach_the_goal() -> None:
    pack = build_paper_pack()
    for instance in pack.instances[3::10]:
        world = World(pack.load(instance))
        plan = read_plan("\n".join(instance.plans[0].plan), world)
        assert replay(plan, world).reached_at == instance.optimal()


def test_lengths_are_proven_again() -> None:
    pack = build_paper_pack()
    for instance in pack.instances_of([SANDWICH]):
        found = certify(pack.load(instance), solve, Limits(expansions=5000))
        assert found.optimal and found.plan is not None
        assert len(found.plan) == instance.optimal()


@pytest.mark.slow
def test_whole_pack_is_valid() -> None:
    assert not check_pack(build_paper_pack())


def test_run_of_the_pack_by_its_name(tmp_path: Path) -> None:
    options = RunOptions(agents="scripted", pack=Path("paper"), tasks=SANDWICH, limit=2)
    planned = plan_run(tmp_path / "run", options)
    assert [job.instance for job in planned.jobs] == [f"{SANDWICH}/free-42", f"{SANDWICH}/free-84"]
    assert {job.budget for job in planned.jobs} == {"own"}
    assert planned.own_folder and planned.folder == tmp_path / "run" / "pack"


def test_misspelt_name_of_a_built_in_pack(tmp_path: Path) -> None:
    result = robotouille("benchmark", "run", tmp_path / "run", "--pack", "papers")
    assert result.exit_code == 1
    assert "no pack 'papers'; did you mean 'paper'?" in result.output


def test_pack_commands_accept_built_in_names() -> None:
    shown = robotouille("pack", "show", "paper")
    assert shown.exit_code == 0 and "20 tasks (200 free)" in shown.stdout
