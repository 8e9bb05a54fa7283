"""Validity of every certificate and plan in the repository."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from robotouille import Task, World, load_task, task_names
from robotouille.certification.certificate import Certificate, check, prove_again
from robotouille.certification.dataset import Dataset, DatasetEntry, read_dataset
from robotouille.errors import RobotouilleError
from robotouille.installation import data_folder
from robotouille.planning.plan import read_plan, replay
from robotouille.planning.solvers import solve
from tests.support.samples import quick_sample
from tests.world.reference import Call, Reference, ReferenceState

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
TASKS = ("synchronous", "asynchronous", "multi_agent")
GENERATED = tuple(f"generated/{folder}" for folder in TASKS)
FOLDERS = (*TASKS, "training", *GENERATED)
DATASETS = (*TASKS, "training", "generated")

FEW = 300
"""Bounds that took no more expansions are proven again; `robotouille certify --check --sample` does
so with any."""


@cache
def dataset(folder: str) -> Dataset:
    found = read_dataset(PROBLEMS / folder)
    assert not found.faults
    return found


def certified(folder: str) -> Iterator[tuple[DatasetEntry, Task, Certificate]]:
    """Return the instances of a folder with a certificate."""
    found = dataset(folder)
    for instance in found.instances:
        if (found.folder / instance.certificate).exists():
            yield instance, found.task(instance), found.certificate(instance)


# Nothing is missing


@pytest.mark.slow
@pytest.mark.parametrize("folder", FOLDERS)
def test_every_instance_has_a_certificate(folder: str) -> None:
    names = {instance.certificate for instance in dataset(folder).instances}
    found = {path.name for path in (PROBLEMS / folder).glob("*.certificate.json")}
    assert sorted(names - found) == []
    assert sorted(found - names) == []


@pytest.mark.slow
@pytest.mark.parametrize("folder", TASKS)
def test_every_task_has_ten_free_instances_and_five_noisy_ones(folder: str) -> None:
    tasks = {i.file.removesuffix(".json") for i in dataset(folder).instances}
    noisy = {84, 168, 252, 336, 420}
    wanted = {
        f"{task}_s{seed}.json": "noisy" if seed in noisy else "free"
        for task in tasks
        for seed in range(42, 631, 42)
    }
    assert len(wanted) == 150
    found = dataset(f"generated/{folder}")
    received = {i.file: found.task(i).problem.provenance for i in found.instances}
    assert {file: source.kind for file, source in received.items() if source is not None} == wanted


# Hashes, claims and plans


@pytest.mark.slow
@pytest.mark.parametrize("folder", quick_sample(FOLDERS, 0, nightly=4))
def test_certificates_are_valid(folder: str) -> None:
    wrong = []
    for instance, task, found in certified(folder):
        problems = check(found, task) or replay_on_the_reference(found, task)
        wrong += [f"{instance}: {problem}" for problem in problems]
    assert wrong == []


def replay_on_the_reference(found: Certificate, task: Task) -> list[str]:
    """Return the faults of a plan, which must reach the goal in its last step."""
    reference = Reference(task)
    state = reference.initial
    for number, line in enumerate(found.plan or (), start=1):
        if goal_met(reference, state):
            return [f"the goal is reached before step {number}"]
        joint = list(calls(line))
        state, applied = reference.step(state, joint)
        if not all(applied):
            return [f"step {number}: {line}: {applied}"]
    if found.plan is not None and not goal_met(reference, state):
        return ["the goal is not reached"]
    return []


def calls(line: str) -> Iterator[tuple[str, Call]]:
    """Return the players and actions of a line of a plan."""
    if line == "-":
        return
    for text in line.split("; "):
        matched = re.fullmatch(r"([\w-]+)\((.*)\)", text)
        assert matched, line
        arguments = tuple(matched[2].split(", "))
        yield arguments[0], (matched[1], arguments)


def goal_met(reference: Reference, state: ReferenceState) -> bool:
    """Return `Reference.goal_reached`, skipping assignments that must fail."""
    goal = reference.task.problem.goal
    kinds: dict[int | str, str] = {}
    for term in goal:
        for variable, kind in zip(term.ids, term.args, strict=True):
            kinds.setdefault(variable, kind)
    labelled = {o.label: o.name for o in reference.placed if isinstance(o.label, str)}

    def holds(chosen: dict[int | str, str]) -> bool:
        """Return whether the terms with chosen objects are true."""
        return all(
            (term.predicate, *(chosen[i] for i in term.ids)) in state.facts
            for term in goal
            if chosen.keys() >= set(term.ids)
        )

    def choose(chosen: dict[int | str, str], open_: list[int | str]) -> bool:
        if not open_:
            return True
        variable, kind = open_[0], kinds[open_[0]]
        taken = {name for other, name in chosen.items() if kinds[other] == kind}
        for name, (own, type_) in state.objects.items():
            fits = labelled[variable] == name if variable in labelled else kind in (own, type_)
            if fits and name not in taken:
                more = {**chosen, variable: name}
                if holds(more) and choose(more, open_[1:]):
                    return True
        return False

    return choose({}, list(kinds))


# Manifests


def hashed(path: Path) -> str:
    return hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()


def row(folder: Path, instance: DatasetEntry) -> dict[str, Any]:
    """Return the expected manifest entry of an instance, read from the files."""
    found = json.loads((folder / instance.certificate).read_text(encoding="utf-8"))
    kept = ("instance", "length", "bound", "optimal", "proof")
    return {
        "file": instance.file,
        "seats": instance.seats,
        "file_hash": hashed(folder / instance.file),
        "certificate": instance.certificate,
        "certificate_hash": hashed(folder / instance.certificate),
        **{field: found[field] for field in kept},
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", DATASETS)
def test_manifest_matches_the_files(name: str) -> None:
    folder = PROBLEMS / name
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["format"] == "robotouille-dataset/1"
    assert manifest["instances"] == [row(folder, i) for i in dataset(name).instances]


# Bounds


@pytest.mark.slow
@pytest.mark.parametrize(
    "folder", quick_sample([f for f in FOLDERS if "multi_agent" not in f], 0, nightly=3)
)
def test_bounds_are_proven_again(folder: str) -> None:
    again = 0
    for instance, task, found in certified(folder):
        if task.seats == 1 and found.expansions <= FEW:
            try:
                assert prove_again(found, task, solve, found.limits.limits()), instance
            except RobotouilleError as error:
                pytest.fail(f"{instance}: {error}")
            again += 1
    assert again > 0


def test_all_shipped_tasks_for_one_player_are_proven() -> None:
    for folder in ("synchronous", "asynchronous"):
        assert all(found.optimal for _, _, found in certified(folder))


CASES = [
    (name, seats)
    for name in task_names()
    if not name.startswith("shifts/")
    for seats in (load_task(name).problem.seats or (load_task(name).seats,))
]


def plan_text(name: str, seats: int) -> str:
    folder = data_folder("problems")
    alone = folder / f"{name}.plan"
    return (alone if alone.exists() else folder / f"{name}@{seats}.plan").read_text()


@pytest.mark.parametrize(("name", "seats"), CASES)
def test_plans_reach_the_goal(name: str, seats: int) -> None:
    world = World(load_task(name, seats=seats))
    plan = read_plan(plan_text(name, seats), world)
    report = replay(plan, world)
    assert report.ok, str(report)
    assert report.final.goal_reached
    if name.startswith("multi_agent/") and seats == 2:
        assert all(plan.share(player) >= 3 for player in world.players)


def test_truncated_plan_is_not_ok() -> None:
    world = World("synchronous/01")
    plan = read_plan(plan_text("synchronous/01_cheese_sandwich", 1), world)
    cut = type(plan)(plan.steps[:-1])
    assert not replay(cut, world).ok
    assert replay(cut, world).reached_at is None
    swapped = type(plan)((plan.steps[1], plan.steps[0], *plan.steps[2:]))
    assert replay(swapped, world).rejection is not None


# The first ones take few expansions. The others take up to minutes in plain Python.
TEAMS = (
    *("01@2", "04@2", "05@2", "01@3", "02@2", "04@3", "02@3", "05@3", "03@2", "07@2"),
    *("09@2", "07@3", "08@3", "06@3", "01@4", "04@4", "06@4", "02@4", "05@4", "08@2"),
)


def team_certificate(name: str) -> tuple[Task, Certificate]:
    """Return a team's task and certificate, by the task's number and the seats."""
    found = dataset("multi_agent")
    instance = next(i for i in found.instances if name == f"{i.file[:2]}@{i.seats}")
    return found.task(instance), found.certificate(instance)


def test_ten_certificates_of_teams_are_valid() -> None:
    for name in TEAMS[:10]:
        task, found = team_certificate(name)
        assert found.optimal
        assert check(found, task) == []


@pytest.mark.parametrize("name", quick_sample(TEAMS, 4, nightly=14))
def test_bounds_of_teams_are_proven_again(name: str) -> None:
    task, found = team_certificate(name)
    assert prove_again(found, task, solve, found.limits.limits())
