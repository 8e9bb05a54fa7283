"""A load test from its first connection to the collected results."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_client.loadtest.participant import Environment, Participant
from robotouille_client.loadtest.server_monitor import (
    MetricsPage,
    ServerProcess,
    ServerSample,
    fetch_page,
    is_here,
    listener,
)
from robotouille_client.loadtest.worker_pool import WorkerPool, allow_open_files
from robotouille_client.loadtest.workload import LoadPlan
from robotouille_client.sansio.addresses import split_addresses
from robotouille_client.sockets import server_uri

LINE_SECONDS = 5.0
"""Seconds between two lines of progress without a terminal."""


class ProgressDisplay:
    """Progress of a load test: a bar on a terminal, lines of text elsewhere."""

    def __init__(self, quiet: bool = False) -> None:
        self._console = Console(stderr=True, quiet=quiet)
        self._live = Live(console=self._console, refresh_per_second=4, transient=True)
        self._name = "connecting"
        self._seconds: float | None = None
        self._since = self._shown_at = time.monotonic()
        self._news = ""

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._live.stop()

    def phase(self, name: str, seconds: float | None) -> None:
        """Begin a phase that takes about so many seconds."""
        self._name, self._seconds = name, seconds
        self._since = self._shown_at = time.monotonic()
        if not self._console.is_terminal:
            about = f" ({seconds:g} s)" if seconds else ""
            self._console.print(f"{name}{about}", highlight=False)
        self._show()

    def update(self, pool: WorkerPool, samples: Sequence[ServerSample]) -> None:
        """Show the current figures."""
        parts = [f"{sum(pool.connected):,} connected, {sum(pool.playing):,} rooms play"]
        if pool.seconds:
            last = pool.seconds[max(pool.seconds)].all
            parts.append(f"{last.counts.get('steps', 0):,.0f} steps/s")
            age = last.duration("delta age")
            if age.count:
                parts.append(f"delta age {age.percentile(99) * 1000:.1f} ms (p99)")
        if len(samples) > 1:
            before, now = samples[-2], samples[-1]
            share = (now.cpu - before.cpu) / max(now.at - before.at, 1e-3)
            parts.append(f"server {share:.0%} of a core, {now.memory / 2**20:,.0f} MiB")
        self._news = "; ".join(parts)
        self._show()

    def _show(self) -> None:
        now = time.monotonic()
        if not self._console.is_terminal:
            if now > self._shown_at + LINE_SECONDS:
                self._shown_at = now
                self._console.print(f"  {self._news}", highlight=False, soft_wrap=True)
            return
        passed = now - self._since
        table = Table.grid(padding=(0, 1))
        bar = ProgressBar(total=self._seconds, completed=passed, width=24)
        if self._seconds is None:
            bar = ProgressBar(total=None, pulse=True, width=24)
        table.add_row(bar, f"[bold]{self._name}[/] [dim]{self._news}[/]")
        self._live.update(table)


SETTLE_SECONDS = 3.0
"""Seconds to wait after opening rooms, so that memory and lag settle."""
RETURN_SECONDS = 60.0
"""Minimum number of seconds to wait for the returns after a storm."""
SAMPLE_SECONDS = 1.0
"""Seconds between two samples of the server's process."""


class NothingStartedError(RobotouilleError):
    """No room could start. The message explains why."""


@dataclass
class LoadObservation:
    """Observations of the server and of the course of a load test."""

    server: str = ""
    begun: float = 0.0
    ended: float = 0.0
    interrupted: bool = False
    before: MetricsPage | None = None
    after: MetricsPage | None = None
    samples: list[ServerSample] = field(default_factory=list)
    memory: dict[str, int] = field(default_factory=dict)
    """Memory of the server in bytes after each phase."""
    storm_at: float | None = None


class LoadTest:
    """One load test. `observed` and `pool.totals` have the results so far."""

    def __init__(
        self,
        plan: LoadPlan,
        *,
        token: str | None = None,
        pid: int | None = None,
        metrics: str | None = None,
        cpus: tuple[int, ...] = (),
        progress: ProgressDisplay | None = None,
    ) -> None:
        self.plan = plan
        self.pool = WorkerPool(plan, token, cpus)
        self.observed = LoadObservation()
        self.process: ServerProcess | None = None
        self._token = token
        self._pid = pid
        # The figures of the server are those of one node.
        self._uri = server_uri(split_addresses(plan.url)[0])
        scheme, host = "https" if self._uri.secure else "http", self._uri.host
        where = f"[{host}]" if ":" in host else host
        self._metrics = metrics or f"{scheme}://{where}:{self._uri.port}/metrics"
        self._progress = progress or ProgressDisplay(quiet=True)

    async def run(self) -> None:
        """Run all phases. An interrupt ends them early and keeps the results so far.

        Raises:
            RobotouilleError: No server answers, or no room could start.
        """
        self._find_process()
        players_a_process = -(-self.plan.rooms // self.plan.processes) * 4
        watching = self.plan.spectators + self.plan.slow_readers
        allow_open_files(players_a_process + -(-watching // self.plan.processes))
        await self._try()
        driving = asyncio.create_task(self._drive())
        with _interruptible(driving), self._progress:
            async with self._sampling():
                try:
                    await driving
                except asyncio.CancelledError:
                    self.observed.interrupted = True
                finally:
                    await self._finish()

    def _find_process(self) -> None:
        pid = self._pid
        if pid is None and is_here(self._uri.host):
            pid = listener(self._uri.port)
        self.process = ServerProcess(pid) if pid is not None else None

    async def _try(self) -> None:
        # One connection is tried first, so that a wrong address does not show as thousands of
        # failures.
        one = Participant(Environment(self.plan.url, token=self._token), "load-test")
        try:
            welcome = await one.introduce()
        except ProtocolError as error:
            raise RobotouilleError(f"{self.plan.url} refuses the load test: {error}") from None
        finally:
            one.close()
        self.observed.server = str(welcome.get("server", ""))

    # Phases

    async def _drive(self) -> None:
        plan, observed = self.plan, self.observed
        await self.pool.start()
        self._remember_memory("empty")
        self._progress.phase(f"opening {plan.rooms:,} rooms", plan.ramp)
        await self.pool.do("open")
        await asyncio.sleep(SETTLE_SECONDS)
        self._check_started()
        self._remember_memory("rooms")
        if plan.spectators:
            self._progress.phase(f"joining with {plan.spectators:,} spectators", plan.ramp)
            await self.pool.do("spectate")
            await asyncio.sleep(SETTLE_SECONDS)
            self._remember_memory("spectators")
        observed.before = await fetch_page(self._metrics)
        await self.pool.do("measure")
        observed.begun = time.monotonic()
        self._progress.phase("measuring", plan.duration)
        if plan.storm:
            await self._sleep_until(observed.begun + plan.duration / 2)
            await self._storm()
        await self._sleep_until(observed.begun + plan.duration)

    def _check_started(self) -> None:
        if self.plan.rooms and not any(self.pool.playing):
            reasons = refusals(self.pool.ramp.counts)
            raise NothingStartedError(f"no room could start: {'; '.join(reasons) or 'no answer'}")

    async def _storm(self) -> None:
        observed = self.observed
        observed.storm_at = time.monotonic()
        await self.pool.do("storm")
        give_up = observed.storm_at + max(RETURN_SECONDS, self.plan.duration / 2)
        while time.monotonic() < give_up:
            await self.pool.news(SAMPLE_SECONDS)
            back = self.pool.totals.duration("return").count
            lost = self.pool.totals.counts.get("lost in the storm", 0)
            if back + lost >= self.pool.storm_cut:
                return

    async def _sleep_until(self, at: float) -> None:
        while (left := at - time.monotonic()) > 0:
            await self.pool.news(min(left, SAMPLE_SECONDS))

    async def _finish(self) -> None:
        self._progress.phase("collecting the results", None)
        self.observed.ended = time.monotonic()
        if self.observed.begun:
            self.observed.after = await fetch_page(self._metrics)
        await self.pool.stop()

    # Watching

    def _remember_memory(self, moment: str) -> None:
        sample = self.process.sample() if self.process is not None else None
        if sample is not None:
            self.observed.memory[moment] = sample.memory

    @asynccontextmanager
    async def _sampling(self) -> AsyncIterator[None]:
        sampler = asyncio.create_task(self._sample())
        try:
            yield
        finally:
            sampler.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await sampler

    async def _sample(self) -> None:
        while True:
            if self.process is not None and (sample := self.process.sample()):
                self.observed.samples.append(sample)
            self._progress.update(self.pool, self.observed.samples)
            await asyncio.sleep(SAMPLE_SECONDS)


@contextlib.contextmanager
def _interruptible(task: asyncio.Task[None]) -> Iterator[None]:
    """Let the first SIGINT or SIGTERM cancel the task. A second one ends the program."""
    loop = asyncio.get_running_loop()
    signals = (signal.SIGINT, signal.SIGTERM)

    def interrupt() -> None:
        task.cancel()
        for number in signals:
            loop.remove_signal_handler(number)

    try:
        for number in signals:
            loop.add_signal_handler(number, interrupt)
    except (NotImplementedError, RuntimeError):
        yield
        return
    try:
        yield
    finally:
        for number in signals:
            loop.remove_signal_handler(number)


def refusals(counts: dict[str, float]) -> list[str]:
    """Return the reasons why bots could not start, most frequent first."""
    prefix = "not begun: "
    found = sorted((-n, name) for name, n in counts.items() if name.startswith(prefix))
    return [f"{name.removeprefix(prefix)} ({-n:,.0f} times)" for n, name in found[:5]]
