"""Commands of the catalogue: `robotouille data …`."""

from __future__ import annotations

import math
import re
import signal
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.files.reading import read_text
from robotouille.files.writing import check_file
from robotouille.terminal import options_from, printable, tell
from robotouille_client.console import explain, fail, name_and_value, unicode
from robotouille_client.console.progress import progress_bar
from robotouille_data.cluster_watching import ClusterOptions, fetching, watched_folders

if TYPE_CHECKING:
    from sqlalchemy.engine import URL

    from robotouille_data.exports.exporting import ExportResult

JOBS = 2
FORMATS = ("parquet", "csv", "jsonl", "chat", "minari", "arrays")
PART_NAME = re.compile(r"[a-z][a-z0-9_]{0,30}")
"""Names of parts become folder names, so they are limited to safe characters."""
LIBRARIES = (
    "alembic", "jinja2", "matplotlib", "numpy", "polars", "psycopg", "pyarrow", "sqlalchemy",
)  # fmt: skip

data = typer.Typer(
    no_args_is_help=True, help="Index recordings in a catalogue, query it, and export from it."
)

FoldersArgument = Annotated[list[Path], typer.Argument(help="Folders of recordings.")]
DatabaseOption = Annotated[
    str | None,
    typer.Option(
        envvar="ROBOTOUILLE_DATABASE",
        help="An SQLite file or postgresql://USER@HOST/NAME. Default: DIR/catalogue.sqlite.",
    ),
]
FolderOption = Annotated[
    Path, typer.Option("--folder", help="Folder of recordings. Its catalogue is updated first.")
]
LabelOption = Annotated[
    list[str] | None,
    typer.Option(
        "--label", metavar="NAME=VALUE", help="Only episodes with this label; repeatable."
    ),
]
SecondsOption = Annotated[float, typer.Option(min=0.001, help="Time limit of the query.")]
JobsOption = Annotated[int, typer.Option(min=1, max=64, help="Processes that read recordings.")]


@contextmanager
def _errors_on_one_line() -> Iterator[None]:
    try:
        yield
    except RobotouilleError as error:
        fail(explain(error))
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in LIBRARIES:
            raise
        fail(explain(MissingExtraError("a catalogue of recordings", "data")))
    except BrokenPipeError:  # The reader of the pipe has stopped, as `head` does. Not an error.
        raise
    except OSError as error:
        fail(printable(f"{error.filename}: {error.strerror}"))
    except KeyboardInterrupt:
        fail("interrupted", 130)


def _catalogue(database: str | None, folder: Path) -> URL:
    """Return the URL of a database, or of a folder's catalogue after updating it.

    If the existing catalogue of the folder cannot be written, a warning is printed and the
    catalogue is used as it is.

    Raises:
        UnavailableError: The folder has no catalogue, and none can be created.
        CatalogueError: The database URL is invalid, the folder has no recordings, or its catalogue
            has a later version.
    """
    from robotouille_data.database import CatalogueError, UnavailableError, database_url
    from robotouille_data.indexing import has_recordings, index

    url = database_url(database, folder)
    if database is not None:
        return url
    known = Path(url.database or "").is_file()
    if not known and not has_recordings(folder):
        raise CatalogueError(
            f"{folder}: no catalogue and no recordings; set --folder to a folder of recordings, or "
            "set --database"
        )
    try:
        with progress_bar("recordings") as progress:
            found = index(url, [folder], jobs=JOBS, progress=progress)
    except UnavailableError as error:
        if not known:
            raise
        tell(printable(f"catalogue not updated: {error}"), err=True)
        return url
    _print_faults(found.faults)
    if found.indexed or found.removed:
        tell(f"indexed {found.indexed}, removed {found.removed}", err=True)
    return url


def _print_faults(faults: Mapping[str, str]) -> None:
    for path, fault in faults.items():
        tell(printable(f"{path}: {fault}"), err=True)


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


# Index and watch


@data.command()
def index(
    folders: FoldersArgument,
    database: DatabaseOption = None,
    jobs: JobsOption = JOBS,
    unfinished: Annotated[
        bool, typer.Option("--unfinished", help="Also index recordings without an end (.rbt.part).")
    ] = False,
    reindex: Annotated[
        bool, typer.Option("--reindex", help="Read unchanged recordings again.")
    ] = False,
    steps_to_go: Annotated[
        bool,
        typer.Option("--steps-to-go", help="Compute the distance to the goal at the end; slow."),
    ] = False,
    useful: Annotated[
        bool,
        typer.Option("--useful", help="Decide whether inactive seats could act usefully; slow."),
    ] = False,
) -> None:
    """Update a catalogue from folders of recordings.

    New and changed recordings are read, deleted ones are removed. Damaged recordings are reported
    and left out. The exit status is 1 if all recordings are damaged.
    """
    with _errors_on_one_line():
        from robotouille_data.database import database_url
        from robotouille_data.indexing import index as index_folders
        from robotouille_data.recording_rows import Searches

        url = database_url(database, folders[0])
        with progress_bar("recordings") as progress:
            found = index_folders(
                url, folders, jobs=jobs, unfinished=unfinished, reindex=reindex,
                searches=Searches(steps_to_go, useful), progress=progress,
            )  # fmt: skip
    _print_faults(found.faults)
    tell(f"indexed {found.indexed}, unchanged {found.unchanged}, removed {found.removed}")
    if found.unfinished:
        tell(f"{_counted(found.unfinished, 'unfinished recording')} left out (--unfinished)")
    if found.faults and not (found.indexed or found.unchanged):
        raise typer.Exit(1)


@data.command()
@options_from(ClusterOptions)
def watch(
    options: ClusterOptions,
    folders: Annotated[list[Path] | None, typer.Argument(help="Folders of recordings.")] = None,
    database: DatabaseOption = None,
    jobs: JobsOption = 1,
    interval: Annotated[float, typer.Option(min=0.1, help="Seconds between two scans.")] = 5.0,
) -> None:
    """Index recordings as they are finished, until interrupted.

    If the database or NATS is unavailable, the command retries at least once a minute. It then
    indexes everything that it missed.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    reported: dict[str, str] = {}
    with _errors_on_one_line():
        from robotouille_data.database import database_url
        from robotouille_data.indexing import IndexResult
        from robotouille_data.indexing import watch as watch_folders

        def report(found: IndexResult) -> None:
            new = {
                path: fault for path, fault in found.faults.items() if reported.get(path) != fault
            }
            reported.update(new)
            _print_faults(new)
            if found.indexed or found.removed:
                tell(f"indexed {found.indexed}, removed {found.removed}")

        def trouble(reason: str, pause: float) -> None:
            tell(printable(f"{reason}; retrying in {pause:.0f} s"), err=True)

        watched = watched_folders(folders or [], options, database)
        fetch = fetching(options, watched[0], stop) if options.cluster else lambda: None
        url = database_url(database, watched[0])
        watch_folders(
            url, watched, stop, jobs=jobs, interval=interval, fetch=fetch, report=report,
            trouble=trouble,
        )  # fmt: skip


# Query and report


@dataclass(frozen=True)
class SqlOptions:
    """Flags of `robotouille data sql`."""

    database: DatabaseOption = None
    folder: FolderOption = Path()
    csv: Annotated[Path | None, typer.Option("--csv", help="Write a CSV file.")] = None
    json: Annotated[Path | None, typer.Option("--json", help="Write a JSON file.")] = None
    parquet: Annotated[Path | None, typer.Option("--parquet", help="Write a Parquet file.")] = None
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Draw bars or lines in a .svg or .png file.")
    ] = None
    seconds: SecondsOption = 60.0


@data.command()
@options_from(SqlOptions)
def sql(
    query: Annotated[str, typer.Argument(callback=unicode, help="A read-only query in SQL.")],
    options: SqlOptions,
) -> None:
    """Print the answer to a query, write it to files, or draw it.

    docs/data.md describes the tables. Queries that write are refused.
    """
    with _errors_on_one_line():
        from robotouille_data import query_output as output
        from robotouille_data.query import asking

        files = (
            ("--csv", output.save_csv, options.csv),
            ("--json", output.save_json, options.json),
            ("--parquet", output.save_parquet, options.parquet),
            ("--plot", output.save_plot, options.plot),
        )
        wanted = []
        for flag, save, path in files:
            if path is not None:
                check_file(path, flag)
                wanted.append((save, path))
        url = _catalogue(options.database, options.folder)
        for save, path in wanted:
            with asking(url, query, options.seconds) as answer:
                count = save(answer, path)
            tell(printable(f"{path}: {_counted(count, 'row')}"))
        if wanted:
            return
        with asking(url, query, options.seconds) as answer:
            lines, more = output.table_lines(answer)
        for line in lines:
            tell(line)
        if more:
            tell(f"more than {output.MAX_SHOWN} rows; --csv writes all of them", err=True)


@dataclass(frozen=True)
class ReportFlags:
    """Flags of `robotouille data report`."""

    out: Annotated[Path, typer.Option("--out", help="File of the page.")] = Path("report.html")
    database: DatabaseOption = None
    folder: FolderOption = Path()
    label: LabelOption = None
    by: Annotated[str, typer.Option("--by", help="The label to compare.")] = "condition"
    text: Annotated[bool, typer.Option("--text/--no-text", help="Include chat messages.")] = True
    title: Annotated[str, typer.Option("--title", help="Title of the page.")] = (
        "Robotouille: a first look"
    )
    seconds: SecondsOption = 60.0


@data.command()
@options_from(ReportFlags)
def report(
    options: ReportFlags,
    query: Annotated[
        str | None,
        typer.Argument(
            callback=unicode,
            help="SQL with a column `id` or `episode_id`. Default: all episodes.",
        ),
    ] = None,
) -> None:
    """Compare episodes by a label on one HTML page: outcomes, activities, time lines and chat.

    The page contains no scripts and needs no other files.
    """
    with _errors_on_one_line():
        from robotouille_data.report.page import ReportOptions, write_report

        check_file(options.out)
        chosen = ReportOptions(
            query, _labels(options.label), options.by, options.text, options.title, options.seconds
        )
        url = _catalogue(options.database, options.folder)
        with progress_bar("report") as progress:
            count = write_report(url, options.out, chosen, progress.stage)
    tell(printable(f"{options.out}: {_counted(count, 'episode')}"))


def _labels(labels: list[str] | None) -> dict[str, str]:
    return dict(name_and_value(each, "--label") for each in labels or ())


# Export


@dataclass(frozen=True, kw_only=True)
class CardFlags:
    """Flags for the text of an export's card."""

    title: Annotated[str, typer.Option(help="Name of the data set.")] = ""
    description: Annotated[str, typer.Option(help="Description in a few sentences.")] = ""
    license: Annotated[str, typer.Option(help="SPDX identifier, such as CC-BY-4.0.")] = ""
    contact: Annotated[str, typer.Option(help="Contact for questions.")] = ""


@dataclass(frozen=True, kw_only=True)
class ExportFlags(CardFlags):
    """Flags of `robotouille data export`."""

    format: Annotated[
        list[str] | None,
        typer.Option("--format", help=f"{', '.join(FORMATS)}; repeatable. Default: parquet."),
    ] = None
    folder: FolderOption = Path()
    database: DatabaseOption = None
    query: Annotated[
        str,
        typer.Option(
            callback=unicode,
            help="SQL with a column `id` or `episode_id`. Default: all episodes.",
        ),
    ] = ""
    label: LabelOption = None
    consent: Annotated[
        str, typer.Option(metavar="NAME=VALUE", help="Only episodes with this label of consent.")
    ] = ""
    no_names: Annotated[
        bool, typer.Option("--no-names", help="Replace names and pseudonyms with p1, p2, …")
    ] = False
    no_text: Annotated[
        bool, typer.Option("--no-text", help="Leave out text that people and models wrote.")
    ] = False
    split: Annotated[
        str, typer.Option(metavar="PART=SHARE,…", help="Parts, such as train=0.8,test=0.2.")
    ] = ""
    split_by: Annotated[
        str, typer.Option(help="Label whose episodes with equal values stay in one part.")
    ] = "pair"
    system: Annotated[
        Path | None, typer.Option(help="Chat: file with the system prompt of each conversation.")
    ] = None
    per_decision: Annotated[
        bool, typer.Option("--per-decision", help="Chat: one conversation per decision.")
    ] = False
    seconds: SecondsOption = 60.0


@data.command()
@options_from(ExportFlags)
def export(
    out: Annotated[Path, typer.Argument(help="A new folder.")], options: ExportFlags
) -> None:
    """Write episodes as files for other software, with a codebook and a card.

    The folder is either complete or not created.
    """
    for unknown in set(options.format or ()) - set(FORMATS):
        fail(printable(f"--format {unknown}: expected one of {', '.join(FORMATS)}"))
    with _errors_on_one_line():
        from robotouille_data.exports.exporting import export as write
        from robotouille_data.exports.request import About, ExportFormat, ExportRequest

        system = options.system
        request = ExportRequest(
            tuple(map(ExportFormat, dict.fromkeys(options.format or ["parquet"]))),
            options.query,
            options.seconds,
            _labels(options.label),
            name_and_value(options.consent, "--consent") if options.consent else None,
            names=not options.no_names,
            texts=not options.no_text,
            split=_shares(options.split),
            split_by=options.split_by,
            system=read_text(system, errors="replace").strip() if system else "",
            per_decision=options.per_decision,
            about=About(options.title, options.description, options.license, options.contact),
        )
        url = _catalogue(options.database, options.folder)
        with progress_bar("episodes") as progress:
            found = write(url, out, request, progress)
    _print_result(found, out)


def _shares(text: str) -> dict[str, float]:
    """Parse `train=0.8,test=0.2`."""
    shares = {}
    for each in filter(None, text.split(",")):
        name, share = name_and_value(each, "--split")
        try:
            shares[name] = float(share)
        except ValueError:
            shares[name] = 0.0
        if not PART_NAME.fullmatch(name) or not 0 < shares[name] < math.inf:
            fail(f"--split {printable(each)}: expected a name and a share above 0")
    # Whole numbers are weights, as in train=2,test=1. Fractions must add up.
    weights = all(share.is_integer() for share in shares.values())
    if shares and not weights and not math.isclose(sum(shares.values()), 1, abs_tol=1e-6):
        fail(f"--split {printable(text)}: the shares sum to {sum(shares.values()):g}, not to 1")
    return shares


def _print_result(found: ExportResult, out: Path) -> None:
    for number, fault in found.faults.items():
        tell(printable(f"episode {number}: {fault}"), err=True)
    left_out = [f"{count} by {name}" for name, count in found.left_out.items() if count]
    if left_out:
        tell(f"left out: {', '.join(left_out)}")
    parts = [f"{name} {count}" for name, count in found.episodes.items() if name]
    details = f" ({', '.join(parts)})" if parts else ""
    tell(printable(f"{out}: {_counted(sum(found.episodes.values()), 'episode')}{details}"))


@data.command()
@options_from(CardFlags)
def card(
    folder: Annotated[Path, typer.Argument(help="Folder of an export.")], options: CardFlags
) -> None:
    """Print the card of an export, or change its title, description, licence or contact."""
    with _errors_on_one_line():
        from robotouille_data.exports.documents import rewrite_card

        text = rewrite_card(folder, {name: value for name, value in vars(options).items() if value})
    for line in text.splitlines():
        tell(printable(line))
