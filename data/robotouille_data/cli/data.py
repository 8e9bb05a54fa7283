"""`robotouille data …`: recordings as tables of a database."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.program import printable, tell
from robotouille_client.console.progress import progress_bar
from robotouille_data.cli.console import JOBS, DatabaseOption, FolderOption, catalogue, errors_told
from robotouille_data.cli.export import card, export
from robotouille_data.cli.report import report

if TYPE_CHECKING:
    from robotouille_data.indexing import Indexed

__all__ = ["data"]

data = typer.Typer(
    no_args_is_help=True, help="A catalogue of recordings: index, watch, query, report, export."
)
data.command()(report)
data.command()(export)
data.command()(card)

FoldersArgument = Annotated[list[Path], typer.Argument(help="Folders of recordings.")]
JobsOption = Annotated[int, typer.Option(min=1, max=64, help="Processes that read.")]


@data.command()
def index(
    folders: FoldersArgument,
    database: DatabaseOption = None,
    jobs: JobsOption = JOBS,
    unfinished: Annotated[
        bool, typer.Option("--unfinished", help="Also recordings without an end (.rbt.part).")
    ] = False,
    anew: Annotated[bool, typer.Option("--anew", help="Also read what has not changed.")] = False,
    steps_to_go: Annotated[
        bool, typer.Option("--steps-to-go", help="Also how far from the goal episodes ended: slow.")
    ] = False,
) -> None:
    """Bring a catalogue up to date with folders of recordings.

    What is new or has changed is read, what is gone is forgotten. Damaged recordings are named,
    and left out.
    """
    with errors_told():
        from robotouille_data.database import database_url
        from robotouille_data.indexing import index as index_folders

        url = database_url(database, folders[0])
        with progress_bar("recordings") as progress:
            found = index_folders(
                url, folders, jobs=jobs, unfinished=unfinished, anew=anew,
                steps_to_go=steps_to_go, progress=progress,
            )  # fmt: skip
    for path, fault in found.faults.items():
        tell(printable(f"{path}: {fault}"), err=True)
    for line in _lines(found):
        tell(line)


@data.command()
def watch(
    folders: FoldersArgument,
    database: DatabaseOption = None,
    jobs: JobsOption = 1,
    interval: Annotated[
        float, typer.Option(min=0.1, help="Seconds between two looks at the folders.")
    ] = 5.0,
) -> None:
    """Go on indexing as recordings are finished, until it is interrupted.

    A database that goes away is tried again, at least once a minute; nothing is missing afterwards.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    told: dict[str, str] = {}
    with errors_told():
        from robotouille_data.database import database_url
        from robotouille_data.watching import watch as watch_folders

        def report(found: Indexed) -> None:
            for path, fault in found.faults.items():
                if told.get(path) != fault:
                    told[path] = fault
                    tell(printable(f"{path}: {fault}"), err=True)
            if found.indexed or found.forgotten:
                tell(f"indexed {found.indexed}, forgotten {found.forgotten}")

        def trouble(words: str, pause: float) -> None:
            tell(printable(f"{words}; tried again in {pause:.0f} s"), err=True)

        url = database_url(database, folders[0])
        watch_folders(
            url, folders, stop, jobs=jobs, interval=interval, report=report, trouble=trouble
        )


@data.command()
def sql(
    query: Annotated[str, typer.Argument(help="A query in SQL, that only reads.")],
    database: DatabaseOption = None,
    folder: FolderOption = Path(),
    csv: Annotated[Path | None, typer.Option("--csv", help="Write a file.")] = None,
    json: Annotated[Path | None, typer.Option("--json", help="Write a file.")] = None,
    parquet: Annotated[Path | None, typer.Option("--parquet", help="Write a file.")] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Draw it, as .svg or .png: bars or lines.")
    ] = None,
    seconds: Annotated[float, typer.Option(min=0.001, help="How long it may take.")] = 60.0,
) -> None:
    """Ask a catalogue: print a table, or write files, or draw.

    The tables are described in docs/data.md. Whatever would write is refused.
    """
    with errors_told():
        from robotouille_data.answers.plotting import save_plot
        from robotouille_data.answers.query import asking
        from robotouille_data.answers.saving import (
            MAX_SHOWN,
            save_csv,
            save_json,
            save_parquet,
            table_lines,
        )

        files = ((save_csv, csv), (save_json, json), (save_parquet, parquet), (save_plot, plot))
        wanted = [(save, path) for save, path in files if path is not None]
        url = catalogue(database, folder)
        for save, path in wanted:
            with asking(url, query, seconds) as answer:
                count = save(answer, path)
            tell(printable(f"{path}: {count} rows"))
        if wanted:
            return
        with asking(url, query, seconds) as answer:
            lines, more = table_lines(answer)
        for line in lines:
            tell(line)
        if more:
            tell(f"there are more than {MAX_SHOWN} rows: --csv writes all", err=True)


def _lines(found: Indexed) -> Iterator[str]:
    yield f"indexed {found.indexed}, unchanged {found.unchanged}, forgotten {found.forgotten}"
    if found.unfinished:
        yield f"{found.unfinished} without an end were left out (--unfinished)"
