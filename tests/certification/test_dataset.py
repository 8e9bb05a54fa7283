"""Certification of folders: resuming, parallel runs, and reproducible files."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from robotouille import RobotouilleError, State, World
from robotouille.certification.certificate import (
    ExpansionBudget,
    content_hash,
    read_certificate,
    write_certificate,
)
from robotouille.certification.certifying import certify_dataset, check_dataset
from robotouille.certification.dataset import MANIFEST, CertifyingOutcome, Running, read_dataset
from robotouille.installation import data_folder
from robotouille.planning.plan import Proof, SearchResult
from tests.support.samples import quick_sample
from tests.support.solvers import proving

FILES = ("synchronous/01_cheese_sandwich", "synchronous/02_lettuce_sandwich")
NAMES = ["01_cheese_sandwich", "02_lettuce_sandwich", "sub/01_cheese_sandwich"]
BUDGET = ExpansionBudget(expansions=100, states=100)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return filled(tmp_path / "dataset")


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the same dataset with certificates, to copy."""
    found = filled(tmp_path_factory.mktemp("certified") / "dataset")
    certify_dataset(found, proving, budget=BUDGET)
    return found


def filled(folder: Path) -> Path:
    """Return a dataset of three instances with a domain file."""
    problems = data_folder("problems")
    (folder / "sub").mkdir(parents=True)
    for name in FILES:
        shutil.copy(problems / f"{name}.json", folder)
    shutil.copy(problems / f"{FILES[0]}.json", folder / "sub")
    shutil.copy(data_folder("domains") / "robotouille.json", folder)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def failing_at(number: int, error: BaseException) -> Any:
    """Return a planner that raises an error in its n-th search."""
    count = 0

    def solver(world: World, start: State | None = None, **options: Any) -> SearchResult:
        nonlocal count
        count += options["limits"].expansions != 0
        if count == number:
            raise error
        return proving(world, start, **options)

    return solver


def never(world: World, start: State | None = None, **options: Any) -> SearchResult:
    """Fail if called for a search."""
    assert options["limits"].expansions == 0
    return proving(world, start, **options)


def renamed(world: World, start: State | None = None, **options: Any) -> SearchResult:
    answer = proving(world, start, **options)
    return SearchResult(answer.plan, answer.bound, answer.proof, "proving 2.0", 0)


def test_each_instance_gets_a_certificate(folder: Path) -> None:
    report = certify_dataset(folder, proving, budget=BUDGET)
    assert report.faults == ()
    assert [str(outcome.instance) for outcome in report.outcomes] == NAMES
    assert not any(outcome.kept for outcome in report.outcomes)
    manifest = json.loads((folder / MANIFEST).read_text())
    assert manifest["format"] == "robotouille-dataset/1"
    assert [row["certificate"] for row in manifest["instances"]] == [
        f"{name}.certificate.json" for name in NAMES
    ]
    row, file = manifest["instances"][0], folder / f"{NAMES[0]}.json"
    written = folder / row["certificate"]
    assert row == {
        "file": file.name,
        "seats": 1,
        "file_hash": content_hash(file.read_bytes()),
        "instance": read_certificate(written).instance,
        "certificate": written.name,
        "certificate_hash": content_hash(written.read_bytes()),
        "length": 8,
        "bound": 8,
        "optimal": True,
        "proof": "exhausted search",
    }
    assert check_dataset(folder, proving, sample=2).faults == ()


def test_each_seat_count_gets_a_certificate(tmp_path: Path) -> None:
    shutil.copy(data_folder("problems") / "training/03_multi_agent.json", tmp_path)
    found = read_dataset(tmp_path).instances
    assert [(i.seats, str(i)) for i in found] == [(n, f"03_multi_agent@{n}") for n in (2, 3, 4)]


def test_two_instances_with_one_certificate_are_reported(tmp_path: Path) -> None:
    problems = data_folder("problems") / "training"
    shutil.copy(problems / "03_multi_agent.json", tmp_path / "soup.json")
    shutil.copy(problems / "01_synchronous.json", tmp_path / "soup@2.json")
    found = read_dataset(tmp_path)
    assert [str(each) for each in found.instances] == ["soup@2", "soup@3", "soup@4"]
    assert found.faults == (
        f"{tmp_path / 'soup@2.json'}: its certificate would be that of soup.json; rename one",
    )


@pytest.mark.process
def test_number_of_processes_does_not_matter(tmp_path: Path) -> None:
    one, two = filled(tmp_path / "one"), filled(tmp_path / "two")
    first = certify_dataset(one, proving, budget=BUDGET)
    second = certify_dataset(two, proving, budget=BUDGET, jobs=2)
    assert first.outcomes == second.outcomes
    assert contents(one) == contents(two)


@pytest.mark.parametrize("number", quick_sample([2, 1, 3]))
def test_interrupted_run_is_resumed(folder: Path, tmp_path: Path, number: int) -> None:
    with pytest.raises(KeyboardInterrupt):
        certify_dataset(folder, failing_at(number, KeyboardInterrupt()), budget=BUDGET)
    left = sorted(folder.rglob("*.certificate.json"))
    assert len(left) == number - 1
    assert not (folder / MANIFEST).exists()
    report = certify_dataset(folder, proving, budget=BUDGET)
    assert [outcome.kept for outcome in report.outcomes] == [i < number - 1 for i in range(3)]
    whole = filled(tmp_path / "whole")
    certify_dataset(whole, proving, budget=BUDGET)
    assert contents(folder) == contents(whole)


@pytest.mark.slow
def test_matching_certificates_are_kept(folder: Path) -> None:
    def kept(solver: Any, **options: Any) -> list[bool]:
        report = certify_dataset(folder, solver, **{"budget": BUDGET, **options})
        return [outcome.kept for outcome in report.outcomes]

    assert kept(proving) == [False] * 3
    before = contents(folder)
    assert kept(never) == [True] * 3
    assert contents(folder) == before
    assert kept(proving, ignore_existing=True) == [False] * 3
    assert kept(proving, budget=ExpansionBudget(expansions=99, states=100)) == [True] * 3
    assert kept(proving, budget=ExpansionBudget(expansions=101, states=100)) == [False] * 3
    assert kept(proving, budget=ExpansionBudget(expansions=99, states=100, seconds=9)) == [True] * 3
    assert kept(renamed, budget=ExpansionBudget(expansions=99, states=100)) == [False] * 3
    assert kept(proving) == [False] * 3
    (folder / f"{NAMES[0]}.certificate.json").write_text("{}")
    edit(folder / f"{NAMES[1]}.json", lambda problem: problem.update(goal_description="Eat."))
    assert kept(proving) == [False, False, True]
    assert check_dataset(folder, proving).faults == ()


def edit(path: Path, change: Callable[[Any], Any]) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content, indent=2) + "\n")


def test_invalid_files_are_reported(folder: Path) -> None:
    (folder / "cut.json").write_text('{"width": 3')
    (folder / "wrong.json").write_text('{"goal": [], "width": 0, "height": 3}')
    report = certify_dataset(folder, failing_at(2, RobotouilleError("no idea")), budget=BUDGET)
    faults = "\n".join(report.faults)
    assert "cut.json: is not JSON" in faults
    assert "wrong.json: width: input should be greater than or equal to 1" in faults
    assert f"{NAMES[1]}.json: no idea" in faults
    assert list(map(str, report.certificates)) == [NAMES[0], NAMES[2]]
    rows = json.loads((folder / MANIFEST).read_text())["instances"]
    assert [row["file"] for row in rows] == [f"{NAMES[0]}.json", f"{NAMES[2]}.json"]
    checked = "\n".join(check_dataset(folder, proving).faults)
    assert "cut.json: is not JSON" in checked
    assert f"{NAMES[1]}.certificate.json: cannot be read" in checked


def test_folder_without_problems_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(RobotouilleError, match="has no problem files"):
        certify_dataset(tmp_path, proving)
    with pytest.raises(RobotouilleError, match="is not a folder"):
        certify_dataset(tmp_path / "missing", proving)


def test_unwritable_folder_is_rejected(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "sub")
    with pytest.raises(RobotouilleError, match="sub: is not writable"):
        certify_dataset(folder, never, budget=BUDGET)


def test_progress_is_reported(folder: Path) -> None:
    received: list[tuple[int, int, list[Running]]] = []

    def tell(done: Any, total: int, running: Any) -> None:
        received.append((len(done), total, list(running)))

    certify_dataset(folder, proving, budget=BUDGET, tell=tell)
    first = read_dataset(folder).instances[0]
    assert (0, 3, [Running(first, 7, 7, 8)]) in received
    assert received[-1] == (3, 3, [])


@pytest.mark.parametrize(
    ("file", "change", "words"),
    [
        (f"{NAMES[0]}.json", lambda p: p.update(goal_description="Eat."), "instance: expected"),
        (f"{NAMES[0]}.certificate.json", lambda c: c.update(bound=7), "digest: expected"),
        (f"{NAMES[0]}.certificate.json", lambda c: c.pop("plan"), "plan: Field required"),
        (MANIFEST, lambda m: m["instances"].pop(), f"{NAMES[2]}.certificate.json: is missing"),
        (MANIFEST, lambda m: m["instances"].reverse(), "is not written as manifests are"),
        (MANIFEST, lambda m: m["instances"][0].update(bound=7), "bound: expected 8, found 7"),
        (
            MANIFEST,
            lambda m: m["instances"][0].update(certificate="x.certificate.json"),
            "x.certificate.json: there is no such instance",
        ),
    ],
)
def test_changed_files_are_detected(
    certified: Path, folder: Path, file: str, change: Callable[[Any], Any], words: str
) -> None:
    shutil.copytree(certified, folder, dirs_exist_ok=True)
    edit(folder / file, change)
    faults = "\n".join(check_dataset(folder, proving).faults)
    assert f"{folder / file}: " in faults or file == f"{NAMES[0]}.json"
    assert words in faults


def test_missing_and_stray_files_are_reported(folder: Path) -> None:
    certify_dataset(folder, proving, budget=BUDGET)
    (folder / MANIFEST).unlink()
    (folder / f"{NAMES[0]}.certificate.json").rename(folder / "x.certificate.json")
    faults = "\n".join(check_dataset(folder, proving).faults)
    assert "x.certificate.json: belongs to no problem file" in faults
    assert f"{MANIFEST}: cannot be read" in faults
    assert f"{NAMES[0]}.certificate.json: cannot be read" in faults


@pytest.mark.slow
def test_sample_is_proven_again(folder: Path) -> None:
    certify_dataset(folder, proving, budget=BUDGET)

    def weaker(world: World, start: State | None = None, **options: Any) -> SearchResult:
        return SearchResult(proving(world).plan, 3, Proof.HEURISTIC, "weaker", 0)

    assert check_dataset(folder, weaker).faults == ()
    one, same, all_of_them = (
        check_dataset(folder, weaker, sample=n, seed=1).faults for n in (1, 1, 9)
    )
    assert one == same
    assert (len(one), len(all_of_them)) == (1, 3)
    assert one[0].endswith("the bound could not be proven again")


@pytest.mark.parametrize(
    ("spent", "words"),
    [
        (ExpansionBudget(), "limits.expansions: is unlimited, expected at most 2,000,000"),
        (ExpansionBudget(expansions=9), "limits.states: is unlimited, expected at most 6,000,000"),
        (ExpansionBudget(expansions=9**9, states=9), "limits.expansions: is 387,420,489, expected"),
    ],
)
def test_sample_refuses_certificates_with_larger_budgets(
    certified: Path, folder: Path, spent: ExpansionBudget, words: str
) -> None:
    shutil.copytree(certified, folder, dirs_exist_ok=True)
    for path in folder.rglob("*.certificate.json"):
        draft = read_certificate(path).model_copy(update={"limits": spent})
        write_certificate(draft.model_copy(update={"digest": draft.content}), path)

    def never(*_: Any, **options: Any) -> SearchResult:
        raise AssertionError(f"a search without limits: {options}")

    faults = check_dataset(folder, never, sample=9).faults
    assert sum(words in fault for fault in faults) == 3


PROGRAM = """
import sys, threading
from pathlib import Path
from robotouille.certification.certifying import certify_dataset
from tests.support.solvers import proving

def endless(world, start=None, **options):
    if "lettuce" in world.task.name:
        threading.Event().wait()
    return proving(world, start, **options)

if __name__ == "__main__":
    tell = lambda done, *_: print(len(done), flush=True)
    try:
        certify_dataset(Path(sys.argv[1]), endless, jobs=2, tell=tell)
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.process
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_no_process_outlives_the_run(folder: Path, number: int, status: int) -> None:
    program = folder.parent / "program.py"
    program.write_text(PROGRAM)
    root = str(Path(__file__).parents[2])
    command = [sys.executable, str(program), str(folder)]
    environment = {**os.environ, "PYTHONPATH": root}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE) as run:
        assert run.stdout is not None
        while run.stdout.readline() != b"2\n":
            assert run.poll() is None
        workers = psutil.Process(run.pid).children(recursive=True)
        assert len(workers) >= 2
        run.send_signal(number)
        try:
            # The output ends when no process can write to it any more.
            run.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            run.kill()
            for worker in workers:
                with suppress(psutil.NoSuchProcess):
                    worker.kill()
            raise
        assert run.returncode == status
    assert not (folder / MANIFEST).exists()
    left = {o.instance.file for o in outcomes(folder) if o.kept}
    assert left == {f"{NAMES[0]}.json", f"{NAMES[2]}.json"}


def outcomes(folder: Path) -> tuple[CertifyingOutcome, ...]:
    return check_dataset(folder, proving).outcomes
