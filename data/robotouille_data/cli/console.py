"""What the commands of the catalogue share: options, and errors in a line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.program import printable, tell
from robotouille_client.console import explain, fail
from robotouille_client.console.progress import progress_bar

if TYPE_CHECKING:
    from sqlalchemy.engine import URL

__all__ = ["JOBS", "DatabaseOption", "FolderOption", "catalogue", "errors_told"]

JOBS = 2
"""Processes that read recordings, if nothing else is said."""

DatabaseOption = Annotated[
    str | None,
    typer.Option(
        envvar="ROBOTOUILLE_DATABASE",
        help="An SQLite file, or postgresql://USER@HOST/NAME; DIR/catalogue.sqlite if not given.",
    ),
]
FolderOption = Annotated[
    Path, typer.Option("--folder", help="Recordings; their catalogue is brought up to date first.")
]
EXTRA = ("alembic", "matplotlib", "numpy", "polars", "psycopg", "pyarrow", "sqlalchemy")


@contextmanager
def errors_told() -> Iterator[None]:
    """Errors are told in a line, and end with status 1."""
    try:
        yield
    except RobotouilleError as error:
        fail(explain(error))
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in EXTRA:
            raise
        fail(explain(MissingExtraError("a catalogue of recordings", "data")))
    except BrokenPipeError:  # Whoever reads has read enough: nothing is told.
        raise
    except OSError as error:
        fail(printable(f"{error.filename}: {error.strerror}"))
    except KeyboardInterrupt:
        fail("interrupted", 130)


def catalogue(database: str | None, folder: Path) -> URL:
    """The catalogue that a command reads: a folder's, which is brought up to date first, or that
    of a database that is named, as it is.

    What has changed is told on standard error; so is why a catalogue that is there cannot be
    written, and then it is taken as it is.

    Raises:
        UnavailableError: There is no catalogue of the folder yet, and none can be made.
        CatalogueError: The database's URL is none, the folder has no recordings, or its catalogue
            is of a later version.
    """
    from robotouille_data.database import database_url
    from robotouille_data.errors import CatalogueError, UnavailableError
    from robotouille_data.indexing import has_recordings, index

    url = database_url(database, folder)
    if database is not None:
        return url
    known = Path(url.database or "").is_file()
    if not known and not has_recordings(folder):
        raise CatalogueError(
            f"{folder}: there is no catalogue, and no recording to make one of:"
            " --folder says where they are, or --database"
        )
    try:
        with progress_bar("recordings") as progress:
            found = index(url, [folder], jobs=JOBS, progress=progress)
    except UnavailableError as error:
        if not known:
            raise
        tell(printable(f"not brought up to date: {error}"), err=True)
        return url
    for path, fault in found.faults.items():
        tell(printable(f"{path}: {fault}"), err=True)
    if found.indexed or found.forgotten:
        tell(f"indexed {found.indexed}, forgotten {found.forgotten}", err=True)
    return url
