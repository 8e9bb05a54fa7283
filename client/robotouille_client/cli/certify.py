"""Command `robotouille certify`: certificates for a folder of problems, and their check."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import typer
from rich.console import Console, Group
from rich.live import Live
from rich.progress import Progress
from rich.table import Table
from rich.text import Text

from robotouille.certification.certificate import ExpansionBudget
from robotouille.certification.certifying import BUDGET, certify_dataset, check_dataset
from robotouille.certification.dataset import CertifyingOutcome, DatasetReport, Running, Tell
from robotouille.errors import RobotouilleError, did_you_mean
from robotouille.installation import data_folder
from robotouille.planning import solvers as optimal
from robotouille.terminal import options_from, printable, tell
from robotouille_client.console import JsonOption, explain, fail
from robotouille_client.console.progress import progress_columns

COLUMNS = ("instances", "proven", "gaps", "unsolved", "failed")


@dataclass(frozen=True, kw_only=True)
class CertifyOptions:
    """Options of `robotouille certify`."""

    jobs: Annotated[int, typer.Option(min=1, help="Number of processes.")] = 1
    ignore_existing: Annotated[
        bool, typer.Option("--ignore-existing", help="Certify every instance again.")
    ] = False
    check: Annotated[
        bool, typer.Option("--check", help="Only check existing certificates: hashes and plans.")
    ] = False
    sample: Annotated[
        int, typer.Option(min=0, help="With --check: number of lower bounds to prove again.")
    ] = 0
    seed: Annotated[int, typer.Option(help="Seed for choosing the instances of --sample.")] = 0
    expansions: Annotated[
        int,
        typer.Option(
            min=0,
            help="Search budget for each instance, in expansions. --sample refuses larger ones.",
        ),
    ] = BUDGET.expansions or 0
    states: Annotated[
        int,
        typer.Option(min=0, help="Maximum number of states in a process, which limits its memory."),
    ] = BUDGET.states or 0
    timeout: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            help="Time limit for each instance in seconds. Results then depend on the machine.",
        ),
    ] = None
    json_output: JsonOption = False


@options_from(CertifyOptions)
def certify(
    dataset: Annotated[
        str, typer.Argument(help="Folder of problem files, or name of a shipped one.")
    ],
    options: CertifyOptions,
) -> None:
    """Certify the shortest plans of all problems in a folder, and write a manifest of them.

    After an interruption, run it again: existing certificates are kept. The exit status is 1 if
    anything failed, or with --check if anything is invalid.
    """
    try:
        if options.sample and not options.check:
            raise RobotouilleError("--sample needs --check")
        folder = _folder(dataset)
        with _progress("checking" if options.check else "certifying") as progress:
            report = _report(folder, options, progress)
    except (RobotouilleError, OSError) as error:
        fail(explain(error))
    except KeyboardInterrupt:
        fail("interrupted; finished certificates are kept, and the next run continues", 130)
    if options.json_output:
        typer.echo(json.dumps(_json(report), indent=2))
    else:
        Console(highlight=False).print(_table(report))
        tell("".join(f"{printable(fault)}\n" for fault in report.faults), err=True, nl=False)
    if report.faults:
        raise typer.Exit(1)


def _report(folder: Path, options: CertifyOptions, progress: Tell | None) -> DatasetReport:
    budget = ExpansionBudget(
        expansions=options.expansions, states=options.states, seconds=options.timeout
    )
    if options.check:
        return check_dataset(
            folder,
            optimal.solve,
            sample=options.sample,
            seed=options.seed,
            budget=budget,
            tell=progress,
        )
    return certify_dataset(
        folder,
        optimal.solve,
        budget=budget,
        jobs=options.jobs,
        ignore_existing=options.ignore_existing,
        tell=progress,
    )


def _folder(name: str) -> Path:
    if Path(name).is_dir():
        return Path(name)
    shipped = {path.name: path for path in data_folder("problems").iterdir() if path.is_dir()}
    if name in shipped:
        return shipped[name]
    raise RobotouilleError(f"{name}: is not a folder{did_you_mean(name, shipped)}")


# Results


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


# Progress


@contextmanager
def _progress(doing: str) -> Iterator[Tell | None]:
    """Show a bar and a line for each running instance on stderr, if it is a terminal."""
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
    words = f"  {instance}: {running.expansions:,} expansions, lower bound {running.bound}"
    if running.length is not None:
        gap = max(0, running.length - running.bound)
        words += f", plan {running.length}, gap {gap}"
    return Text(words, overflow="ellipsis", no_wrap=True)
