"""Runs a load test from its first connection to its report."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from robotouille.errors import ProtocolError, RobotouilleError
from robotouille_client.loadtest.open_files import allow_open_files
from robotouille_client.loadtest.progress import ProgressDisplay
from robotouille_client.loadtest.server_monitor import (
    Page,
    ServerProcess,
    ServerSample,
    fetch_page,
    is_here,
    listener,
)
from robotouille_client.loadtest.worker.participant import Environment, Participant
from robotouille_client.loadtest.worker_pool import WorkerPool
from robotouille_client.loadtest.workload import LoadPlan
from robotouille_client.sockets import server_uri

__all__ = ["LoadObservation", "LoadTest", "NothingBegunError", "refusals"]

SETTLE_SECONDS = 3.0
RETURN_SECONDS = 60.0
SAMPLE_SECONDS = 1.0


class NothingBegunError(RobotouilleError):
    """Not one of the bots could begin; the message says why."""


@dataclass
class LoadObservation:
    """What a load test has seen of the server and of itself."""

    server: str = ""
    begun: float = 0.0
    ended: float = 0.0
    interrupted: bool = False
    before: Page | None = None
    after: Page | None = None
    samples: list[ServerSample] = field(default_factory=list)
    memory: dict[str, int] = field(default_factory=dict)
    """Bytes of the server's memory at named moments."""
    storm_at: float | None = None
    storm_over: float | None = None


class LoadTest:
    """One load test. `observed` and `pool.totals` hold what there is at any time."""

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
        self._uri = server_uri(plan.url)
        scheme, host = "https" if self._uri.secure else "http", self._uri.host
        where = f"[{host}]" if ":" in host else host
        self._metrics = metrics or f"{scheme}://{where}:{self._uri.port}/metrics"
        self._progress = progress or ProgressDisplay(quiet=True)

    async def run(self) -> None:
        """All phases; an interrupt ends them early and keeps what was measured.

        RobotouilleError if there is no server, or none of the bots could begin.
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
        """One connection, so that a wrong address is told at once."""
        one = Participant(Environment(self._uri, token=self._token), "load-test")
        try:
            welcome = await one.introduce()
        except ProtocolError as error:
            raise RobotouilleError(f"{self.plan.url} refuses: {error}") from None
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
        self._check_begun()
        self._remember_memory("rooms")
        if plan.spectators:
            self._progress.phase(f"letting {plan.spectators:,} spectators in", plan.ramp)
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

    def _check_begun(self) -> None:
        """Whether any room plays, if any was to."""
        if self.plan.rooms and not any(self.pool.playing):
            reasons = refusals(self.pool.ramp.counts)
            raise NothingBegunError(f"no room could begin: {'; '.join(reasons) or 'no answer'}")

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
                observed.storm_over = time.monotonic()
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
    """SIGINT and SIGTERM cancel the task; the second one does what it does by default."""
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
    """Why bots could not begin, the most frequent first."""
    prefix = "not begun: "
    found = sorted((-n, name) for name, n in counts.items() if name.startswith(prefix))
    return [f"{name.removeprefix(prefix)} ({-n:,.0f} times)" for n, name in found[:5]]
