"""`robotouille plan`: what it prints, writes and refuses."""

from __future__ import annotations

import json
import os
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from robotouille import State, World, load_task
from robotouille.certification.certificate import Certificate, check, read_certificate
from robotouille.planners.kitchen import kernels
from robotouille.planning import solvers as optimal
from robotouille.planning.plan import read_plan
from robotouille.planning.search_result import Proof, SearchResult
from robotouille.planning.validation import replay
from robotouille.replay.recording import read_recording
from robotouille.resources import data_folder
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


@pytest.fixture(autouse=True)
def solver(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Sets the planner; `proving` until another is set."""

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


def test_the_plan_and_what_is_proven() -> None:
    done = plan("synchronous/01")
    assert (done.exit_code, done.stdout, done.stderr) == (0, GOLDEN, "")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bound": 5, "proof": Proof.HEURISTIC}, "# bound: 5\n# gap: 3\n# proof: admissible"),
        ({"bound": 0, "proof": Proof.NONE}, "# bound: 0\n# gap: 8\n# proof: none\n"),
    ],
)
def test_no_more_is_claimed_than_is_proven(solver: Any, changes: Any, words: str) -> None:
    solver(answering(**changes))
    done = plan("synchronous/01")
    assert done.exit_code == 0
    assert words in done.stdout


def test_json_is_a_certificate() -> None:
    done = plan("synchronous/01", "--json", "--expansions", "50")
    found = Certificate.model_validate(json.loads(done.stdout))
    assert check(found, TASK) == []
    assert found.limits.expansions == 50


def test_files(problem: Path, tmp_path: Path) -> None:
    out = tmp_path / "best.plan"
    done = plan("synchronous/01", "--out", str(out), "--certificate")
    assert done.stdout == f"{out}: 8 steps, optimal (exhausted search)\n"
    assert out.read_text() == GOLDEN
    assert check(read_certificate(tmp_path / "best.certificate.json"), TASK) == []
    assert plan(str(problem), "--certificate").exit_code == 0
    assert check(read_certificate(problem.with_suffix(".certificate.json")), TASK) == []


def test_timing_and_seats() -> None:
    done = plan("multi_agent/01@3", "--timing", "people", "--json")
    found = json.loads(done.stdout)
    assert (found["seats"], found["timing"]) == (3, "people")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bound": 0, "unsolvable": True}, "@1 is unsolvable: no plan reaches the goal (exhausted"),
        ({"bound": 5}, "no plan was found in 7 expansions; bound 5 (exhausted search)"),
    ],
)
def test_without_a_plan(solver: Any, changes: Any, words: str) -> None:
    solver(answering(plan=None, **changes))
    done = plan("synchronous/01")
    assert (done.exit_code, done.stdout) == (1, "")
    assert words in done.stderr


def test_a_wrong_planner_is_not_believed(solver: Any) -> None:
    solver(answering(bound=9))
    done = plan("synchronous/01")
    assert (done.exit_code, done.stdout) == (1, "")
    assert "proving 1.0 is wrong: bound: 9 is above the length 8" in done.stderr


# From a recording


def test_from_where_a_recorded_game_stood(recording: Path) -> None:
    reference = f"{recording}@4"
    done = plan("--from", reference)
    start = dict(read_recording(recording).states())[4]
    assert done.exit_code == 0
    assert f"# from: {reference}\n" in done.stdout
    assert replay(read_plan(done.stdout, start.world), start.world, start).ok
    named = plan("synchronous/01", "--from", reference, "--json")
    assert json.loads(named.stdout)["start"] == start.digest


def test_from_the_first_and_the_last_step(recording: Path) -> None:
    first = plan("--from", f"{recording}@0")
    assert first.stdout.endswith(STEPS)
    assert plan("--from", f"{recording}@6").exit_code == 0


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ([], "expected a task, a problem file or --from RECORDING@STEP"),
        (["synchronous/99"], "no task or file 'synchronous/99'"),
        (["synchronous/01@2"], "2 seats asked for; possible: 1"),
        (["synchronous/01", "--certificate"], "--certificate needs a problem file or --out FILE"),
        (["synchronous/01", "--out", "no/such/x.plan"], "there is no folder no/such"),
        (["--from", "RECORDING@7"], "there is no step 7; it has the steps 0 to 6"),
        (["--from", "RECORDING"], "expected RECORDING@STEP like game.rbt@12"),
        (["--from", "RECORDING@-1"], "expected RECORDING@STEP like game.rbt@12"),
        (["--from", "missing.rbt@1"], "missing.rbt: cannot be read"),
        (["--from", "RECORDING@1", "--seats", "1"], "its own seats and timing"),
        (["synchronous/02", "--from", "RECORDING@1"], "is of synchronous/01_cheese_sandwich@1"),
        (
            ["synchronous/01", "--from", "RECORDING@1", "--certificate", "--out", "x.plan"],
            "leave out --from",
        ),
    ],
)
def test_what_is_wrong_is_said(recording: Path, words: list[str], reason: str) -> None:
    done = plan(*[word.replace("RECORDING", str(recording)) for word in words])
    assert (done.exit_code, done.stdout) == (1, "")
    assert reason in done.stderr


# Stopping


def test_an_interrupt_takes_the_best_so_far(solver: Any) -> None:
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


def test_a_second_interrupt_ends_the_program(solver: Any) -> None:
    def deaf(world: World, start: State | None = None, **options: Any) -> SearchResult:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError

    solver(deaf)
    done = plan("synchronous/01")
    assert (done.exit_code, done.stdout, done.stderr) == (130, "", "interrupted\n")


def test_a_timeout_takes_the_best_so_far(solver: Any) -> None:
    def patient(world: World, start: State | None = None, **options: Any) -> SearchResult:
        while not options["limits"].stop():
            time.sleep(0.01)
        return answering(bound=5)(world, start)

    solver(patient)
    done = plan("synchronous/01", "--timeout", "0.1", "--json")
    found = json.loads(done.stdout)
    assert (found["bound"], found["optimal"], found["limits"]["seconds"]) == (5, False, 0.1)


def test_progress_is_not_in_the_output(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("robotouille_client.cli.plan.PATIENCE", 0.0)
    monkeypatch.setenv("FORCE_COLOR", "1")
    done = plan("synchronous/01")
    assert done.stdout == GOLDEN
    assert "7 expansions, bound 7, plan 8, gap 1" in done.stderr


def test_compiling_is_told_before_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernels, "to_be_compiled", lambda: True)
    told = plan("synchronous/01", "--json")
    assert told.stderr.startswith("compiling the planner, once for this machine: ")
    assert told.stderr.count("\n") == 1
    assert json.loads(told.stdout)["length"] == 8
    assert "compiling" not in plan("workshop/01").stderr, "only kitchens have kernels"


def test_a_plan_is_printed_if_it_cannot_be_written(tmp_path: Path) -> None:
    done = plan("synchronous/01", "--out", str(tmp_path / ("x" * 300)))
    assert (done.exit_code, done.stdout) == (1, GOLDEN)
    assert "cannot be written" in done.stderr


def test_a_folder_is_refused_before_the_search(tmp_path: Path) -> None:
    done = plan("synchronous/01", "--out", str(tmp_path))
    assert (done.exit_code, done.stdout) == (1, "")
    assert "is a folder; expected a file" in done.stderr
