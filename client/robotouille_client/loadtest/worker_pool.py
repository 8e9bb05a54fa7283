"""The load tester's processes and their combined reports."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import sys
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from robotouille.errors import RobotouilleError
from robotouille_client.loadtest.histogram import Measurements
from robotouille_client.loadtest.workload import LoadPlan

_NUMBER = re.compile("[0-9]{1,18}")


def parse_cores(text: str | None) -> tuple[int, ...]:
    """Return the core numbers of a text like `1,3` or `2-5`.

    Raises:
        RobotouilleError: The text is invalid, or there is no such core.
    """
    cores: list[int] = []
    present = os.cpu_count() or 1
    for part in (text or "").split(","):
        first, _, last = part.strip().partition("-")
        if not part.strip():
            continue
        bounds = _NUMBER.fullmatch(first), _NUMBER.fullmatch(last or first)
        if None in bounds or int(last or first) < int(first):
            raise RobotouilleError(
                f"--cpus: {part[:40]!r} is not a core; expected cores like 1,3 or 2-5"
            )
        wanted = range(int(first), int(last or first) + 1)
        if wanted.stop > present:
            unknown = max(wanted.start, present)
            raise RobotouilleError(f"--cpus: no core {unknown}; the cores are 0 to {present - 1}")
        cores += wanted
    return tuple(sorted(set(cores)))


def keep_to_cores(cores: tuple[int, ...]) -> None:
    """Restrict this process and its children to these cores, if any are given."""
    if not cores:
        return
    if not hasattr(os, "sched_setaffinity"):
        raise RobotouilleError("--cpus: this system does not support choosing cores")
    try:
        os.sched_setaffinity(0, cores)
    except OSError as error:
        raise RobotouilleError(f"--cpus: {error.strerror}") from None


RESERVE = 64
"""Number of open files that a process needs in addition to its connections."""


class TooFewFilesError(RobotouilleError):
    """The system's limit of open files is too low."""


def allow_open_files(connections: int) -> None:
    """Raise this process's limit of open files to hold that many connections.

    Child processes inherit the limit.

    Raises:
        TooFewFilesError: The system does not allow it.
    """
    try:
        import resource
    except ImportError:
        return
    needed = connections + RESERVE
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        message = (
            f"{connections:,} connections in one process need {needed:,} open files, but at most "
            f"{hard:,} are allowed. Use more --processes, or raise the hard limit (ulimit -Hn)"
        )
        raise TooFewFilesError(message)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))
    except (OSError, ValueError) as error:
        raise TooFewFilesError(
            f"cannot raise the limit of open files from {soft:,}: {error}"
        ) from None


COMMAND = (sys.executable, "-P", "-m", "robotouille_client.loadtest.load_worker")
"""Command of a worker. With -P, no file of the current folder can replace a library."""
STOP_SECONDS = 10.0


class WorkerLostError(RobotouilleError):
    """A process of the load tester ended unexpectedly."""


@dataclass
class Second:
    """Measurements of all processes in one second."""

    at: float
    measured: bool
    all: Measurements = field(default_factory=Measurements)
    seconds: float = 0.0
    connected: int = 0
    playing: int = 0
    busiest: float = 0.0
    """Share of a core that the busiest process used."""
    cpu: float = 0.0
    """Seconds of processor time that all processes used."""


class WorkerPool:
    """Worker processes that get the same commands. `totals` has the results so far."""

    def __init__(self, plan: LoadPlan, token: str | None, cpus: tuple[int, ...] = ()) -> None:
        self.totals = Measurements()
        self.ramp = Measurements()
        self.seconds: dict[int, Second] = {}
        self.connected = [0] * plan.processes
        self.playing = [0] * plan.processes
        self.storm_cut = 0
        self._plan = plan
        self._token = token
        self._cpus = cpus
        self._workers: list[asyncio.subprocess.Process] = []
        self._readers: list[asyncio.Task[None]] = []
        self._done: Counter[str] = Counter()
        self._news = asyncio.Condition()
        self._stopping = False

    async def start(self) -> None:
        environment = {**os.environ}
        if self._token is not None:
            environment["ROBOTOUILLE_TOKEN"] = self._token
        for share in self._plan.shares():
            worker = await asyncio.create_subprocess_exec(
                *_command(self._cpus),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                env=environment,
                limit=2**24,
                start_new_session=True,
            )
            self._workers.append(worker)
            self._readers.append(asyncio.create_task(self._read(worker)))
            _write(worker, share.model_dump_json())

    async def do(self, command: str) -> None:
        """Send a command and wait until all processes have executed it."""
        for worker in self._workers:
            _write(worker, command)
        async with self._news:
            await self._news.wait_for(lambda: self._ready(command))
        self._done[command] = 0
        self._check_alive()

    def _ready(self, command: str) -> bool:
        return self._done[command] >= len(self._workers) or self._ended

    @property
    def _ended(self) -> bool:
        return any(reader.done() for reader in self._readers)

    def _check_alive(self) -> None:
        if self._ended and not self._stopping:
            codes = [w.returncode for w in self._workers if w.returncode is not None]
            raise WorkerLostError(f"a process of the load tester ended with status {codes or '?'}")

    async def news(self, seconds: float) -> None:
        """Wait for a report, but at most `seconds`.

        Raises:
            WorkerLostError: A process has ended.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds), self._news:
                await self._news.wait()
        self._check_alive()

    async def stop(self) -> None:
        """Collect the last reports and end all processes."""
        self._stopping = True
        for worker in self._workers:
            if worker.returncode is None:
                _write(worker, "stop")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(STOP_SECONDS):
                await asyncio.gather(*self._readers, return_exceptions=True)
        for worker in self._workers:
            if worker.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    worker.kill()
            await worker.wait()
        for reader in self._readers:
            reader.cancel()

    # Reports

    async def _read(self, worker: asyncio.subprocess.Process) -> None:
        if worker.stdout is None:
            return
        while line := await worker.stdout.readline():
            report = json.loads(line)
            if report["kind"] == "interval":
                self._take(report)
            else:
                self._done[report["command"]] += 1
                self.storm_cut += report["cut"]
            async with self._news:
                self._news.notify_all()
        await worker.wait()
        async with self._news:
            self._news.notify_all()

    def _take(self, report: dict[str, Any]) -> None:
        part = Measurements.from_json(report)
        number = report["worker"]
        self.connected[number] = report["connected"]
        self.playing[number] = report["playing"]
        (self.totals if report["measured"] else self.ramp).merge(part)
        at = int(report["at"])
        second = self.seconds.setdefault(at, Second(at, report["measured"]))
        second.all.merge(part)
        second.seconds += report["seconds"] / self._plan.processes
        second.connected = sum(self.connected)
        second.playing = sum(self.playing)
        second.busiest = max(second.busiest, report["cpu"] / max(report["seconds"], 1e-3))
        second.cpu += report["cpu"]


def _command(cpus: tuple[int, ...]) -> list[str]:
    cores = ",".join(map(str, cpus))
    return [*COMMAND, *([cores] if cores else [])]


def _write(worker: asyncio.subprocess.Process, line: str) -> None:
    if worker.stdin is not None and not worker.stdin.is_closing():
        worker.stdin.write(line.encode() + b"\n")
