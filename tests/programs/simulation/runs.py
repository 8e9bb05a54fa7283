"""Many seeds in several processes, with progress, failures and commands that reproduce them."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from itertools import count

from tests.programs.simulation.simulation import Report, run_seed

__all__ = ["Progress", "run_block", "run_many"]

BLOCK = 20
BLOCKS_A_PROCESS = 25
SHOWN_FAULTS = 6


def run_block(first: int, last: int) -> list[Report]:
    """Run a range of seeds and return their reports."""
    return [run_seed(seed) for seed in range(first, last)]


def run_many(
    first: int,
    end: int | None,
    jobs: int,
    seconds: float | None,
    *,
    work: Callable[[int, int], list[Report]] | None = None,
    program: str = "tests.programs.simulation",
) -> Progress:
    """Run seeds from `first` to before `end`, or for `seconds` of real time.

    Args:
        work: Runs a range of seeds; `run_block` by default.
        program: The module with which a failure is reproduced.
    """
    deadline = None if seconds is None else time.monotonic() + seconds
    progress = Progress(program)
    with ProcessPoolExecutor(jobs, max_tasks_per_child=BLOCKS_A_PROCESS) as pool:
        running: set[Future[list[Report]]] = set()
        for block in _blocks(first, end):
            running.add(pool.submit(work or run_block, *block))
            if len(running) >= 2 * jobs:
                done, running = wait(running, return_when=FIRST_COMPLETED)
                progress.take(done)
            if deadline is not None and time.monotonic() > deadline:
                break
        progress.take(wait(running).done)
    return progress


def _blocks(first: int, end: int | None) -> Iterator[tuple[int, int]]:
    for start in count(first, BLOCK):
        if end is not None and start >= end:
            return
        yield start, start + BLOCK if end is None else min(end, start + BLOCK)


class Progress:
    """Summary of the runs so far."""

    def __init__(self, program: str) -> None:
        self.program = program
        self.seeds = 0
        self.failed: list[int] = []
        self.counts: Counter[str] = Counter()
        self._began = time.monotonic()
        self._shown = 0

    def take(self, done: set[Future[list[Report]]]) -> None:
        for future in done:
            for report in future.result():
                self._count(report)
        if self.seeds >= self._shown + 200:
            self._shown = self.seeds
            print(f"{self.seeds} seeds, {len(self.failed)} failed, {self._pace()}", flush=True)

    def _count(self, report: Report) -> None:
        self.seeds += 1
        self.counts.update(report.counts)
        if report.ok:
            return
        self.failed.append(report.seed)
        again = f"python -m {self.program} --seed {report.seed} --trace"
        print(f"seed {report.seed} FAILED: {again}")
        for fault in report.faults[:SHOWN_FAULTS]:
            print(f"    {fault}", flush=True)

    def _pace(self) -> str:
        seconds = time.monotonic() - self._began
        return f"{seconds:.0f} s, {self.seeds / max(seconds, 0.001):.1f} seeds a second"

    def finish(self) -> int:
        checked = ", ".join(f"{times:,} {what}" for what, times in sorted(self.counts.items()))
        print(f"{self.seeds} seeds, {len(self.failed)} failed, {self._pace()}")
        print(f"checked and broken: {checked}")
        if self.failed:
            print(f"failed: {' '.join(map(str, sorted(self.failed)))}")
        return 1 if self.failed else 0
