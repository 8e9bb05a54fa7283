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
from robotouille_evaluation.packs.pack import KnownPlan, Pack
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.packs.store import read_pack, write_pack
from robotouille_evaluation.runs import RunFolder
from tests.support.checkouts import PROBLEM, write_checkout
from tests.support.published import CHECKOUT, NEEDED, PROBLEMS

pytest.importorskip("yaml")

PAGE = Path(__file__).resolve().parents[3] / "docs/evaluate_models.md"
EXPERIMENT = "ReAct/asynchronous/last-reasoning-action-mpc"
NO_CONSTANT = "environments/env_generator/examples/synchronous/0.1_toast.json"


def called(*words: str | Path) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


def documented(heading: str) -> list[list[str]]:
    """Return the words of the commands below a heading of the page."""
    section = PAGE.read_text(encoding="utf-8").partition(f"### {heading}\n")[2]
    block = section.partition("```console\n")[2].partition("```")[0].replace("\\\n", " ")
    return [
        shlex.split(line[2:]) for line in block.splitlines() if line.startswith("$ robotouille")
    ]


@pytest.fixture(autouse=True)
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Skip figures, which take seconds and have tests of their own."""
    monkeypatch.setattr(
        "robotouille_evaluation.report.write_report", lambda _, folder, **__: folder / "report.html"
    )


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
    for command in documented("Use the published protocol"):
        words = [word if word != "gpt-4o" else "mock" for word in command[1:]]
        limits = ["--expansions", "1", "--timeout", "1"] if "prove" in words else []
        result = called(*words, *limits)
        assert result.exit_code == 0, result.output
    assert "asynchronous/3.1_lettuce_cheeseburger\n" in result.stderr
    rows = RunFolder(tmp_path / "runs/published").rows()
    assert {row.task for row in rows} == {"asynchronous/0_cheese_chicken_sandwich"}
    assert {row.budget.rule for row in rows} == {"published"} and len(rows) == 10


@pytest.fixture
def toast(tmp_path: Path) -> Path:
    """Return the pack of an invented checkout in which one of two tasks has no constant."""
    checkout = write_checkout(tmp_path / "checkout", {NO_CONSTANT: json.dumps(PROBLEM)})
    write_pack(read_checkout(checkout, seeds=(42, 84)).pack, tmp_path / "pack")
    return tmp_path / "pack"


RANDOM = ("--agents", "random", "--processes", "1")


def test_instances_without_a_constant_are_left_out(tmp_path: Path, toast: Path) -> None:
    words = ("run", tmp_path / "run", "--pack", toast, "--budget", "published", *RANDOM)
    result = called("benchmark", *words)
    assert result.exit_code == 0, result.output
    line = "left out 2 instances without a published constant: synchronous/0.1_toast\n"
    assert line in result.stderr
    assert {row.task for row in RunFolder(tmp_path / "run").rows()} == {"synchronous/0_toast"}
    none_left = called(
        "benchmark", "run", tmp_path / "x", "--pack", toast, "--budget", "published",
        "--tasks", "0.1_toast",
    )  # fmt: skip
    assert none_left.exit_code == 1 and "no constant, so no published budget" in none_left.stderr


def test_inspect_leaves_out_instances_without_a_constant(
    toast: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("inspect_ai")
    from robotouille_evaluation.inspect_tasks.samples import TaskOptions, samples

    found = samples(read_pack(toast), "synchronous", TaskOptions(budget="published"))
    assert [each.id for each in found] == ["synchronous/0_toast_42", "synchronous/0_toast_84"]
    assert "left out 2 instances" in capsys.readouterr().err


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
    assert "left out 1 instances without a known plan: synchronous/0_toast\n" in own.stderr
    assert [row.budget.rule for row in RunFolder(tmp_path / "own").rows()] == ["own"]


def _with_a_plan(pack: Pack) -> Iterator[object]:
    for instance in pack.instances:
        known = (KnownPlan(1, ("-",) * 4),) if instance.seed == 42 else ()
        yield replace(instance, plans=known)
