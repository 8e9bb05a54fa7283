"""Output, files and errors of `robotouille plan`."""

from __future__ import annotations

import json
import os
import shutil
import signal
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from robotouille import State, World, load_task
from robotouille.certification import certificate
from robotouille.certification.certificate import Certificate, check, read_certificate
from robotouille.installation import data_folder
from robotouille.planning import solvers as optimal
from robotouille.planning.kitchen import kernels
from robotouille.planning.plan import Proof, SearchResult, read_plan, replay
from robotouille.replay.recording import read_recording
from robotouille_client.cli.main import app
from tests.support.games import recorded_game
from tests.support.solvers import answering, proving

STEPS = """\
move(robot1, table3, table1)
pick-up-item(robot1, cheese1, table1)
move(robot1, table1, table2)
stack(robot1, cheese1, bread1, table2)
move(robot1, table2, table5)
pick-up-item(robot1, bread2, table5)
move(robot1, table5, table2)
stack(robot1, bread2, cheese1, table2)
"""
GOLDEN = f"""\
# task: synchronous/01_cheese_sandwich@1
# timing: benchmark
# length: 8
# bound: 8
# gap: 0
# proof: exhausted search
# planner: proving 1.0, 7 expansions
{STEPS}"""
TASK = load_task("synchronous/01")


def plan(*words: str) -> Result:
    return CliRunner().invoke(app, ["plan", *words])


SOLVE = optimal.solve


@pytest.fixture(autouse=True)
def solver(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that replaces the planner, which is `proving` at first."""

    def use(function: Any) -> None:
        monkeypatch.setattr(optimal, "solve", function)

    use(proving)
    return use


@pytest.fixture
def problem(tmp_path: Path) -> Path:
    return Path(
        shutil.copy(data_folder("problems") / "synchronous/01_cheese_sandwich.json", tmp_path)
    )


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "game.rbt"
    path.write_bytes(recorded_game("synchronous/01", steps=6))
    return path


def test_plan_prints_the_plan_and_its_proof() -> None:
    done = plan("synchronous/01")
    assert (done.exit_code, done.stdout, done.stderr) == (0, GOLDEN, "")


def test_json_output_is_a_certificate() -> None:
    done = plan("synchronous/01", "--json", "--expansions", "50")
    found = Certificate.model_validate(json.loads(done.stdout))
    assert check(found, TASK) == []
    assert found.limits.expansions == 50


def test_plan_writes_plan_and_certificate(problem: Path, tmp_path: Path) -> None:
    out = tmp_path / "best.plan"
    done = plan("synchronous/01", "--out", str(out), "--certificate")
    assert done.stdout == f"{out}: 8 steps, optimal (exhausted search)\n"
    assert out.read_text() == GOLDEN
    assert check(read_certificate(tmp_path / "best.certificate.json"), TASK) == []
    assert plan(str(problem), "--certificate").exit_code == 0
    assert check(read_certificate(problem.with_suffix(".certificate.json")), TASK) == []


def test_timing_can_be_chosen() -> None:
    done = plan("synchronous/01", "--timing", "people", "--json")
    assert json.loads(done.stdout)["timing"] == "people"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bound": 0, "unsolvable": True}, "@1 is unsolvable: no plan reaches the goal (exhausted"),
        ({"bound": 5}, "no plan found in 7 expansions; lower bound 5 (exhausted search)"),
    ],
)
def test_missing_plan_is_explained(solver: Any, changes: Any, words: str) -> None:
    solver(answering(plan=None, **changes))
    done = plan("synchronous/01")
    assert (done.exit_code, done.stdout) == (1, "")
    assert words in done.stderr


def test_wrong_bound_of_a_planner_is_an_error(solver: Any) -> None:
    solver(answering(bound=9))
    done = plan("synchronous/01")
    assert (done.exit_code, done.stdout) == (1, "")
    assert "wrong result of proving 1.0: bound: 9 is greater than the length 8" in done.stderr


# From a recording


def test_plan_from_a_recorded_state(recording: Path) -> None:
    reference = f"{recording}@4"
    done = plan("--from", reference)
    start = dict(read_recording(recording).states())[4]
    assert done.exit_code == 0
    assert f"# from: {reference}\n" in done.stdout
    assert replay(read_plan(done.stdout, start.world), start.world, start).ok
    named = plan("synchronous/01", "--from", reference, "--json")
    assert json.loads(named.stdout)["start"] == start.digest


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ([], "expected a task, a problem file or --from RECORDING@STEP"),
        (["synchronous/99"], "no task or file 'synchronous/99'"),
        (["synchronous/01@2"], "does not support 2 seats; possible: 1"),
        (["synchronous/01", "--certificate"], "--certificate needs a problem file or --out FILE"),
        (["synchronous/01", "--out", "no/such/x.plan"], "--out: no folder no/such"),
        (["--from", "RECORDING@7"], "no step 7; the steps are 0 to 6"),
        (["--from", "RECORDING"], "expected RECORDING@STEP like game.rbt@12"),
        (["--from", "RECORDING@-1"], "expected RECORDING@STEP like game.rbt@12"),
        (["--from", "missing.rbt@1"], "missing.rbt: cannot be read"),
        (["--from", "RECORDING@1", "--seats", "1"], "the recording has its own"),
        (["synchronous/02", "--from", "RECORDING@1"], "has synchronous/01_cheese_sandwich@1"),
        (
            ["synchronous/01", "--from", "RECORDING@1", "--certificate", "--out", "x.plan"],
            "leave out --from",
        ),
    ],
)
def test_invalid_arguments_are_explained(recording: Path, words: list[str], reason: str) -> None:
    done = plan(*[word.replace("RECORDING", str(recording)) for word in words])
    assert (done.exit_code, done.stdout) == (1, "")
    assert reason in done.stderr


# Stopping


def test_interrupt_returns_the_best_plan_so_far(solver: Any) -> None:
    def interrupted(world: World, start: State | None = None, **options: Any) -> SearchResult:
        assert not options["limits"].stop()
        os.kill(os.getpid(), signal.SIGINT)
        assert options["limits"].stop()
        return answering(bound=5, proof=Proof.HEURISTIC)(world, start)

    solver(interrupted)
    before = signal.getsignal(signal.SIGINT)
    done = plan("synchronous/01")
    assert done.exit_code == 0
    assert "# gap: 3\n" in done.stdout
    assert done.stdout.endswith(STEPS)
    assert signal.getsignal(signal.SIGINT) is before


def test_second_interrupt_ends_the_program(solver: Any) -> None:
    def deaf(world: World, start: State | None = None, **options: Any) -> SearchResult:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError

    solver(deaf)
    done = plan("synchronous/01")
    assert (done.exit_code, done.stdout, done.stderr) == (130, "", "interrupted\n")


def test_timeout_returns_the_best_plan_so_far(solver: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def patient(world: World, start: State | None = None, **options: Any) -> SearchResult:
        assert not options["limits"].stop()
        over = time.monotonic() + 1000
        monkeypatch.setattr(certificate, "time", SimpleNamespace(monotonic=lambda: over))
        assert options["limits"].stop()
        return answering(bound=5)(world, start)

    solver(patient)
    done = plan("synchronous/01", "--timeout", "1000", "--json")
    found = json.loads(done.stdout)
    assert (found["bound"], found["optimal"], found["limits"]["seconds"]) == (5, False, 1000)


def test_progress_goes_to_stderr(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robotouille_client.cli.plan.PATIENCE", 0.0)
    monkeypatch.setenv("FORCE_COLOR", "1")
    done = plan("synchronous/01")
    assert done.stdout == GOLDEN
    assert "7 expansions, lower bound 7, plan 8, gap 1" in done.stderr


@pytest.mark.process
def test_short_search_does_not_wait_for_the_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernels, "to_be_compiled", lambda: True)
    monkeypatch.setattr(optimal, "solve", None)  # The planner of this process is not needed.
    found = plan("synchronous/01", "--json")
    assert (json.loads(found.stdout)["length"], found.stderr) == (8, "")


@pytest.mark.slow
def test_compiling_is_announced(solver: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    solver(SOLVE)
    monkeypatch.setattr(kernels, "to_be_compiled", lambda: True)
    monkeypatch.setattr("robotouille_client.cli.plan.searched_plainly", lambda *_: None)
    kernels.announce_compiling.cache_clear()
    received = plan("synchronous/01", "--json")
    assert received.stderr.startswith("compiling the planner, which takes ")
    assert received.stderr.count("\n") == 1
    assert json.loads(received.stdout)["length"] == 8
    assert "compiling" not in plan("workshop/01").stderr, "only kitchens are compiled"


def test_plan_is_printed_if_it_cannot_be_written(tmp_path: Path) -> None:
    # The name of the draft, from which the file is renamed, is too long.
    done = plan("synchronous/01", "--out", str(tmp_path / ("x" * 255)))
    assert (done.exit_code, done.stdout) == (1, GOLDEN)
    assert "cannot be written" in done.stderr


def test_output_folder_is_refused_before_the_search(tmp_path: Path) -> None:
    done = plan("synchronous/01", "--out", str(tmp_path))
    assert (done.exit_code, done.stdout) == (1, "")
    assert "is a folder; expected a file" in done.stderr
