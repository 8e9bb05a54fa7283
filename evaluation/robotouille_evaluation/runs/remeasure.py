"""Optimality and steps to go of played episodes, added later from their recordings.

Optima are those that the pack knows by now. `pack prove` changes the pack's digest but no instance,
so a row and an instance belong together if the recorded task is that of the instance.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from robotouille.errors import RobotouilleError
from robotouille.processes import spawn_context
from robotouille.replay.recording import read_recording
from robotouille_evaluation.metrics.measuring import measure
from robotouille_evaluation.metrics.rows import Optimum, ResultRow
from robotouille_evaluation.metrics.trajectory import Trajectory
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs.execute import distance_in, known_optimum, world_of
from robotouille_evaluation.runs.folder import DEAD_PROCESS

STEPS_TO_GO = ("to_go_least", "to_go_most", "out_of_reach")
"""Measures that are added."""


def lacks_measures(row: ResultRow, pack: Pack) -> bool:
    """Return whether the pack or the recording of a row can add to its measures.

    Raises:
        UnknownNameError: The pack has no such instance.
    """
    if row.is_shift or row.recording is None:
        return False
    measured = row.measures.to_go_least is not None or row.measures.out_of_reach
    return _optimum(row, pack) != row.optimum or not measured


def _optimum(row: ResultRow, pack: Pack) -> Optimum:
    """Return the optimum that the pack knows, unless the row's own is proven or it knows none."""
    known = known_optimum(pack.instance(row.instance), row.seats)
    return row.optimum if row.optimum.proven or known.steps is None else known


def remeasured(row: ResultRow, pack: Pack, run: Path) -> ResultRow:
    """Return the row with the optimum of the pack and the steps to go of its recording.

    Raises:
        RobotouilleError: The recording is missing, cannot be read, or is of another task than the
            instance.
    """
    if row.recording is None:
        raise RobotouilleError(f"{row.instance}: the episode has no recording")
    recording = read_recording(run / row.recording)
    world = world_of(pack, row.instance, row.seats)
    if recording.task.digest != world.task.digest:
        raise RobotouilleError(
            f"{recording.source}: the recorded task is not {row.instance} of the pack {pack.name}; "
            "choose the pack of the run with --pack"
        )
    recording.world = world
    optimum = _optimum(row, pack)
    found = measure(
        Trajectory.recorded(recording),
        row.budget.steps,
        distance=distance_in(pack, pack.instance(row.instance), world),
        fewest=optimum.steps if optimum.proven else None,
    )
    added = {name: getattr(found, name) for name in STEPS_TO_GO}
    measures = row.measures.model_copy(update=added)
    return row.model_copy(update={"optimum": optimum, "measures": measures})


@dataclass(frozen=True, slots=True)
class Remeasured:
    """A row with added measures, or the reason for the failure."""

    row: ResultRow | None
    fault: str = ""


def remeasure(
    rows: Iterable[ResultRow], pack: Pack, run: Path, processes: int
) -> Iterator[Remeasured]:
    """Measure rows, and yield each result when it is there. One process is this one."""
    if processes == 1:
        yield from (_result(row, pack, run) for row in rows)
        return
    with _workers(processes, pack, run) as pool:
        with _interrupts_blocked():
            futures = [pool.submit(_result_elsewhere, row) for row in rows]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BrokenProcessPool:
            raise RobotouilleError(DEAD_PROCESS) from None


def _result(row: ResultRow, pack: Pack, run: Path) -> Remeasured:
    try:
        return Remeasured(remeasured(row, pack, run))
    except RobotouilleError as error:
        return Remeasured(None, str(error))


@contextmanager
def _workers(processes: int, pack: Pack, run: Path) -> Iterator[ProcessPoolExecutor]:
    with ProcessPoolExecutor(processes, spawn_context(), _begin, (pack, run)) as pool:
        try:
            yield pool
        except BaseException:
            # Rows that have not begun are dropped; running ones end by themselves.
            pool.shutdown(wait=False, cancel_futures=True)
            raise


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Start processes that leave Ctrl+C to their parent, also while they import modules.

    The parent receives it at the end of the block.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_shared: list[tuple[Pack, Path]] = []
"""Pack and run of a worker process, which receives them once and not with each row."""


def _begin(pack: Pack, run: Path) -> None:
    _shared.append((pack, run))


def _result_elsewhere(row: ResultRow) -> Remeasured:
    return _result(row, *_shared[0])
