"""What the commands of the catalogue share: options, and errors in a line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille.program import printable
from robotouille_client.console import explain, fail

__all__ = ["DatabaseOption", "FolderOption", "errors_told"]

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
