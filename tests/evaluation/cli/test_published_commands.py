"""Documented commands for a checkout of the published repository."""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from robotouille_client.cli.main import app
from robotouille_evaluation.agents.making import OWN_STRATEGIES
from robotouille_evaluation.packs.pack import KnownPlan, Pack
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.packs.store import read_pack, write_pack
from robotouille_evaluation.runs import RunFolder
from tests.support import checkouts
from tests.support.checkouts import PROBLEM, write_checkout
from tests.support.published import CHECKOUT, NEEDED, PROBLEMS

pytest.importorskip("yaml")

PAGE = Path(__file__).resolve().parents[3] / "docs/evaluate_models.md"
EXPERIMENT = "ReAct/plain"
NO_CONSTANT = "environments/env_generator/examples/synchronous/0.1_toast.json"

pytestmark = pytest.mark.usefixtures("no_report")


def called(*words: str | Path) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


def documented(heading: str) -> list[list[str]]:
    """Return the words of the commands below a heading of the page."""
    section = PAGE.read_text(encoding="utf-8").partition(f"### {heading}\n")[2]
    block = section.partition("```console\n")[2].partition("```")[0].replace("\\\n", " ")
    return [
        shlex.split(line[2:]) for line in block.splitlines() if line.startswith("$ robotouille")
    ]


@NEEDED
@pytest.mark.slow
@pytest.mark.process
def test_documented_commands_run_on_a_checkout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(CHECKOUT, tmp_path / "robotouille")
    examples = tmp_path / "robotouille" / PROBLEMS.relative_to(CHECKOUT)
    kept = examples / "asynchronous/0_cheese_chicken_sandwich.json"
    for path in examples.rglob("*.json"):  # One task is enough, and proofs take time.
        if path != kept:
            path.unlink()
    shutil.copy(kept, examples / "asynchronous/3.1_lettuce_cheeseburger.json")
    monkeypatch.chdir(tmp_path)
    received = ""
    for heading in ("Use the published protocol", "Measure later"):
        for command in documented(heading):
            words = [word if word != "gpt-4o" else "mock" for word in command[1:]]
            limits = ["--expansions", "1", "--timeout", "1"] if "prove" in words else []
            result = called(*words, *limits)
            assert result.exit_code == 0, result.output
            received += result.stderr
    assert "asynchronous/3.1_lettuce_cheeseburger\n" in received
    assert "10 of 10 episodes newly measured" in received
    for run, agents in (("published", 1), ("baselines", 2)):
        rows = RunFolder(tmp_path / "runs" / run).rows()
        assert {row.task for row in rows} == {"asynchronous/0_cheese_chicken_sandwich"}
        assert {row.budget.rule for row in rows} == {"published"}
        assert len(rows) == 10 * agents


@pytest.fixture
def toast(tmp_path: Path) -> Path:
    """Return the pack of an invented checkout in which one of two tasks has no constant."""
    checkout = write_checkout(tmp_path / "checkout", {NO_CONSTANT: json.dumps(PROBLEM)})
    write_pack(read_checkout(checkout, seeds=(42, 84)).pack, tmp_path / "pack")
    return tmp_path / "pack"


RANDOM = ("--agents", "random", "--processes", "1")


@pytest.mark.usefixtures("no_processes")
def test_instances_without_a_constant_are_left_out(tmp_path: Path, toast: Path) -> None:
    words = ("run", tmp_path / "run", "--pack", toast, "--budget", "published", *RANDOM)
    result = called("benchmark", *words)
    assert result.exit_code == 0, result.output
    line = "2 of 4 instances have no published constant and are left out: synchronous/0.1_toast\n"
    assert line in result.stderr
    assert {row.task for row in RunFolder(tmp_path / "run").rows()} == {"synchronous/0_toast"}
    none_left = called(
        "benchmark", "run", tmp_path / "x", "--pack", toast, "--budget", "published",
        "--tasks", "0.1_toast",
    )  # fmt: skip
    assert none_left.exit_code == 1 and "no constant, so no published budget" in none_left.stderr


@pytest.mark.slow
def test_inspect_leaves_out_instances_without_a_constant(
    toast: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("inspect_ai")
    from robotouille_evaluation.inspect_tasks.samples import TaskOptions, samples

    found = samples(read_pack(toast), "synchronous", TaskOptions(budget="published"))
    assert [each.id for each in found] == ["synchronous/0_toast_42", "synchronous/0_toast_84"]
    assert "2 of 4 instances have no published constant" in capsys.readouterr().err


@pytest.mark.usefixtures("no_processes")
def test_run_has_one_kind_of_budget(tmp_path: Path, toast: Path) -> None:
    partly = read_pack(toast)
    write_pack(replace(partly, instances=tuple(_with_a_plan(partly))), toast)
    words = ("--pack", toast, "--tasks", "0_toast", *RANDOM)
    refused = called("benchmark", "run", tmp_path / "run", *words)
    assert refused.exit_code == 1
    assert "1 of 2 instances have no known plan" in refused.stderr
    assert "--budget published" in refused.stderr and "pack prove" in refused.stderr
    own = called("benchmark", "run", tmp_path / "own", *words, "--budget", "own")
    assert own.exit_code == 0, own.output
    assert (
        "1 of 2 instances have no known plan and are left out: synchronous/0_toast\n" in own.stderr
    )
    assert [row.budget.rule for row in RunFolder(tmp_path / "own").rows()] == ["own"]


def _with_a_plan(pack: Pack) -> Iterator[object]:
    for instance in pack.instances:
        known = (KnownPlan(1, ("-",) * 4),) if instance.seed == 42 else ()
        yield replace(instance, plans=known)


@pytest.fixture
def by_chance(tmp_path: Path) -> Path:
    """Return the pack of an experiment with a temperature, a multiplier and a chance of its own."""
    settings = checkouts.EXPERIMENT.replace("multiplier: 1.5", "multiplier: 2\n  stochastic: true")
    path = f"conf/experiments/{EXPERIMENT}.yaml"
    checkout = write_checkout(tmp_path / "checkout", {path: settings})
    write_pack(read_checkout(checkout, seeds=(42, 84)).pack, tmp_path / "pack")
    return tmp_path / "pack"


def test_experiment_sets_all_conditions(tmp_path: Path, by_chance: Path) -> None:
    words = ("run", tmp_path / "run", "--pack", by_chance, "--experiment", EXPERIMENT)
    result = called("benchmark", *words)
    assert result.exit_code == 0, result.output
    line = (
        f"{EXPERIMENT}: tasks 1 of 2 (not in the pack: synchronous/1), instances 1, "
        "temperature 0.7, step budget published, chance of a reversal 0.1\n"
    )
    assert line in result.stderr
    (row,) = RunFolder(tmp_path / "run").rows()
    assert row.agent == f"{EXPERIMENT} (mock, temperature 0.7)"
    assert (row.experiment, row.sampling) == (EXPERIMENT, "temperature 0.7")
    assert (row.instance, row.variant) == ("synchronous/0_toast_42", "stochastic")
    assert (row.budget.rule, row.budget.steps) == ("published", 10)
    assert called("benchmark", "resume", tmp_path / "run").exit_code == 0


def test_tasks_of_an_experiment_that_the_pack_lacks_are_left_out(
    tmp_path: Path, by_chance: Path
) -> None:
    words = ("--pack", by_chance, "--experiment", EXPERIMENT, "--tasks")
    both = "synchronous/0,synchronous/1"
    result = called("benchmark", "run", tmp_path / "run", *words, both)
    assert result.exit_code == 0, result.output
    assert "tasks 1 of 2 (not in the pack: synchronous/1)" in result.stderr
    absent = called("benchmark", "run", tmp_path / "absent", *words, "synchronous/1")
    assert f"the pack has no such task of {EXPERIMENT}" in absent.stderr
    unknown = called("benchmark", "run", tmp_path / "unknown", *words, "synchronous/0,noodles")
    assert unknown.exit_code == 1
    assert "unknown task 'noodles'" in unknown.stderr


@pytest.mark.slow
def test_folder_of_experiments_is_played_at_once(tmp_path: Path) -> None:
    names = ("ReAct/ablations/one", "ReAct/ablations/two")
    changes = {f"conf/experiments/{name}.yaml": checkouts.EXPERIMENT for name in names}
    checkout = write_checkout(tmp_path / "checkout", dict(changes))
    write_pack(read_checkout(checkout, seeds=(42,)).pack, tmp_path / "pack")
    words = ("--pack", tmp_path / "pack", "--experiment", "ReAct/ablations")
    result = called("benchmark", "run", tmp_path / "run", *words)
    assert result.exit_code == 0, result.output
    assert {row.experiment for row in RunFolder(tmp_path / "run").rows()} == set(names)
    baseline = called("benchmark", "run", tmp_path / "baseline", *words, *RANDOM)
    assert baseline.exit_code == 0, baseline.output
    rows = RunFolder(tmp_path / "baseline").rows()
    assert [row.agent for row in rows] == ["random"], "both experiments share the episode"


@pytest.mark.slow
def test_options_replace_settings_of_an_experiment(tmp_path: Path, by_chance: Path) -> None:
    changes = ("--temperature", "0", "--instances", "84", "--variant", "none")
    words = ("run", tmp_path / "run", "--pack", by_chance, "--experiment", EXPERIMENT)
    agents = ("--agents", f"{EXPERIMENT},random", "--processes", "1")
    result = called("benchmark", *words, *changes, *agents)
    assert result.exit_code == 0, result.output
    assert "temperature 0, step budget published, chance of a reversal 0\n" in result.stderr
    rows = sorted(RunFolder(tmp_path / "run").rows(), key=lambda row: row.agent)
    assert [row.agent for row in rows] == [f"{EXPERIMENT} (mock, temperature 0)", "random"]
    assert {(row.instance, row.variant) for row in rows} == {("synchronous/0_toast_84", "")}
    assert {row.budget.steps for row in rows} == {10}
    refused = called("benchmark", "run", tmp_path / "x", *words[2:], "--variant", "delay-free")
    assert refused.exit_code == 1 and "for kitchens with delays" in refused.stderr


def test_experiment_as_agent_of_other_tasks_is_reported(tmp_path: Path) -> None:
    other = checkouts.EXPERIMENT.replace("0_toast", "0.1_toast")
    changes = {NO_CONSTANT: json.dumps(PROBLEM), "conf/experiments/ReAct/other.yaml": other}
    checkout = write_checkout(tmp_path / "checkout", changes)
    write_pack(read_checkout(checkout, seeds=(42, 84)).pack, tmp_path / "pack")
    words = ("--pack", tmp_path / "pack", "--limit", "1", "--agents", EXPERIMENT)
    result = called("benchmark", "run", tmp_path / "run", *words)
    assert result.exit_code == 0, result.output
    assert f"--experiment {EXPERIMENT} plays it as published\n" in result.stderr
    instances = [row.instance for row in RunFolder(tmp_path / "run").rows()]
    assert sorted(instances) == ["synchronous/0.1_toast_42", "synchronous/0_toast_42"]
    own = called("benchmark", "run", tmp_path / "own", *words, "--tasks", "0_toast")
    assert "as published" not in own.stderr


def test_experiment_for_people_is_refused(tmp_path: Path) -> None:
    person = checkouts.EXPERIMENT.replace("agent_name: ReAct", "agent_name: human")
    write_checkout(tmp_path / "checkout", {"conf/experiments/human/plain.yaml": person})
    write_pack(read_checkout(tmp_path / "checkout", seeds=(42,)).pack, tmp_path / "pack")
    for option in ("--agents", "--experiment"):
        words = ("run", tmp_path / "run", "--pack", tmp_path / "pack", option, "human/plain")
        result = called("benchmark", *words)
        assert result.exit_code == 1
        assert "human/plain is played by a person and not by a model" in result.stderr


def test_unknown_instance_names_the_known_ones(tmp_path: Path, toast: Path) -> None:
    words = ("run", tmp_path / "run", "--pack", toast, "--tasks", "0_toast", "--instances", "43")
    result = called("benchmark", *words, *RANDOM)
    assert result.exit_code == 1
    assert "no chosen task has the instance '43'; choose 42, 84" in result.stderr


def test_agents_are_listed_with_a_line_each(toast: Path) -> None:
    lines = dict(
        line.split(maxsplit=1)
        for line in called("benchmark", "agents", "--pack", toast).stdout.splitlines()
    )
    assert {"planner", "random", "scripted", EXPERIMENT, *OWN_STRATEGIES} == set(lines)
    assert "the paper's ReAct" in lines["react-last-reasoning-action-plan"]
    assert lines[EXPERIMENT] == "published experiment: ReAct on 2 tasks"
    assert EXPERIMENT not in called("benchmark", "agents").stdout
