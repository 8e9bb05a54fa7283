"""Command `benchmark measure`: measures that a run did not compute while playing."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from robotouille_client.cli.main import app
from robotouille_evaluation.metrics import ResultRow
from robotouille_evaluation.packs.published_checkout import read_checkout
from robotouille_evaluation.packs.store import write_pack
from robotouille_evaluation.runs import RunFolder
from tests.support.checkouts import write_checkout

pytest.importorskip("yaml")


def called(*words: str | Path) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(autouse=True)
def reported(monkeypatch: pytest.MonkeyPatch) -> list[list[ResultRow]]:
    """Return the rows of all reports. Figures take seconds and have tests of their own."""
    found: list[list[ResultRow]] = []

    def write_report(rows: list[ResultRow], folder: Path, **_: Any) -> Path:
        found.append(rows)
        return folder / "report.html"

    monkeypatch.setattr("robotouille_evaluation.report.write_report", write_report)
    return found


@pytest.fixture
def toast(tmp_path: Path) -> Path:
    """Return the folder of an imported pack without plans."""
    pack = read_checkout(write_checkout(tmp_path / "checkout"), seeds=(42, 84)).pack
    write_pack(pack, tmp_path / "pack")
    return tmp_path / "pack"


def play(run: Path, pack: Path, *more: str) -> list[ResultRow]:
    words = ("--agents", "ReAct/plain", "--budget", "published", *more)
    result = called("benchmark", "run", run, "--pack", pack, *words)
    assert result.exit_code == 0, result.output
    return rows_of(run)


def rows_of(run: Path) -> list[ResultRow]:
    """Return the rows of a run without the time that they took."""
    rows = sorted(RunFolder(run).rows(), key=lambda row: row.instance)
    return [row.model_copy(update={"seconds": 0.0, "run": ""}) for row in rows]


def measure(run: Path, *more: str | Path) -> Result:
    return called("benchmark", "measure", run, "--processes", "1", *more)


@pytest.mark.slow
def test_measures_after_a_proof_are_those_of_a_run_after_it(
    tmp_path: Path, toast: Path, reported: list[list[ResultRow]]
) -> None:
    before = play(tmp_path / "early", toast)
    assert {row.optimum.steps for row in before} == {None}
    assert called("pack", "prove", toast).exit_code == 0
    wanted = play(tmp_path / "late", toast, "--steps-to-go")
    assert all(row.optimum.proven and row.measures.to_go_least is not None for row in wanted)
    result = measure(tmp_path / "early")
    assert result.exit_code == 0, result.output
    assert result.stdout == f"{tmp_path / 'early/report/report.html'}\n"
    assert "2 of 2 episodes newly measured\n" in result.stderr
    early = rows_of(tmp_path / "early")
    assert [row.pack.digest for row in early] == [row.pack.digest for row in before]
    assert [row.model_copy(update={"pack": late.pack})
            for row, late in zip(early, wanted, strict=True)] == wanted  # fmt: skip
    assert sorted(row.optimum.steps or 0 for row in reported[-1]) == [
        row.optimum.steps for row in sorted(wanted, key=lambda row: row.optimum.steps or 0)
    ]


def test_results_are_kept(tmp_path: Path, toast: Path) -> None:
    play(tmp_path / "run", toast)
    first = measure(tmp_path / "run")
    assert first.stderr.endswith(
        "2 of 2 episodes newly measured; 2 have no proven optimum (`robotouille pack prove`)\n"
    )
    kept = (tmp_path / "run/rows.jsonl").read_bytes()
    again = measure(tmp_path / "run")
    assert again.exit_code == 0, again.output
    assert "0 of 2 episodes newly measured" in again.stderr
    assert (tmp_path / "run/rows.jsonl").read_bytes() == kept
    assert called("benchmark", "resume", tmp_path / "run").exit_code == 0
    assert rows_of(tmp_path / "run")[0].measures.to_go_least is not None


@pytest.mark.slow
@pytest.mark.process
def test_several_processes_measure_the_same(tmp_path: Path, toast: Path) -> None:
    play(tmp_path / "run", toast)
    shutil.copytree(tmp_path / "run", tmp_path / "twin")
    assert measure(tmp_path / "run").exit_code == 0
    assert called("benchmark", "measure", tmp_path / "twin", "--processes", "2").exit_code == 0
    assert rows_of(tmp_path / "twin") == rows_of(tmp_path / "run")


def test_unreadable_recording_is_named_and_the_others_are_measured(
    tmp_path: Path, toast: Path
) -> None:
    broken, _ = play(tmp_path / "run", toast)
    assert broken.recording is not None
    (tmp_path / "run" / broken.recording).write_bytes(b"nothing")
    result = measure(tmp_path / "run")
    assert result.exit_code == 1
    assert f"{tmp_path / 'run' / broken.recording}: " in result.stderr
    assert "1 of 2 episodes newly measured" in result.stderr
    measured = [row.measures.to_go_least is not None for row in rows_of(tmp_path / "run")]
    assert measured == [False, True]


def test_results_without_a_plan_need_the_pack(tmp_path: Path, toast: Path) -> None:
    """Evaluations with Inspect write rows and recordings only."""
    play(tmp_path / "run", toast)
    (tmp_path / "run/run.json").unlink()
    refused = measure(tmp_path / "run")
    assert refused.exit_code == 1 and "choose it with --pack" in refused.stderr
    assert measure(tmp_path / "run", "--pack", toast).exit_code == 0


def test_run_that_another_process_plays_is_refused(tmp_path: Path, toast: Path) -> None:
    play(tmp_path / "run", toast)
    with RunFolder(tmp_path / "run").playing():
        refused = measure(tmp_path / "run")
    assert refused.exit_code == 1 and "is being played by another process" in refused.stderr
    nothing = measure(tmp_path / "nowhere")
    assert nothing.exit_code == 1 and "has no finished episode" in nothing.stderr
