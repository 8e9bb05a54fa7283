"""`--version` option of the server's programs."""

from __future__ import annotations

from typing import Annotated

import typer

from robotouille.installation import RELEASE


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(RELEASE)
        raise typer.Exit


VersionOption = Annotated[
    bool,
    typer.Option(
        "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
    ),
]
