"""The jobs of a run played, and what is said of them on the way and at the end."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Sequence
from contextlib import AsyncExitStack

import typer
from rich.console import Console

from robotouille.errors import RobotouilleError
from robotouille.program import printable, tell
from robotouille_evaluation.cli.models import FATAL, MOCK, ModelChoice, open_model
from robotouille_evaluation.cli.progress import RunProgress
from robotouille_evaluation.cli.results import write_page
from robotouille_evaluation.cli.run_table import run_table
from robotouille_evaluation.metrics.rows import EpisodeRow
from robotouille_evaluation.models import Model
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs import Job, RunFolder, Workers, run_jobs

__all__ = ["MAX_FATAL", "play"]

MAX_FATAL = 5
"""So many episodes of a model end with a fatal error, and none without, before a run is stopped."""


def play(folder: RunFolder, pack: Pack, planned: Sequence[Job], workers: Workers) -> None:
    """Play what is left, with progress; then a table on stderr, and the report, whose path is told
    on stdout.

    Raises:
        RobotouilleError: The run was stopped, or a model answers nobody.
        typer.Exit: With status 1, after the report, if episodes ended with errors.
    """
    done = folder.finished()
    over = {job for job, row in done.items() if row.error is None}
    left = [job for job in planned if job.id not in over]
    with RunProgress([done[job] for job in over], len(planned)) as progress:
        try:
            asyncio.run(_run(folder, pack, left, workers, progress))
        except KeyboardInterrupt:
            raise RobotouilleError(
                f"stopped; `robotouille benchmark resume {folder.path}` goes on"
            ) from None
        except BaseExceptionGroup as group:
            raise _first(group) from None
    rows = folder.rows()
    Console(stderr=True, highlight=False).print(run_table(rows))
    tell(str(write_page(rows, folder.path / "report")))
    _tell_of_errors(rows, folder)


def _tell_of_errors(rows: Sequence[EpisodeRow], folder: RunFolder) -> None:
    errors = [row.error for row in rows if row.error is not None]
    if not errors:
        return
    solved = sum(row.outcome.success for row in rows)
    told = f"{len(rows)} episodes, {solved} solved, {len(errors)} errors; the first: {errors[0]}"
    tell(printable(told), err=True)
    tell(f"`robotouille benchmark resume {folder.path}` plays these again", err=True)
    raise typer.Exit(1)


async def _run(
    folder: RunFolder,
    pack: Pack,
    left: Sequence[Job],
    workers: Workers,
    progress: RunProgress,
) -> None:
    fatal = _FatalErrors(folder)

    def finished(job: Job, row: EpisodeRow) -> None:
        progress.finished(job, row)
        fatal.finished(job, row)

    async with AsyncExitStack() as opened:
        models: dict[str, Model] = {}

        async def make(job: Job) -> Model:
            """One client for all episodes of a model; mocks have one each, so that they repeat."""
            agent = job.agent
            if agent.model == MOCK:
                return await open_model(ModelChoice(MOCK), job.seed, opened)
            if agent.name not in models:
                models[agent.name] = await open_model(ModelChoice.of(agent), 0, opened)
            return models[agent.name]

        telling = asyncio.create_task(progress.tell_now_and_then())
        opened.callback(telling.cancel)
        await run_jobs(folder, pack, left, workers, make, finished)


class _FatalErrors:
    """Stops a run whose model answers nobody."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._fatal: Counter[str] = Counter()
        self._answers: set[str] = set()

    def finished(self, job: Job, row: EpisodeRow) -> None:
        """Raises RobotouilleError after `MAX_FATAL` episodes without another outcome."""
        agent = job.agent.name
        if row.error is None or row.error.partition(":")[0] not in FATAL:
            self._answers.add(agent)
            return
        self._fatal[agent] += 1
        if agent not in self._answers and self._fatal[agent] >= MAX_FATAL:
            raise RobotouilleError(
                f"stopped: the first {MAX_FATAL} episodes of {agent} ended with errors, the last "
                f"with {row.error}; `robotouille benchmark resume {self._folder.path}` goes on"
            )


def _first(group: BaseExceptionGroup[BaseException]) -> BaseException:
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error
