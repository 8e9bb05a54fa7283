"""What the commands of the catalogue share: options, a bar, and errors in a line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.program import printable
from robotouille_client.console import explain, fail

__all__ = ["Bar", "DatabaseOption", "FolderOption", "bar", "errors_told"]

DatabaseOption = Annotated[
    str | None,
    typer.Option(
        envvar="ROBOTOUILLE_DATABASE",
        help="An SQLite file, or postgresql://USER@HOST/NAME; DIR/catalogue.sqlite if not given.",
    ),
]
FolderOption = Annotated[
    Path, typer.Option("--folder", help="The folder whose catalogue.sqlite is read.")
]
EXTRA = ("alembic", "matplotlib", "numpy", "polars", "psycopg", "pyarrow", "sqlalchemy")


class Bar:
    """How much is done, on a terminal."""

    def __init__(self, progress: Progress, what: str) -> None:
        self._progress = progress
        self._task = progress.add_task(what, total=None)

    def __call__(self, done: int, total: int) -> None:
        """Show it."""
        self._progress.update(self._task, completed=done, total=total)

    def stage(self, what: str, done: int, total: int) -> None:
        """Show it, of one thing after the other."""
        self._progress.update(self._task, description=what, completed=done, total=total)


@contextmanager
def bar(what: str) -> Iterator[Bar]:
    """A bar that counts something."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        yield Bar(progress, what)


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
    except OSError as error:
        fail(printable(f"{error.filename}: {error.strerror}"))
    except KeyboardInterrupt:
        fail("interrupted", 130)
