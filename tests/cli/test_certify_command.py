"""Output and exit status of `robotouille certify`."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from robotouille import State, World
from robotouille.certification.certificate import read_certificate
from robotouille.installation import data_folder
from robotouille.planning import solvers as optimal
from robotouille.planning.plan import Proof, SearchResult
from robotouille_client.cli.main import app
from tests.support.solvers import answering, proving

FILES = ("01_cheese_sandwich.json", "02_lettuce_sandwich.json")
FAILING = """\
folder  instances  proven  gaps  unsolved  failed
.               1       1     0         0       0
deep            1       0     0         0       1
all             2       1     0         0       1
"""


def certify(*words: str | Path) -> Result:
    return CliRunner().invoke(app, ["certify", *map(str, words)])


@pytest.fixture(autouse=True)
def solver(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that replaces the planner, which is `proving` at first."""

    def use(function: Any) -> None:
        monkeypatch.setattr(optimal, "solve", function)

    use(proving)
    return use


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    source = data_folder("problems") / "synchronous"
    (tmp_path / "deep").mkdir()
    shutil.copy(source / FILES[0], tmp_path)
    shutil.copy(source / FILES[1], tmp_path / "deep")
    return tmp_path


def test_certify_prints_a_table(folder: Path) -> None:
    done = certify(folder)
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout == (
        "folder  instances  proven  gaps  unsolved  failed\n"
        ".               1       1     0         0       0\n"
        "deep            1       1     0         0       0\n"
        "all             2       2     0         0       0\n"
    )


def test_gaps_and_unsolved_instances_are_counted(folder: Path, solver: Any) -> None:
    def modest(world: World, start: State | None = None, **options: Any) -> SearchResult:
        changes = {"bound": 3, "proof": Proof.HEURISTIC}
        if "lettuce" in world.task.name:
            changes["plan"] = None
        return answering(**changes)(world, start)

    solver(modest)
    found = json.loads(certify(folder, "--json").stdout)
    assert found == {
        "instances": 2,
        "proven": 0,
        "gaps": 1,
        "unsolved": 1,
        "failed": 0,
        "kept": 0,
        "faults": [],
    }
    assert certify(folder, "--check", "--sample", "2").exit_code == 0


@pytest.mark.slow
def test_second_run_keeps_certificates_unless_told_to_ignore_them(folder: Path) -> None:
    kept = [
        json.loads(certify(folder, "--json", *words).stdout)["kept"]
        for words in ([], [], ["--ignore-existing"], ["--expansions", "9000000"], ["--jobs", "2"])
    ]
    assert kept == [0, 2, 0, 0, 2]
    found = read_certificate(folder / "01_cheese_sandwich.certificate.json")
    assert found.limits.expansions == 9_000_000


def test_broken_problems_do_not_stop_the_others(folder: Path) -> None:
    (folder / "deep" / FILES[1]).write_text('{"version": "2.0", "goal": []}')
    (folder / "broken.json").write_text("{")
    done = certify(folder)
    assert done.exit_code == 1
    assert "02_lettuce_sandwich.json: width: Field required" in done.stderr
    assert "broken.json: is not JSON" in done.stderr
    assert (folder / "01_cheese_sandwich.certificate.json").exists()


def test_failed_instance_is_in_the_table(folder: Path, solver: Any) -> None:
    def wrong(world: World, start: State | None = None, **options: Any) -> SearchResult:
        bound = 99 if "lettuce" in world.task.name else 8
        return answering(bound=bound)(world, start)

    solver(wrong)
    done = certify(folder)
    assert (done.exit_code, done.stdout) == (1, FAILING)
    assert "wrong result of proving 1.0: bound: 99 is greater than the length 14" in done.stderr


def test_check_finds_changed_and_unproven_certificates(folder: Path, solver: Any) -> None:
    assert certify(folder, "--check").exit_code == 1
    certify(folder)
    solver(None)
    assert certify(folder, "--check").exit_code == 0
    solver(answering(bound=2))
    again = certify(folder, "--check", "--sample", "1", "--seed", "3")
    assert again.exit_code == 1
    assert "the bound could not be proven again" in again.stderr
    path = folder / "01_cheese_sandwich.certificate.json"
    path.write_text(path.read_text().replace('"bound": 8', '"bound": 7'))
    done = certify(folder, "--check", "--json")
    assert done.exit_code == 1
    (fault,) = json.loads(done.stdout)["faults"]
    assert fault.startswith(f"{path}: digest: expected ")


def test_interrupt_keeps_finished_certificates(folder: Path, solver: Any) -> None:
    def interrupted(world: World, start: State | None = None, **options: Any) -> SearchResult:
        if "lettuce" in world.task.name:
            raise KeyboardInterrupt
        return proving(world, start, **options)

    solver(interrupted)
    done = certify(folder)
    assert (done.exit_code, done.stdout) == (130, "")
    assert "finished certificates are kept" in done.stderr
    assert (folder / "01_cheese_sandwich.certificate.json").exists()


def test_progress_bar_is_shown_on_a_terminal(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("NO_COLOR", "1")
    done = certify(folder)
    assert "certifying" in done.stderr
    assert "2/2" in done.stderr


def test_shipped_folder_is_found_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "default").mkdir()
    module = "robotouille_client.cli.certify.data_folder"
    monkeypatch.setattr(module, lambda name: tmp_path)
    assert "default: the folder has no problem files" in certify("default").stderr
    assert "did you mean 'default'" in certify("defualt").stderr


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["no/such"], "no/such: is not a folder"),
        (["FOLDER", "--sample", "2"], "--sample needs --check"),
        (["FOLDER/empty"], "the folder has no problem files"),
        (["FOLDER/deep/" + FILES[1]], "is not a folder"),
    ],
)
def test_invalid_arguments_are_explained(folder: Path, words: list[str], reason: str) -> None:
    (folder / "empty").mkdir()
    done = certify(*[word.replace("FOLDER", str(folder)) for word in words])
    assert (done.exit_code, done.stdout) == (1, "")
    assert reason in done.stderr
