"""Command `robotouille benchmark`."""

from __future__ import annotations

import errno
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from robotouille.errors import UnknownNameError
from robotouille.planning.kitchen import kernels
from robotouille_evaluation.cli import planning
from robotouille_evaluation.cli.benchmark import benchmark
from robotouille_evaluation.cli.models import ModelChoice
from robotouille_evaluation.cli.planning import agent_spec
from robotouille_evaluation.cli.run_options import RunOptions
from robotouille_evaluation.packs.experiment import Experiment
from robotouille_evaluation.packs.own import build_own_pack
from robotouille_evaluation.packs.store import read_pack, write_pack
from robotouille_evaluation.report.grouping import named
from robotouille_evaluation.runs import RunFolder
from tests.support.samples import quick_sample

SANDWICH = "synchronous/01_cheese_sandwich"
TEAM = "multi_agent/01_lettuce_burger"
MODEL = ["--tasks", SANDWICH, "--kinds", "default", "--agents", "react-none"]

pytestmark = pytest.mark.usefixtures("no_report")


def called(*words: str | Path) -> Result:
    return CliRunner().invoke(benchmark, [str(word) for word in words])


def test_run_is_played_and_not_overwritten(tmp_path: Path) -> None:
    run = tmp_path / "run"
    first = called("run", run, *MODEL)
    assert first.exit_code == 0, first.output
    (row,) = RunFolder(run).rows()
    assert row.agent == "react-none (mock)"
    assert first.stdout == f"{run / 'report' / 'report.html'}\n"
    expected = [line.split() for line in first.stderr.splitlines()]
    assert ["agent", "episodes", "success", "errors"] in [
        [word for word in line if word not in ("steps", "/", "optimum")] for line in expected
    ]
    assert any(line[:3] == ["react-none", "(mock)", "1"] for line in expected)
    before = {p: p.read_bytes() for p in run.rglob("*") if p.is_file()}
    again = called("run", run, *MODEL)
    assert again.exit_code == 1
    assert "already has a run" in again.output
    assert "choose another folder" in again.output
    assert {p: p.read_bytes() for p in run.rglob("*") if p.is_file()} == before
    assert called("resume", run).exit_code == 0
    assert (run / "rows.jsonl").read_bytes() == before[run / "rows.jsonl"]


@pytest.mark.slow
def test_later_of_two_runs_leaves_the_pack_of_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "run"
    plan_run = planning.plan_run

    def overtaken(out: Path, options: RunOptions) -> planning.PlannedRun:
        planned = plan_run(out, options)
        monkeypatch.setattr(planning, "plan_run", plan_run)
        assert called("run", run, *MODEL).exit_code == 0
        return planned

    monkeypatch.setattr(planning, "plan_run", overtaken)
    later = called("run", run, "--pack", "shifts", "--agents", "random", "--limit", "1")
    assert later.exit_code == 1
    assert "already has a run" in later.output
    assert read_pack(run / "pack").digest == RunFolder(run).plan().pack.digest


def test_run_whose_pack_cannot_be_written_does_not_begin(tmp_path: Path) -> None:
    (tmp_path / "pack").mkdir()
    (tmp_path / "pack" / "thesis.txt").touch()
    assert "not a pack: thesis.txt; choose another folder" in called("run", tmp_path, *MODEL).output
    assert [path.name for path in tmp_path.iterdir()] == ["pack"]


@pytest.mark.usefixtures("no_processes")
@pytest.mark.parametrize(
    ("agent", "announced"), quick_sample([("planner", True), ("random", False)])
)
def test_compiling_in_other_processes_is_announced(
    agent: str, announced: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernels.announce_compiling.cache_clear()
    monkeypatch.setattr(kernels, "to_be_compiled", lambda: True)
    monkeypatch.setenv("ROBOTOUILLE_COMPILE", "0")  # for the other processes
    words = ["--tasks", SANDWICH, "--kinds", "default", "--agents", agent]
    result = called("run", tmp_path / "run", *words)
    assert result.exit_code == 0, result.output
    assert ("compiling the planner" in result.stderr) is announced


def test_trained_policy_is_sent_to_cross_play(tmp_path: Path) -> None:
    words = ["--tasks", SANDWICH, "--agents", "runs/burger/training_03_ippo_0.npz"]
    result = called("run", tmp_path / "run", *words)
    assert result.exit_code == 1
    assert "`robotouille cross-play TASK runs/burger/training_03_ippo_0.npz`" in result.stderr


@pytest.mark.slow
def test_temperatures_are_players_of_their_own(tmp_path: Path) -> None:
    for temperature in ("0", "1"):
        words = ["--model", "mock", "--temperature", temperature]
        assert called("run", tmp_path / temperature, *MODEL, *words).exit_code == 0
    rows = [row for name in ("0", "1") for row in RunFolder(tmp_path / name).rows()]
    assert [row.sampling for row in rows] == ["temperature 0", "temperature 1"]
    players = [f"react-none (mock, temperature {degrees})" for degrees in (0, 1)]
    assert list(named(rows)) == players
    result = called("compare", *players, tmp_path / "0", tmp_path / "1", "--json")
    assert json.loads(result.stdout)["episodes"] == 1


@pytest.mark.slow
def test_shifts_have_scores_instead_of_successes(tmp_path: Path) -> None:
    words = ["--tasks", "shifts/01", "--seats", "2", "--agents", "random", "--processes", "1"]
    result = called("run", tmp_path / "run", *words)
    assert result.exit_code == 0, result.output
    (row,) = RunFolder(tmp_path / "run").rows()
    assert (row.dataset, row.seats, row.budget.rule) == ("shifts", 2, "shift")
    assert row.score is not None and row.score.planner is not None
    heading = next(line for line in result.stderr.splitlines() if line.startswith("agent"))
    assert "score / planner" in heading and "success" not in heading
    assert called("resume", tmp_path / "run").exit_code == 0


@pytest.mark.slow
@pytest.mark.parametrize("variant", quick_sample([["--variant", "delay-free"], []]))
def test_option_seats(tmp_path: Path, variant: list[str]) -> None:
    words = ["--tasks", TEAM, "--kinds", "default", "--agents", "react-none", "--seats", "3"]
    result = called("run", tmp_path / "run", *words, *variant)
    assert result.exit_code == 0, result.output
    (row,) = RunFolder(tmp_path / "run").rows()
    assert row.seats == 3
    assert row.optimum.steps is not None, "the plan is for three players"
    assert called("resume", tmp_path / "run").exit_code == 0


@pytest.mark.slow
def test_options_of_real_time(tmp_path: Path) -> None:
    words = ["--clock", "realtime", "--step-rate", "4", "--charge", "declared:500", "--slack", "2"]
    result = called("run", tmp_path / "run", *MODEL, *words, "--late", "drop", "--helper", "script")
    assert result.exit_code == 0, result.output
    (row,) = RunFolder(tmp_path / "run").rows()
    assert (row.clock, row.budget.rule, row.error) == ("realtime", "own x 2", None)
    assert str(row.real_time) == "4 steps/s, declared:500, drop, helper script"
    assert row.outcome.success, "the helper carries out the plan"
    assert called("resume", tmp_path / "run").exit_code == 0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--agents", "react-nnone"], "react-none"),
        (["--agents", "planer"], "no agent 'planer'; did you mean 'planner'?"),
        (["--agents", "react-last"], "or 'react-last-reasoning-action'?"),
        (["--agents", "x"], "no agent 'x'; choose planner, random, scripted, io"),
        (["--datasets", "sync"], "unknown data set 'sync'; did you mean 'synchronous'?"),
        (["--datasets", "x"], "unknown data set 'x'; choose synchronous, asynchronous"),
        (["--agents", "random,random"], "two agents are named 'random'"),
        (["--datasets", "synchronus"], "synchronous"),
        (["--clock", "realtime", "--charge", "wall"], "is not repeatable"),
        (["--clock", "realtime", "--charge", "token:3"], "expected wall, tokens:MILLISECONDS"),
        (["--helper", "planner"], "--helper is only for --clock realtime"),
        (["--digest-tokens", "9"], "--digest-tokens is only for --clock realtime"),
        (["--seats", "5", "--tasks", f"{TEAM},{SANDWICH}"],
          f"5 players are not possible for {SANDWICH} (possible: 1); {TEAM} (possible: 2, 3, 4)"),
        pytest.param(["--seats", "3"], "; and ", marks=pytest.mark.slow),
        (["--seats", "2", "--variant", "delay-free", "--tasks", SANDWICH], "2 players are not"),
        (["--kinds", "tidy"], "unknown kind of instance 'tidy'"),
        (["--tasks", "synchronous/99"], "synchronous/99"),
        (["--pack", "nowhere"], "nowhere"),
        (["--agents", "ReAct/asynchronous/nope"], "use --pack with an imported one"),
        (["--datasets", "shifts,synchronous"], "different packs: evaluate them in two runs"),
        (["--datasets", "shifts"], "`scripted` needs a plan, and none is known for shifts/01"),
        (["--datasets", "shifts", "--variant", "delay-free"], "a shift has no goal"),
        (["--tasks", "shifts/01", "--clock", "realtime", "--slack", "2"], "no --slack"),
        (["--budget", "published", "--tasks", "multi_agent/10_potato_tomato_chicken_soup_and_"
          "potato_cheese_onion_soup"], "no constant"),
    ],
)  # fmt: skip
def test_invalid_options_are_refused_early(tmp_path: Path, words: list[str], expected: str) -> None:
    result = called("run", tmp_path / "run", *words)
    assert result.exit_code == 1
    assert expected in result.output
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
@pytest.mark.process  # The SDK asks `uname` where it runs.
def test_resume_repeats_episodes_with_errors(tmp_path: Path) -> None:
    run = tmp_path / "run"
    nobody = "http://127.0.0.1:9/v1"
    result = called("run", run, *MODEL, "--model", "m", "--base-url", nobody)
    assert result.exit_code == 1 and "1 errors" in result.output
    (row,) = RunFolder(run).rows()
    assert row.outcome.ended_by == "error"
    assert row.error is not None
    assert called("resume", run).exit_code == 1
    assert len((run / "rows.jsonl").read_text().splitlines()) == 2
    assert len(RunFolder(run).rows()) == 1
    (job,) = RunFolder(run).plan().jobs
    assert job.agent.base_url == nobody


def test_long_names_of_a_pack_are_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    long = ("x" * 1_000_000, "published experiment: io on 1 tasks")
    monkeypatch.setattr(planning, "agent_lines", lambda experiments: iter([("io", "asks"), long]))
    lines = called("agents").output.splitlines()
    assert len(lines) == 2
    assert max(map(len, lines)) <= 500
    assert len(lines[0]) < 100


def test_unknown_experiments() -> None:
    settings = [
        Experiment(f"{agent}/{dataset}/{name}", agent, (), (), (), {})
        for agent in ("ReAct", "IO") for dataset in ("synchronous", "asynchronous")
        for name in ("original", "last-action")
    ]  # fmt: skip
    known = replace(build_own_pack(), experiments=tuple(settings))
    with pytest.raises(UnknownNameError) as caught:
        agent_spec("ReAct/asynchronous/nope", known, ModelChoice("mock"))
    assert "ReAct/asynchronous/original, ReAct/asynchronous/last-action" in str(caught.value)
    assert "IO" not in str(caught.value) and "ReAct/synchronous" not in str(caught.value)


def test_unknown_optima_are_reported(tmp_path: Path) -> None:
    whole = build_own_pack()
    kept = [i for i in whole.instances if i.task == SANDWICH and i.kind == "default"]
    write_pack(
        replace(whole, instances=tuple(replace(i, plans=()) for i in kept)), tmp_path / "pack"
    )
    words = ["--pack", tmp_path / "pack", "--budget", "published"]
    result = called("run", tmp_path / "run", *MODEL, *words)
    assert result.exit_code == 0, result.output
    assert "1 of 1 instances have no known shortest plan" in result.output
    assert f"robotouille pack prove {tmp_path / 'pack'}" in result.output


@pytest.mark.slow
def test_resume_refuses_another_pack(tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert called("run", run, *MODEL).exit_code == 0
    rows = (run / "rows.jsonl").read_bytes()
    other = replace(read_pack(run / "pack"), version="2")
    write_pack(other, run / "pack")
    result = called("resume", run)
    assert result.exit_code == 1
    assert "another pack" in result.output
    (run / "pack" / "manifest.json").unlink()
    result = called("resume", run)
    assert result.exit_code == 1 and "manifest.json" in result.output
    assert (run / "rows.jsonl").read_bytes() == rows


def test_report_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any, **__: Any) -> Path:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("robotouille_evaluation.report.write_report", full)
    result = called("run", tmp_path / "run", *MODEL)
    assert result.exit_code == 1
    assert "No space left on device" in result.output and "benchmark report" in result.output
    assert len(RunFolder(tmp_path / "run").rows()) == 1


@pytest.mark.slow
@pytest.mark.process
def test_variants_are_not_mixed(tmp_path: Path) -> None:
    soup = "asynchronous/06_potato_soup"
    words = ["--tasks", soup, "--kinds", "default", "--agents", "planner,scripted"]
    rows = {}
    for variant in ("", "stochastic", "delay-free"):
        chosen = ["--variant", variant] if variant else []
        result = called("run", tmp_path / f"r{variant}", *words, *chosen, "--processes", "1")
        assert result.exit_code == 0, result.output
        rows[variant] = RunFolder(tmp_path / f"r{variant}").rows()
        assert {row.variant for row in rows[variant]} == {variant}
        assert all(row.outcome.success for row in rows[variant])
        assert called("resume", tmp_path / f"r{variant}").exit_code == 0
    plain, free = rows[""][0], rows["delay-free"][0]
    assert free.pack.name == "ours-delay-free" and free.pack.digest != plain.pack.digest
    assert free.optimum.steps is not None and plain.optimum.steps is not None
    assert free.optimum.steps < plain.optimum.steps
    assert free.budget.steps == -(-free.optimum.steps * 3 // 2)
    both = ["planner", "scripted", tmp_path / "r", tmp_path / "rstochastic"]
    mixed = called("compare", *both)
    assert mixed.exit_code == 1 and "several variants" in mixed.output
    for variant in ("none", "stochastic"):
        one = called("compare", *both, "--variant", variant, "--json")
        assert json.loads(one.output)["episodes"] == 1


@pytest.mark.slow
def test_agreement_with_labels(tmp_path: Path) -> None:
    run = tmp_path / "run"
    words = ["--tasks", SANDWICH, "--kinds", "default", "--agents", "random", "--seeds", "6"]
    assert called("run", run, *words, "--processes", "1").exit_code == 0
    failed = [row for row in RunFolder(run).rows() if row.measures.failure]
    assert len(failed) > 2
    labels = tmp_path / "labels.csv"

    def label(*categories: str) -> Result:
        lines = [f"{row.recording},{c}" for row, c in zip(failed, categories, strict=True)]
        labels.write_text("\n".join(["recording,category", *lines]), encoding="utf-8")
        return called("agreement", labels, run)

    same = [row.measures.failure.category for row in failed if row.measures.failure]
    assert f"{len(failed)} episodes; Cohen's kappa" in label(*same).output
    other = next(c for c in ("state", "goal") if c != same[0])
    expected = label(other, *same[1:]).output
    assert f"{failed[0].recording}: {other}, classified as {same[0]}" in expected
    assert expected.count("classified as") == 1
    labels.write_text("recording,category\nrecordings/other.rbt,goal\n", encoding="utf-8")
    result = called("agreement", labels, run)
    assert result.exit_code == 1
    assert "has no label of a failed episode of these runs" in result.output
