"""Certify a dataset, in several processes, taking up where an earlier run was interrupted.

budget = ExpansionBudget(expansions=100_000)
report = certify_dataset(Path("problems"), solve, budget=budget, jobs=4)

What is written depends on the problems, the planner and the budget alone: not on the number of
processes, the machine or the time, unless the budget has seconds.
"""

from __future__ import annotations

import os
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
    write_certificate,
    write_whole,
)
from robotouille.certification.dataset import (
    MANIFEST,
    CertifyingOutcome,
    Dataset,
    DatasetEntry,
    DatasetReport,
    Running,
    Tell,
    manifest_of,
    read_dataset,
    report_of,
)
from robotouille.certification.shipped_plan import plan_beside
from robotouille.certification.spawning import spawn_context
from robotouille.domain.task import Task
from robotouille.errors import Fault, FileError, RobotouilleError
from robotouille.planning.search_result import Limits, Watch
from robotouille.world.world import World

__all__ = ["BUDGET", "certify_dataset"]

BUDGET = ExpansionBudget(expansions=2_000_000, states=6_000_000)
"""What an instance may cost by default; the states bound the memory of a process."""

Outcomes = Generator[CertifyingOutcome, None, None]


def certify_dataset(
    folder: Path,
    solver: Solver,
    *,
    budget: ExpansionBudget = BUDGET,
    jobs: int = 1,
    fresh: bool = False,
    tell: Tell | None = None,
) -> DatasetReport:
    """Certify every instance of a folder, then write its manifest.

    What fails is in the report; the rest is certified. However it ends, finished certificates
    stay, and no process does.

    Args:
        solver: Has to be a function of a module if `jobs` is above 1.
        budget: What the search of one instance may spend, for one player (see `for_seats`).
        jobs: How many processes work.
        fresh: Begin anew. Else a valid certificate by the same planner under the same budget is
            kept.
        tell: Is called now and then with what is done, and what is being solved.

    Raises:
        FileError: There is no problem file in the folder, or it cannot be written to.
        RobotouilleError: A process died.
    """
    dataset = read_dataset(folder)
    _require_writable(dataset)
    job = _Job(dataset, solver, budget, fresh)
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
            raise FileError(str(folder), [Fault("", "is a folder that cannot be written to")])


@dataclass(frozen=True, slots=True)
class _Job:
    dataset: Dataset
    solver: Solver
    budget: ExpansionBudget
    fresh: bool

    def settle(self, instance: DatasetEntry, watch: Watch) -> CertifyingOutcome:
        watch(0, 0, None)
        try:
            task = self.dataset.task(instance)
            kept = None if self.fresh else self._kept(instance, task)
            found = kept or self._certify(task, watch)
        except (RobotouilleError, MemoryError) as error:
            reason = str(error) or "out of memory: fewer states may be kept"
            return CertifyingOutcome(
                instance, None, f"{self.dataset.folder / instance.file}: {reason}"
            )
        return CertifyingOutcome(instance, found, kept=kept is not None)

    def _certify(self, task: Task, watch: Watch) -> Certificate:
        limits = self.budget.for_seats(task.seats).limits()
        return certify(task, self.solver, limits, watch, known=plan_beside(World(task)))

    def _kept(self, instance: DatasetEntry, task: Task) -> Certificate | None:
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
        known = plan_beside(World(task))
        if known is not None and (found.length is None or len(known) < found.length):
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
    """Outcomes as other processes come to them.

    Each holds one end of a pipe and ends when the other is closed: by an interrupt, an error, or
    the death of this process.
    """
    context = spawn_context()
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


def _work(number: int) -> CertifyingOutcome:
    job, cells = _enlisted[-1]
    return job.settle(job.dataset.instances[number], _noting(cells, number))
