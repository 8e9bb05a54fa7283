"""Play of all jobs of a run: models side by side, planners in other processes."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Awaitable, Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.processes import spawn_context
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.models import Model
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.packs.store import read_pack
from robotouille_evaluation.runs.execute import RunContext, play_job
from robotouille_evaluation.runs.folder import DEAD_PROCESS, RunFolder, RunPlan
from robotouille_evaluation.runs.job_list import EpisodeJob

MakeModel = Callable[[EpisodeJob], Awaitable[Model]]
CONNECT_SECONDS = 10
Finished = Callable[[EpisodeJob, ResultRow], None]


@dataclass(frozen=True, slots=True)
class Workers:
    """Limits on what happens at the same time.

    Args:
        processes: Processes for agents without a model.
        calls: Episodes that wait for a model at once.
        scheduler: Address of a Dask scheduler to use instead of processes. Its workers must see
            the folders of run and pack under the same paths.
    """

    processes: int = 1
    calls: int = 16
    scheduler: str = ""


async def run_jobs(
    folder: RunFolder,
    pack: Pack,
    jobs: Sequence[EpisodeJob],
    workers: Workers,
    make_model: MakeModel,
    finished: Finished,
) -> None:
    """Play all jobs in any order, and call `finished` when a row is on the disk.

    Raises:
        FileError: A row cannot be written. Rows that were written before stay, and a resumed run
            does not repeat them.
        RobotouilleError: An agent cannot be made, or another process plays the run.
    """
    plan = folder.plan()
    context = RunContext(plan.name, pack, folder, steps_to_go=plan.steps_to_go)
    asking = [job for job in jobs if job.agent.kind == "model"]
    planning = [job for job in jobs if job.agent.kind != "model"]
    slots = asyncio.Semaphore(workers.calls)

    async def ask(job: EpisodeJob) -> None:
        async with slots:
            row = await play_job(job, context, await make_model(job))
        _finish(folder, job, row, finished)

    async def compute(job: EpisodeJob, executor: Executor) -> None:
        loop = asyncio.get_running_loop()
        # JSON text is safe to send to Dask workers on other machines.
        arguments = (
            job.model_dump_json(),
            plan.model_dump_json(exclude={"jobs"}),
            str(folder.path),
        )
        try:
            text = await loop.run_in_executor(executor, _play_elsewhere, *arguments)
        except BrokenProcessPool:
            kept = "`robotouille benchmark resume` keeps the finished episodes"
            raise RobotouilleError(f"{DEAD_PROCESS}; {kept}") from None
        _finish(folder, job, ResultRow.model_validate_json(text), finished)

    with folder.playing():
        async with asyncio.TaskGroup() as group:
            for job in asking:
                group.create_task(ask(job))
            if planning:
                # Planners block their process, so they do not share the event loop with models.
                with _executor(workers) as executor:
                    try:
                        async with asyncio.TaskGroup() as computing:
                            for job in planning:
                                computing.create_task(compute(job, executor))
                    except BaseException:
                        # Jobs that have not begun are dropped; running ones end by themselves.
                        executor.shutdown(wait=False, cancel_futures=True)
                        raise


@contextmanager
def _executor(workers: Workers) -> Iterator[Executor]:
    if not workers.scheduler:
        with ProcessPoolExecutor(workers.processes, spawn_context(), _ignore_interrupts) as pool:
            yield pool
        return
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtraError("a scheduler", "dask") from None
    try:
        client = Client(workers.scheduler, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise RobotouilleError(f"no Dask scheduler at {workers.scheduler}: {error}") from None
    with client, client.get_executor(pure=False) as executor:
        yield executor


def _ignore_interrupts() -> None:
    """Leave Ctrl+C to the parent, which waits for the episodes in progress."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _finish(folder: RunFolder, job: EpisodeJob, row: ResultRow, finished: Finished) -> None:
    folder.add(row)
    finished(job, row)


def _play_elsewhere(job: str, plan: str, folder: str) -> str:
    """Play a job in a worker process and return its row as JSON."""
    run = RunPlan.model_validate_json(plan)
    context = RunContext(
        run.name, _pack(run.pack_folder), RunFolder(Path(folder)), steps_to_go=run.steps_to_go
    )
    playing = play_job(EpisodeJob.model_validate_json(job), context)
    return asyncio.run(playing).model_dump_json()


@lru_cache(maxsize=2)
def _pack(folder: str) -> Pack:
    return read_pack(Path(folder))
