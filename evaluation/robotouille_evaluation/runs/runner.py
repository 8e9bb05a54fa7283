"""All jobs of a run: those that plan in other processes, those that ask models side by side."""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from robotouille.certification.spawning import spawn_context
from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille_evaluation.metrics.rows import EpisodeRow
from robotouille_evaluation.models import Model
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.packs.store import read_pack
from robotouille_evaluation.runs.execute import play_job
from robotouille_evaluation.runs.folder import RunFolder, RunPlan
from robotouille_evaluation.runs.jobs import Job

__all__ = ["MakeModel", "Workers", "run_jobs"]

MakeModel = Callable[[Job], Awaitable[Model]]
CONNECT_SECONDS = 10
Finished = Callable[[Job, EpisodeRow], None]


@dataclass(frozen=True, slots=True)
class Workers:
    """How much is done at the same time.

    `processes` play what needs no model; `calls` is how many episodes wait for models at once.
    `scheduler` is the address of a Dask scheduler, whose workers are used instead of processes;
    they must see the run's folder and the pack's under the same paths.
    """

    processes: int = 1
    calls: int = 16
    scheduler: str = ""


async def run_jobs(
    folder: RunFolder,
    pack: Pack,
    jobs: Sequence[Job],
    workers: Workers,
    make_model: MakeModel,
    finished: Finished,
) -> None:
    """Play all jobs, in no order; each row is on the disk when `finished` is told.

    Raises:
        FileError: A row cannot be written. What was played before is there, and is not played
            again when the run is resumed.
        RobotouilleError: An agent cannot be made, or another process plays the run.
    """
    plan = folder.plan()
    asking = [job for job in jobs if job.agent.kind == "model"]
    planning = [job for job in jobs if job.agent.kind != "model"]
    slots = asyncio.Semaphore(workers.calls)

    async def ask(job: Job) -> None:
        async with slots:
            model = await make_model(job)
            row = await play_job(
                job,
                plan.name,
                pack,
                folder,
                model,
                time.perf_counter,
                steps_to_go=plan.steps_to_go,
            )
        _finish(folder, job, row, finished)

    async def compute(job: Job, executor: Executor) -> None:
        loop = asyncio.get_running_loop()
        arguments = (
            job.model_dump_json(),
            plan.model_dump_json(exclude={"jobs"}),
            str(folder.path),
        )
        text = await loop.run_in_executor(executor, _play_elsewhere, *arguments)
        _finish(folder, job, EpisodeRow.model_validate_json(text), finished)

    with folder.playing():
        async with asyncio.TaskGroup() as group:
            for job in asking:
                group.create_task(ask(job))
            if planning:
                with _executor(workers) as executor:
                    try:
                        async with asyncio.TaskGroup() as computing:
                            for job in planning:
                                computing.create_task(compute(job, executor))
                    except BaseException:
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
    """Ctrl+C is for the parent, which waits for the episodes under way."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _finish(folder: RunFolder, job: Job, row: EpisodeRow, finished: Finished) -> None:
    folder.add(row)
    finished(job, row)


def _play_elsewhere(job: str, plan: str, folder: str) -> str:
    """In another process, of this machine or another."""
    of = RunPlan.model_validate_json(plan)
    playing = play_job(
        Job.model_validate_json(job),
        of.name,
        _pack(of.pack_folder),
        RunFolder(Path(folder)),
        None,
        time.perf_counter,
        steps_to_go=of.steps_to_go,
    )
    return asyncio.run(playing).model_dump_json()


@lru_cache(maxsize=2)
def _pack(folder: str) -> Pack:
    return read_pack(Path(folder))
