"""Play of a run's jobs with progress, a result table and the report."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from statistics import fmean
from types import TracebackType

import typer
from rich.console import Console
from rich.progress import Progress, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from robotouille.errors import RobotouilleError
from robotouille.terminal import printable, tell
from robotouille_client.console.progress import progress_columns
from robotouille_evaluation.cli.models import FATAL, MOCK, ModelChoice, open_model
from robotouille_evaluation.cli.results import write_page
from robotouille_evaluation.metrics import outcomes
from robotouille_evaluation.metrics.rows import ResultRow
from robotouille_evaluation.models import Model
from robotouille_evaluation.packs.pack import Pack
from robotouille_evaluation.runs import EpisodeJob, RunFolder, Workers, run_jobs

LOG_SECONDS = 30


class RunProgress:
    """Progress on stderr: a bar on a terminal, otherwise a line every half minute."""

    def __init__(self, done: Sequence[ResultRow], total: int) -> None:
        self._rows = list(done)
        self._total = total
        self._begun = time.monotonic()
        console = Console(stderr=True)
        self._progress = Progress(
            *progress_columns(),
            TimeRemainingColumn(),
            console=console,
            # Log files get lines instead of a bar (`log_lines`).
            disable=not console.is_terminal,
        )
        self._task = self._progress.add_task("", total=total, completed=len(self._rows))

    def __enter__(self) -> RunProgress:
        self._progress.start()
        self._show()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._progress.stop()

    def finished(self, job: EpisodeJob, row: ResultRow) -> None:
        """Count a finished episode."""
        self._rows.append(row)
        self._progress.advance(self._task)
        self._show()

    async def log_lines(self) -> None:
        """Print a line every half minute until cancelled, unless there is a bar."""
        while self._progress.disable:
            await asyncio.sleep(LOG_SECONDS)
            tell(f"{self}", err=True)

    def __str__(self) -> str:
        """Return a line like `12 of 300 episodes, 3 solved, 1 errors, $0.12, after 90 s`."""
        seconds = time.monotonic() - self._begun
        count = f"{len(self._rows)} of {self._total} episodes"
        return ", ".join([count, *self._words(), f"after {seconds:.0f} s"])

    def _show(self) -> None:
        self._progress.update(self._task, description=", ".join(self._words()))

    def _words(self) -> list[str]:
        goals = outcomes.with_goal(self._rows)
        solved = sum(row.outcome.success for row in goals)
        errors = sum(row.error is not None for row in self._rows)
        costs = [row.usage.cost for row in self._rows if row.usage.cost is not None]
        words = [f"{solved} solved"] if goals or not self._rows else []
        words += [f"{errors} errors"] if errors else []
        words += [f"${sum(costs):.2f}"] if costs else []
        return words


UNKNOWN = "–"


def run_table(rows: Sequence[ResultRow]) -> Table:
    """Return a table with a row for each agent, without columns that are unknown for all."""
    agents: dict[str, list[ResultRow]] = {}
    for row in rows:
        agents.setdefault(row.agent, []).append(row)
    names = sorted(agents)
    table = Table(box=None, pad_edge=False)
    table.add_column("agent", overflow="fold")
    lines = [[Text(printable(name))] for name in names]
    for heading, cell in COLUMNS.items():
        cells = [cell(agents[name]) for name in names]
        if set(cells) != {UNKNOWN}:
            table.add_column(heading, justify="right", no_wrap=True)
            for line, shown in zip(lines, cells, strict=True):
                line.append(Text(shown))
    for line in lines:
        table.add_row(*line)
    return table


def _success(rows: Sequence[ResultRow]) -> str:
    rate = outcomes.success_rate(rows)
    return UNKNOWN if rate is None else f"{100 * rate:.3g} %"


def _optimality(rows: Sequence[ResultRow]) -> str:
    rates = [rate for rate in map(outcomes.optimality_rate, rows) if rate is not None]
    return f"{fmean(rates):.2f}" if rates else UNKNOWN


def _score(rows: Sequence[ResultRow]) -> str:
    shares = [share for share in map(outcomes.score_share, rows) if share is not None]
    return f"{100 * fmean(shares):.3g} %" if shares else UNKNOWN


def _cost(rows: Sequence[ResultRow]) -> str:
    cost = outcomes.cost(rows)
    return UNKNOWN if cost is None else f"${cost:.2f}"


COLUMNS: dict[str, Callable[[Sequence[ResultRow]], str]] = {
    "episodes": lambda rows: str(len(rows)),
    "success": _success,
    "steps / optimum": _optimality,
    "score / planner": _score,
    "errors": lambda rows: str(sum(row.error is not None for row in rows)),
    "cost": _cost,
}


MAX_FATAL = 5
"""Episodes with fatal errors, and none without, after which a run is stopped."""


def play(folder: RunFolder, pack: Pack, planned: Sequence[EpisodeJob], workers: Workers) -> None:
    """Play the unfinished jobs, print a table on stderr, and write the report.

    The path of the report is printed on stdout, for use in scripts.

    Raises:
        RobotouilleError: The run was stopped, or a model cannot be asked.
        typer.Exit: With status 1, after the report, if episodes ended with errors.
    """
    done = folder.finished()
    # Episodes with errors are repeated; the journal answers their paid calls.
    over = {job for job, row in done.items() if row.error is None}
    left = [job for job in planned if job.id not in over]
    if not workers.scheduler:
        _announce_compiling(left, folder)
    with RunProgress([done[job] for job in over], len(planned)) as progress:
        try:
            asyncio.run(_run(folder, pack, left, workers, progress))
        except KeyboardInterrupt:
            raise RobotouilleError(
                f"stopped; continue with `robotouille benchmark resume {folder.path}`"
            ) from None
        except BaseExceptionGroup as group:
            raise _first(group) from None
    rows = folder.rows()
    Console(stderr=True, highlight=False).print(run_table(rows))
    tell(str(write_page(rows, folder.path / "report", figures=pack.figures)))
    _report_errors(rows, folder)


def _announce_compiling(left: Sequence[EpisodeJob], folder: RunFolder) -> None:
    """Print a line if worker processes will compile the planner, because they are silent."""
    if not any(job.agent.kind == "planner" for job in left) and not folder.plan().steps_to_go:
        return
    from robotouille.planning.kitchen.kernels import announce_compiling

    announce_compiling()


def _report_errors(rows: Sequence[ResultRow], folder: RunFolder) -> None:
    errors = [row.error for row in rows if row.error is not None]
    if not errors:
        return
    solved = sum(row.outcome.success for row in rows)
    line = f"{len(rows)} episodes, {solved} solved, {len(errors)} errors; the first: {errors[0]}"
    tell(printable(line), err=True)
    tell(f"repeat them with `robotouille benchmark resume {folder.path}`", err=True)
    raise typer.Exit(1)


async def _run(
    folder: RunFolder,
    pack: Pack,
    left: Sequence[EpisodeJob],
    workers: Workers,
    progress: RunProgress,
) -> None:
    fatal = _FatalErrors(folder)

    def finished(job: EpisodeJob, row: ResultRow) -> None:
        progress.finished(job, row)
        fatal.finished(job, row)

    async with AsyncExitStack() as opened:
        models: dict[str, Model] = {}

        async def make(job: EpisodeJob) -> Model:
            # One client serves all episodes of a model. Each mock episode needs a model of its
            # own, because mock answers depend on earlier requests.
            agent = job.agent
            if agent.model == MOCK:
                return await open_model(ModelChoice(MOCK), job.seed, opened)
            # Not the name alone: the file of a run could name two agents alike.
            key = agent.model_dump_json()
            if key not in models:
                models[key] = await open_model(ModelChoice.of_agent(agent), 0, opened)
            return models[key]

        logging = asyncio.create_task(progress.log_lines())
        opened.callback(logging.cancel)
        await run_jobs(folder, pack, left, workers, make, finished)


class _FatalErrors:
    """Stops a run whose model cannot be asked."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._fatal: Counter[str] = Counter()
        self._working: set[str] = set()

    def finished(self, job: EpisodeJob, row: ResultRow) -> None:
        """Raise RobotouilleError after `MAX_FATAL` episodes that all ended with fatal errors."""
        agent = job.agent.name
        if row.error is None or row.error.partition(":")[0] not in FATAL:
            self._working.add(agent)
            return
        self._fatal[agent] += 1
        if agent not in self._working and self._fatal[agent] >= MAX_FATAL:
            raise RobotouilleError(
                f"stopped: the first {MAX_FATAL} episodes of {agent} ended with errors, the last "
                f"with {row.error}; continue with "
                f"`robotouille benchmark resume {self._folder.path}`"
            )


def _first(group: BaseExceptionGroup[BaseException]) -> BaseException:
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error
