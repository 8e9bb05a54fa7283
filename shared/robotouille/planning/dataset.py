"""Datasets: folders of problem files, a certificate beside each, and a manifest of them all.

report = certify_dataset(Path("problems"), solve, budget=Budget(expansions=100_000), jobs=4)
faults = check_dataset(Path("problems"))

What is written depends on the problems, the planner and the budget alone: not on the number of
processes, the machine or the time, unless the budget has seconds.
"""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Literal

from robotouille.domain.catalogue import load_task
from robotouille.domain.files import parse_json, read_json, validate
from robotouille.domain.schema import Schema
from robotouille.domain.task import Task
from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.planning.answer import Limits, Proof, Watch
from robotouille.planning.certificate import (
    Budget,
    Certificate,
    ContentHash,
    Count,
    Flag,
    Solver,
    certificate_path,
    certify,
    check,
    content_hash,
    json_text,
    prove_again,
    read_certificate,
    write_certificate,
    write_whole,
)
from robotouille.world.world import World

__all__ = [
    "BUDGET",
    "MANIFEST",
    "Dataset",
    "Instance",
    "Manifest",
    "Outcome",
    "Report",
    "Row",
    "Running",
    "Tell",
    "certify_dataset",
    "check_dataset",
    "read_dataset",
]

BUDGET = Budget(expansions=2_000_000, states=6_000_000)
"""What an instance may cost by default; the states bound the memory of a process."""

MANIFEST = "manifest.json"
SUFFIX = ".certificate.json"


@dataclass(frozen=True, slots=True, order=True)
class Instance:
    """A problem file with a number of seats; paths are relative to the dataset's folder."""

    file: str
    seats: int
    certificate: str

    def __str__(self) -> str:
        return self.certificate.removesuffix(SUFFIX)


@dataclass(frozen=True, slots=True)
class Dataset:
    """The instances in a folder, sorted, and what is wrong with files that are none."""

    folder: Path
    instances: tuple[Instance, ...]
    faults: tuple[str, ...]

    def task(self, instance: Instance) -> Task:
        """The task of an instance; FileError or UnknownTaskError."""
        return load_task(str(self.folder / instance.file), seats=instance.seats)

    def certificate(self, instance: Instance) -> Certificate:
        """What the certificate's file says, unchecked; FileError, also where it is missing."""
        path = self.folder / instance.certificate
        certificate = read_certificate(path)
        if path.read_bytes() != json_text(certificate).encode():
            raise FileError(str(path), [Fault("", "is not written as certificates are")])
        return certificate


def read_dataset(folder: Path) -> Dataset:
    """Find the problem files in a folder and its folders; FileError where there are none.

    Domains, renderings, inputs, certificates and manifests may lie between them.
    """
    if not folder.is_dir():
        raise FileError(str(folder), [Fault("", "is not a folder")])
    instances: list[Instance] = []
    faults: list[str] = []
    for path in sorted(folder.rglob("*.json")):
        try:
            instances += _instances(path, folder)
        except RobotouilleError as error:
            faults += str(error).splitlines()
    if not instances and not faults:
        raise FileError(str(folder), [Fault("", "there are no problem files in it")])
    return Dataset(folder, tuple(sorted(instances)), tuple(faults))


def _instances(path: Path, folder: Path) -> Iterator[Instance]:
    if path.name == MANIFEST or path.name.endswith(SUFFIX):
        return
    raw = read_json(path)
    keys = set(raw) if isinstance(raw, dict) else set()
    others = {"action_defs", "keyboard_actions", "mouse_click_actions"}
    if keys & others or ("floor" in keys and "goal" not in keys):
        return
    task = load_task(str(path))
    for seats in task.problem.seats or (task.seats,):
        name = certificate_path(path, load_task(str(path), seats=seats))
        relative = [p.relative_to(folder).as_posix() for p in (path, name)]
        yield Instance(relative[0], seats, relative[1])


# Manifest


class Row(Schema):
    """An instance in a manifest: its files with their hashes, and what is proven."""

    file: str
    seats: Count
    file_hash: ContentHash
    instance: ContentHash
    certificate: str
    certificate_hash: ContentHash
    length: Count | None
    bound: Count
    optimal: Flag
    proof: Proof


class Manifest(Schema):
    """All certified instances of a dataset, sorted by file and seats."""

    format: Literal["robotouille-dataset/1"]
    instances: tuple[Row, ...]


def _row(dataset: Dataset, instance: Instance, certificate: Certificate) -> Row:
    return Row(
        file=instance.file,
        seats=instance.seats,
        file_hash=content_hash((dataset.folder / instance.file).read_bytes()),
        instance=certificate.instance,
        certificate=instance.certificate,
        certificate_hash=content_hash(json_text(certificate).encode()),
        length=certificate.length,
        bound=certificate.bound,
        optimal=certificate.optimal,
        proof=certificate.proof,
    )


def _manifest(dataset: Dataset, certificates: dict[Instance, Certificate]) -> Manifest:
    rows = tuple(_row(dataset, i, certificates[i]) for i in sorted(certificates))
    return Manifest(format="robotouille-dataset/1", instances=rows)


# Certifying


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of an instance: a certificate (`kept`, if it lay there), or what failed."""

    instance: Instance
    certificate: Certificate | None
    fault: str = ""
    kept: bool = False


@dataclass(frozen=True, slots=True)
class Running:
    """An instance that is being solved: expansions, bound, and length of the best plan so far."""

    instance: Instance
    expansions: int
    bound: int
    length: int | None


Outcomes = Generator[Outcome, None, None]
Tell = Callable[[Sequence[Outcome], int, Sequence[Running]], None]
"""Called now and then: what is done, the number of instances, and what is being solved."""


@dataclass(frozen=True, slots=True)
class Report:
    """The outcomes of all instances, sorted, and everything that was wrong."""

    outcomes: tuple[Outcome, ...]
    faults: tuple[str, ...]

    @property
    def certificates(self) -> dict[Instance, Certificate]:
        return {o.instance: o.certificate for o in self.outcomes if o.certificate is not None}


def certify_dataset(
    folder: Path,
    solver: Solver,
    *,
    budget: Budget = BUDGET,
    jobs: int = 1,
    fresh: bool = False,
    tell: Tell | None = None,
) -> Report:
    """Certify every instance of a folder, then write its manifest.

    A valid certificate by the same planner under the same budget is kept, unless `fresh`. With
    `jobs` above 1 as many processes work, and `solver` has to be a function of a module. What
    fails is in the report; the rest is certified. Raises RobotouilleError where nothing can be
    written or a process dies. However it ends, finished certificates stay, and no process does.
    """
    dataset = read_dataset(folder)
    _require_writable(dataset)
    job = _Job(dataset, solver, budget, fresh)
    outcomes: list[Outcome] = []
    context = multiprocessing.get_context("spawn")
    cells = context.RawArray("q", 3 * len(dataset.instances))

    def pulse() -> None:
        if tell is not None:
            tell(outcomes, len(dataset.instances), _running(dataset, cells, outcomes))

    together = jobs > 1 and len(dataset.instances) > 1
    work = _together(job, cells, jobs, pulse) if together else _in_turn(job, cells, pulse)
    with closing(work):
        for outcome in work:
            if outcome.certificate is not None and not outcome.kept:
                path = folder / outcome.instance.certificate
                write_certificate(outcome.certificate, path)
            outcomes.append(outcome)
            pulse()
    report = _report(dataset, outcomes)
    write_whole(folder / MANIFEST, json_text(_manifest(dataset, report.certificates)))
    return report


def _require_writable(dataset: Dataset) -> None:
    for folder in sorted({(dataset.folder / i.certificate).parent for i in dataset.instances}):
        if not os.access(folder, os.W_OK):
            raise FileError(str(folder), [Fault("", "is a folder that cannot be written to")])


def _report(dataset: Dataset, outcomes: Sequence[Outcome], *faults: str) -> Report:
    ordered = tuple(sorted(outcomes, key=lambda outcome: outcome.instance))
    failed = tuple(outcome.fault for outcome in ordered if outcome.fault)
    return Report(ordered, (*dataset.faults, *failed, *faults))


@dataclass(frozen=True, slots=True)
class _Job:
    dataset: Dataset
    solver: Solver
    budget: Budget
    fresh: bool

    def settle(self, instance: Instance, watch: Watch) -> Outcome:
        watch(0, 0, None)
        try:
            task = self.dataset.task(instance)
            kept = None if self.fresh else self._kept(instance, task)
            found = kept or certify(
                task, self.solver, self.budget.for_seats(task.seats).limits(), watch
            )
        except (RobotouilleError, MemoryError) as error:
            reason = str(error) or "out of memory: fewer states may be kept"
            return Outcome(instance, None, f"{self.dataset.folder / instance.file}: {reason}")
        return Outcome(instance, found, kept=kept is not None)

    def _kept(self, instance: Instance, task: Task) -> Certificate | None:
        """The certificate that lies there, if this job would write the same."""
        try:
            found = self.dataset.certificate(instance)
        except FileError:
            return None
        same = found.instance == task.digest and self.budget.for_seats(task.seats).covered_by(
            found.limits
        )
        if not same or check(found, task):
            return None
        at_once = Limits(expansions=0, states=0, stop=lambda: True)
        return found if self.solver(World(task), limits=at_once).planner == found.planner else None


# Three cells for each instance tell of its search: expansions + 1 (0 if it has not begun), bound,
# and length of the best plan or -1.


def _noting(cells: Any, number: int, pulse: Callable[[], None] = lambda: None) -> Watch:
    def watch(expansions: int, bound: int, length: int | None) -> None:
        row = [expansions + 1, bound, -1 if length is None else length]
        cells[3 * number : 3 * number + 3] = row
        pulse()

    return watch


def _running(dataset: Dataset, cells: Any, outcomes: Sequence[Outcome]) -> list[Running]:
    over = {outcome.instance for outcome in outcomes}
    return [
        Running(instance, cells[i] - 1, cells[i + 1], cells[i + 2] if cells[i + 2] >= 0 else None)
        for i, instance in zip(range(0, len(cells), 3), dataset.instances, strict=True)
        if cells[i] and instance not in over
    ]


def _in_turn(job: _Job, cells: Any, pulse: Callable[[], None]) -> Outcomes:
    for number, instance in enumerate(job.dataset.instances):
        yield job.settle(instance, _noting(cells, number, pulse))


def _together(job: _Job, cells: Any, jobs: int, pulse: Callable[[], None]) -> Outcomes:
    """Outcomes as other processes come to them.

    Each holds one end of a pipe and ends when the other is closed: by an interrupt, an error, or
    the death of this process.
    """
    context = multiprocessing.get_context("spawn")
    theirs, ours = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(
        jobs, mp_context=context, initializer=_enlist, initargs=(theirs, job, cells)
    )
    try:
        waiting = {pool.submit(_work, number) for number in range(len(job.dataset.instances))}
        while waiting:
            done, waiting = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
            pulse()
            for future in done:
                yield future.result()
        pool.shutdown()
    except BrokenProcessPool:
        raise RobotouilleError(
            "a process died, perhaps for want of memory: let fewer work at once, or keep fewer "
            "states; the certificates written so far are kept"
        ) from None
    finally:
        ours.close()
        pool.shutdown(cancel_futures=True)
        theirs.close()


_enlisted: list[tuple[_Job, Any]] = []


def _enlist(lifeline: Connection, job: _Job, cells: Any) -> None:
    def end() -> None:
        lifeline.poll(None)
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=end, daemon=True).start()
    _enlisted.append((job, cells))


def _work(number: int) -> Outcome:
    job, cells = _enlisted[-1]
    return job.settle(job.dataset.instances[number], _noting(cells, number))


# Checking


def check_dataset(
    folder: Path,
    solver: Solver,
    *,
    sample: int = 0,
    seed: int = 0,
    seconds: float | None = None,
    tell: Tell | None = None,
) -> Report:
    """Check every certificate of a folder and its manifest: hashes, plans, claims.

    As many bounds as `sample` says, chosen by `seed`, are proven again under the budgets of their
    certificates, in at most so many seconds each. Raises FileError where there is nothing to check.
    """
    dataset = read_dataset(folder)
    outcomes: list[Outcome] = []
    for instance in dataset.instances:
        outcomes.append(_checked(dataset, instance))
        if tell is not None:
            tell(outcomes, len(dataset.instances), ())
    valid = _report(dataset, outcomes).certificates
    faults = [*_stray_faults(dataset), *_manifest_faults(dataset, valid)]
    for instance in random.Random(seed).sample(sorted(valid), min(sample, len(valid))):
        found = valid[instance]
        limits = found.limits.model_copy(update={"seconds": seconds}).limits()
        if not prove_again(found, dataset.task(instance), solver, limits):
            faults.append(f"{folder / instance.certificate}: the bound is not proven again")
    return _report(dataset, outcomes, *faults)


def _checked(dataset: Dataset, instance: Instance) -> Outcome:
    path = dataset.folder / instance.certificate
    try:
        certificate = dataset.certificate(instance)
        problems = check(certificate, dataset.task(instance))
    except RobotouilleError as error:
        return Outcome(instance, None, str(error))
    if problems:
        return Outcome(instance, None, "\n".join(f"{path}: {problem}" for problem in problems))
    return Outcome(instance, certificate, kept=True)


def _stray_faults(dataset: Dataset) -> list[str]:
    known = {dataset.folder / instance.certificate for instance in dataset.instances}
    found = set(dataset.folder.rglob(f"*{SUFFIX}"))
    return [f"{path}: belongs to no problem file" for path in sorted(found - known)]


def _manifest_faults(dataset: Dataset, valid: dict[Instance, Certificate]) -> list[str]:
    path = dataset.folder / MANIFEST
    try:
        text = path.read_text(encoding="utf-8")
        manifest = validate(parse_json(text, str(path)), Manifest, str(path))
    except (OSError, UnicodeDecodeError) as error:
        return [f"{path}: cannot be read: {error}"]
    except FileError as error:
        return [str(error)]
    found = {row.certificate: row for row in manifest.instances}
    listed = {instance.certificate for instance in dataset.instances}
    faults = [
        f"{path}: {name}: there is no such instance" for name in sorted(found.keys() - listed)
    ]
    for row in _manifest(dataset, valid).instances:
        faults += _differences(row, found.get(row.certificate), str(path))
    whole = len(valid) == len(dataset.instances)
    if whole and not faults and text != json_text(_manifest(dataset, valid)):
        faults.append(f"{path}: is not written as manifests are")
    return faults


def _differences(row: Row, found: Row | None, path: str) -> list[str]:
    if found is None:
        return [f"{path}: {row.certificate}: is missing"]
    return [
        f"{path}: {row.certificate}: {name}: expected {value}, found {getattr(found, name)}"
        for name, value in row
        if getattr(found, name) != value
    ]
