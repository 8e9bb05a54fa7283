"""Certification of a data set in several processes, resuming interrupted runs.

    budget = ExpansionBudget(expansions=100_000)
    report = certify_dataset(Path("problems"), solve, budget=budget, jobs=4)

The written files depend only on the problems, the planner and the budget, not on the number of
processes, the machine or the time, unless the budget has seconds.
"""

from __future__ import annotations

import os
import random
import signal
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from robotouille.certification.certificate import (
    Certificate,
    ExpansionBudget,
    Solver,
    certify,
    check,
    json_text,
    prove_again,
    write_certificate,
    write_whole,
)
from robotouille.certification.dataset import (
    MANIFEST,
    SUFFIX,
    CertifyingOutcome,
    Dataset,
    DatasetEntry,
    DatasetReport,
    DatasetRow,
    Manifest,
    Running,
    Tell,
    manifest_of,
    read_dataset,
    report_of,
)
from robotouille.certification.step_limit import plan_beside
from robotouille.domain.json_files import parse_json, validate
from robotouille.domain.task import Task
from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.files.reading import read_text
from robotouille.planning.plan import Limits, Watch
from robotouille.processes import spawn_context
from robotouille.world.world import World

BUDGET = ExpansionBudget(expansions=2_000_000, states=6_000_000)
"""Default budget of one instance. The number of states limits a process's memory."""

MAX_MANIFEST_BYTES = 64 << 20

Outcomes = Generator[CertifyingOutcome, None, None]


def certify_dataset(
    folder: Path,
    solver: Solver,
    *,
    budget: ExpansionBudget = BUDGET,
    jobs: int = 1,
    ignore_existing: bool = False,
    tell: Tell | None = None,
) -> DatasetReport:
    """Certify every instance of a folder, then write its manifest.

    The report contains failures; other instances are certified. Finished certificates are kept even
    if the run is interrupted.

    Args:
        solver: A planner; a module-level function if `jobs` is above 1.
        budget: Budget of one instance for one player (see `for_seats`).
        jobs: Number of processes.
        ignore_existing: Certify every instance again. Otherwise valid certificates of the same
            planner and budget are kept.
        tell: Callback for progress.

    Raises:
        FileError: The folder has no problem files or is not writable.
        RobotouilleError: A process died.
    """
    dataset = read_dataset(folder)
    _require_writable(dataset)
    job = _Job(dataset, solver, budget, ignore_existing)
    outcomes: list[CertifyingOutcome] = []
    context = spawn_context()
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
    report = report_of(dataset, outcomes)
    write_whole(folder / MANIFEST, json_text(manifest_of(dataset, report.certificates)))
    return report


def _require_writable(dataset: Dataset) -> None:
    for folder in sorted({(dataset.folder / i.certificate).parent for i in dataset.instances}):
        if not os.access(folder, os.W_OK):
            raise FileError(str(folder), [Fault("", "is not writable")])


@dataclass(frozen=True, slots=True)
class _Job:
    dataset: Dataset
    solver: Solver
    budget: ExpansionBudget
    ignore_existing: bool

    def settle(self, instance: DatasetEntry, watch: Watch) -> CertifyingOutcome:
        watch(0, 0, None)
        try:
            task = self.dataset.task(instance)
            kept = None if self.ignore_existing else self._kept(instance, task)
            found = kept or self._certify(task, watch)
        except (RobotouilleError, MemoryError) as error:
            reason = str(error) or "out of memory: reduce the number of states"
            return CertifyingOutcome(
                instance, None, f"{self.dataset.folder / instance.file}: {reason}"
            )
        return CertifyingOutcome(instance, found, kept=kept is not None)

    def _certify(self, task: Task, watch: Watch) -> Certificate:
        limits = self.budget.for_seats(task.seats).limits()
        return certify(task, self.solver, limits, watch, known=plan_beside(World(task)))

    def _kept(self, instance: DatasetEntry, task: Task) -> Certificate | None:
        """Return the existing certificate if this job would write the same."""
        try:
            found = self.dataset.certificate(instance)
        except FileError:
            return None
        same = found.instance == task.digest and self.budget.for_seats(task.seats).covered_by(
            found.limits
        )
        if not same or check(found, task):
            return None
        known = plan_beside(World(task))
        if known is not None and (found.length is None or len(known) < found.length):
            return None
        # A search without expansions only reports the planner's name and version.
        at_once = Limits(expansions=0, states=0, stop=lambda: True)
        return found if self.solver(World(task), limits=at_once).planner == found.planner else None


# Shared memory has three cells for each instance: expansions + 1 (0 before the search), bound, and
# length of the best plan or -1.


def _noting(cells: Any, number: int, pulse: Callable[[], None] = lambda: None) -> Watch:
    def watch(expansions: int, bound: int, length: int | None) -> None:
        row = [expansions + 1, bound, -1 if length is None else length]
        cells[3 * number : 3 * number + 3] = row
        pulse()

    return watch


def _running(dataset: Dataset, cells: Any, outcomes: Sequence[CertifyingOutcome]) -> list[Running]:
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
    """Yield outcomes of several processes in the order of completion."""
    context = spawn_context()
    # Each process holds one end of a pipe and exits when the other end is closed, by an interrupt,
    # an error or the death of this process.
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
            "a process died, perhaps for lack of memory: reduce the processes or the states; "
            "the certificates written so far are kept"
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


def _work(number: int) -> CertifyingOutcome:
    job, cells = _enlisted[-1]
    return job.settle(job.dataset.instances[number], _noting(cells, number))


def check_dataset(
    folder: Path,
    solver: Solver,
    *,
    sample: int = 0,
    seed: int = 0,
    budget: ExpansionBudget = BUDGET,
    tell: Tell | None = None,
) -> DatasetReport:
    """Check every certificate of a folder and its manifest: hashes, plans and claims.

    The report contains the faults.

    Args:
        solver: Planner that proves bounds again.
        sample: Number of bounds, chosen by `seed`, to prove again with their certificates' budgets.
        budget: Largest budget of each of these proofs. A certificate with a larger one is a fault.
        tell: Callback for progress.

    Raises:
        FileError: There is nothing to check.
        RobotouilleError: The solver fails, or its result is wrong.
    """
    dataset = read_dataset(folder)
    outcomes: list[CertifyingOutcome] = []
    for instance in dataset.instances:
        outcomes.append(_checked(dataset, instance))
        if tell is not None:
            tell(outcomes, len(dataset.instances), ())
    valid = report_of(dataset, outcomes).certificates
    faults = [*_stray_faults(dataset), *_manifest_faults(dataset, valid)]
    for instance in random.Random(seed).sample(sorted(valid), min(sample, len(valid))):
        found = valid[instance]
        path = folder / instance.certificate
        if excess := _excess(found.limits, budget):
            faults.append(f"{path}: {excess}")
            continue
        limits = found.limits.model_copy(update={"seconds": budget.seconds}).limits()
        if not prove_again(found, dataset.task(instance), solver, limits):
            faults.append(f"{path}: the bound could not be proven again")
    return report_of(dataset, outcomes, *faults)


def _excess(spent: ExpansionBudget, allowed: ExpansionBudget) -> str:
    """Return why a budget is too large to be spent again, or an empty string."""
    for name in ("expansions", "states"):
        most, found = getattr(allowed, name), getattr(spent, name)
        if most is not None and (found is None or found > most):
            number = "unlimited" if found is None else f"{found:,}"
            return f"limits.{name}: is {number}, expected at most {most:,}; not proven again"
    return ""


def _checked(dataset: Dataset, instance: DatasetEntry) -> CertifyingOutcome:
    path = dataset.folder / instance.certificate
    try:
        certificate = dataset.certificate(instance)
        problems = check(certificate, dataset.task(instance))
    except RobotouilleError as error:
        return CertifyingOutcome(instance, None, str(error))
    if problems:
        return CertifyingOutcome(
            instance, None, "\n".join(f"{path}: {problem}" for problem in problems)
        )
    return CertifyingOutcome(instance, certificate, kept=True)


def _stray_faults(dataset: Dataset) -> list[str]:
    known = {dataset.folder / instance.certificate for instance in dataset.instances}
    found = set(dataset.folder.rglob(f"*{SUFFIX}"))
    return [f"{path}: belongs to no problem file" for path in sorted(found - known)]


def _manifest_faults(dataset: Dataset, valid: dict[DatasetEntry, Certificate]) -> list[str]:
    path = dataset.folder / MANIFEST
    try:
        text = read_text(path, most=MAX_MANIFEST_BYTES)
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
    for row in manifest_of(dataset, valid).instances:
        faults += _differences(row, found.get(row.certificate), str(path))
    whole = len(valid) == len(dataset.instances)
    if whole and not faults and text != json_text(manifest_of(dataset, valid)):
        faults.append(f"{path}: is not written as manifests are")
    return faults


def _differences(row: DatasetRow, found: DatasetRow | None, path: str) -> list[str]:
    if found is None:
        return [f"{path}: {row.certificate}: is missing"]
    return [
        f"{path}: {row.certificate}: {name}: expected {value}, found {getattr(found, name)}"
        for name, value in row
        if getattr(found, name) != value
    ]
