"""`robotouille certify DATASET`: certificates for a folder of problems, and their check."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import typer
from rich.console import Console, Group
from rich.live import Live
from rich.progress import Progress
from rich.table import Table
from rich.text import Text

from robotouille.certification.certificate import ExpansionBudget
from robotouille.certification.certifying import BUDGET, certify_dataset
from robotouille.certification.checking import check_dataset
from robotouille.certification.dataset import CertifyingOutcome, DatasetReport, Running, Tell
from robotouille.errors import RobotouilleError, did_you_mean
from robotouille.planning import solvers as optimal
from robotouille.program import printable, tell
from robotouille.resources import data_folder
from robotouille_client.console import explain, fail
from robotouille_client.console.progress import progress_columns

__all__ = ["certify"]

COLUMNS = ("instances", "proven", "gaps", "unsolved", "failed")


def certify(
    dataset: Annotated[str, typer.Argument(help="Folder of problem files, or a shipped one.")],
    jobs: Annotated[int, typer.Option(min=1, help="Number of processes.")] = 1,
    fresh: Annotated[bool, typer.Option("--fresh", help="Keep no certificate.")] = False,
    check: Annotated[
        bool, typer.Option("--check", help="Only check what lies there: hashes and plans.")
    ] = False,
    sample: Annotated[
        int, typer.Option(min=0, help="With --check: prove so many bounds again.")
    ] = 0,
    seed: Annotated[int, typer.Option(help="Which ones --sample takes.")] = 0,
    expansions: Annotated[
        int, typer.Option(min=0, help="Expansions an instance may cost.")
    ] = BUDGET.expansions or 0,
    states: Annotated[
        int, typer.Option(min=0, help="States a process may keep: limits its memory.")
    ] = BUDGET.states or 0,
    timeout: Annotated[
        float | None,
        typer.Option(min=0.1, help="Seconds for an instance; what it gives up depends on speed."),
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Certify the shortest plans of all problems in a folder, and write a manifest of them.

    Run it again after an interruption: what is certified already is kept. Exit status 1 if
    anything failed, or with --check if anything is invalid.
    """
    try:
        if sample and not check:
            raise RobotouilleError("--sample needs --check")
        folder = _folder(dataset)
        with _shown("checking" if check else "certifying") as progress:
            if check:
                report = check_dataset(
                    folder, optimal.solve, sample=sample, seed=seed, seconds=timeout, tell=progress
                )
            else:
                budget = ExpansionBudget(expansions=expansions, states=states, seconds=timeout)
                report = certify_dataset(
                    folder, optimal.solve, budget=budget, jobs=jobs, fresh=fresh, tell=progress
                )
    except (RobotouilleError, OSError) as error:
        fail(explain(error))
    except KeyboardInterrupt:
        fail("interrupted; finished certificates are kept, and the next run goes on", 130)
    if json_output:
        typer.echo(json.dumps(_json(report), indent=2))
    else:
        Console(highlight=False).print(_table(report))
        tell("".join(f"{printable(fault)}\n" for fault in report.faults), err=True, nl=False)
    if report.faults:
        raise typer.Exit(1)


def _folder(name: str) -> Path:
    """The folder of a path, or a shipped one by its name, e.g. `synchronous`."""
    if Path(name).is_dir():
        return Path(name)
    shipped = {path.name: path for path in data_folder("problems").iterdir() if path.is_dir()}
    if name in shipped:
        return shipped[name]
    raise RobotouilleError(f"{name}: is not a folder{did_you_mean(name, shipped)}")


# The end


def _class(outcome: CertifyingOutcome) -> str:
    certificate = outcome.certificate
    if certificate is None:
        return "failed"
    if certificate.optimal or certificate.unsolvable:
        return "proven"
    return "unsolved" if certificate.plan is None else "gaps"


def _counts(outcomes: Sequence[CertifyingOutcome]) -> dict[str, int]:
    counts = Counter(map(_class, outcomes))
    return {"instances": len(outcomes), **{name: counts[name] for name in COLUMNS[1:]}}


def _json(report: DatasetReport) -> dict[str, Any]:
    kept = sum(outcome.kept for outcome in report.outcomes)
    return {**_counts(report.outcomes), "kept": kept, "faults": list(report.faults)}


def _table(report: DatasetReport) -> Table:
    """A row for each folder, and one for all."""
    folders: dict[str, list[CertifyingOutcome]] = {}
    for outcome in report.outcomes:
        folder = str(PurePosixPath(outcome.instance.file).parent)
        folders.setdefault(folder, []).append(outcome)
    table = Table("folder", box=None, pad_edge=False)
    for name in COLUMNS:
        table.add_column(name, justify="right")
    for folder, outcomes in sorted(folders.items()):
        table.add_row(Text(printable(folder)), *map(str, _counts(outcomes).values()))
    if len(folders) != 1:
        table.add_row("all", *map(str, _counts(report.outcomes).values()))
    return table


# Meanwhile


@contextmanager
def _shown(doing: str) -> Iterator[Tell | None]:
    """A bar, and a line for each instance in work, on stderr where that is a terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    bar = Progress(*progress_columns(), console=console)
    job = bar.add_task(doing, total=None)
    with Live(bar, console=console, transient=True, refresh_per_second=4) as live:

        def tell(done: Sequence[CertifyingOutcome], total: int, running: Sequence[Running]) -> None:
            bar.update(job, completed=len(done), total=total)
            live.update(Group(bar, *map(_line, running)))

        yield tell


def _line(running: Running) -> Text:
    instance = printable(str(running.instance))
    words = f"  {instance}: {running.expansions:,} expansions, bound {running.bound}"
    if running.length is None:
        return Text(words, overflow="ellipsis", no_wrap=True)
    gap = max(0, running.length - running.bound)
    plan = f", plan {running.length}, gap {gap}"
    return Text(words + plan, overflow="ellipsis", no_wrap=True)
