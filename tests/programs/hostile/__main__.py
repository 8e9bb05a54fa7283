"""Send a million hostile messages and files: `python -m tests.programs.hostile --count 1000000`.

The program starts a real server, attacks it over real sockets from several processes, and feeds the
decoders and file readers. The exit status is 0 if nothing crashed or hung, every reply had a
documented code, and the server's memory stayed flat.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import queue
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
from tests.programs.hostile.assault import HANG, Report, Share, assault
from tests.programs.hostile.siege import ask_honestly
from tests.support.server_process import ServerProcess, server_process

__all__ = ["Verdict", "judge", "main", "run"]

SERVER_FLAGS = (
    "--messages-per-second", "1000000", "--max-episodes", "50", "--grace", "2",
    "--hello-seconds", "3", "--task", "synchronous/01", "--log-level", "error",
)  # fmt: skip
WARM_UP = 0.3
"""Share of the run after which memory must be flat."""
MAX_GROWTH = 16 * 1024 * 1024
MARKS = 10


@dataclass(slots=True)
class Verdict:
    """The result of a run, which passes if there are no faults."""

    done: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    memory: list[tuple[float, int]] = field(default_factory=list)

    def take(self, report: Report) -> None:
        self.done += report.done
        self.outcomes.update(report.outcomes)
        self.faults.update(report.faults)

    @property
    def growth(self) -> int:
        """Return the growth of the server's memory since the warm-up, in bytes."""
        warm = [size for part, size in self.memory if part >= WARM_UP]
        return warm[-1] - warm[0] if warm else 0


def run(count: int, jobs: int, seed: int, keep: Path | None = None) -> Verdict:
    """Send `count` messages and files; store inputs that cause faults in `keep`."""
    with tempfile.TemporaryDirectory(prefix="robotouille-hostile-") as folder:
        with server_process(Path(folder), *SERVER_FLAGS) as server:
            verdict = _attack(server, count, jobs, seed, keep)
            judge(verdict, server.log)
    return verdict


def _attack(server: ServerProcess, count: int, jobs: int, seed: int, keep: Path | None) -> Verdict:
    context = multiprocessing.get_context("spawn")
    reports = context.Queue()
    verdict = Verdict(memory=[(0.0, _memory(server))])
    workers = []
    for i in range(jobs):
        share = Share(i, count // jobs + (i < count % jobs), seed, server.port)
        workers.append(context.Process(target=assault, args=(share, reports), daemon=True))
    for worker in workers:
        worker.start()
    began, left = time.monotonic(), jobs
    while left > 0:
        report = _next(reports, workers)
        if report is None:
            verdict.faults["an attacking process hung or died; see its traceback above"] += 1
            break
        verdict.take(report)
        left -= report.last
        _keep(report, keep)
        if verdict.done >= len(verdict.memory) * count / MARKS:
            _mark(server, verdict, count, began)
        if server.process.poll() is not None:
            verdict.faults["the server process ended"] += 1
            break
    for worker in workers:
        worker.terminate()
    return verdict


def _next(reports: Any, workers: list[Any]) -> Report | None:
    """Return the next report, or None if a process failed to send one."""
    try:
        report: Report = reports.get(timeout=HANG + 60)
    except queue.Empty:
        for worker in workers:
            worker.kill()
        return None
    return report


def _mark(server: ServerProcess, verdict: Verdict, count: int, began: float) -> None:
    part, seconds = verdict.done / count, time.monotonic() - began
    verdict.memory.append((part, _memory(server)))
    if asyncio.run(ask_honestly(server.port)) != "episodes":
        verdict.faults["an honest client received no reply"] += 1
    print(
        f"{part:4.0%}  {verdict.done:>9,}  {verdict.done / seconds:6,.0f}/s  "
        f"server {verdict.memory[-1][1] / 2**20:6.1f} MiB  {sum(verdict.faults.values())} faults",
        flush=True,
    )


def _memory(server: ServerProcess) -> int:
    try:
        size: int = psutil.Process(server.process.pid).memory_info().rss
    except psutil.NoSuchProcess:
        return 0
    return size


def _keep(report: Report, folder: Path | None) -> None:
    if folder is None or not report.kept:
        return
    folder.mkdir(parents=True, exist_ok=True)
    for data in report.kept[:5]:
        path = folder / f"{report.worker}-{len(list(folder.iterdir()))}"
        path.write_bytes(data)


def judge(verdict: Verdict, server_log: Path) -> None:
    """Add the faults that only show at the end: growing memory and errors in the log."""
    if verdict.growth > MAX_GROWTH:
        verdict.faults[f"the server's memory grew by {verdict.growth / 2**20:.1f} MiB"] += 1
    log = server_log.read_text(encoding="utf-8", errors="replace")
    if "Traceback" in log or "failed" in log:
        verdict.faults["the server's log has an error: " + log[-2000:]] += 1


def main() -> int:
    """Run the command; return 1 if there are faults."""
    parser = argparse.ArgumentParser(prog="python -m tests.programs.hostile", description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000, help="hostile messages and files")
    parser.add_argument("--jobs", type=int, default=2, help="attacking processes")
    parser.add_argument("--seed", type=int, default=0, help="seed of the attack")
    parser.add_argument("--keep", type=Path, help="folder for inputs that cause faults")
    given = parser.parse_args()
    verdict = run(given.count, given.jobs, given.seed, given.keep)
    print(f"\n{verdict.done:,} hostile messages and files; results:")
    for word, number in sorted(verdict.outcomes.items()):
        print(f"  {number:>9,}  {word}")
    memory = ", ".join(f"{size / 2**20:.1f}" for _, size in verdict.memory)
    print(f"memory of the server, MiB: {memory}")
    print(f"grown since the first {WARM_UP:.0%}: {verdict.growth / 2**20:+.1f} MiB")
    for fault, number in verdict.faults.most_common():
        print(f"FAULT ({number} times) {fault}")
    print("failed" if verdict.faults else "passed")
    return 1 if verdict.faults else 0


if __name__ == "__main__":
    sys.exit(main())
