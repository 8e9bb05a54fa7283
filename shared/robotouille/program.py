"""What all programs have in common on their command lines."""

from __future__ import annotations

from typing import Annotated

import typer

from robotouille.release import RELEASE

__all__ = ["VersionOption"]


def _tell(wanted: bool) -> None:
    if wanted:
        typer.echo(RELEASE)
        raise typer.Exit


VersionOption = Annotated[
    bool,
    typer.Option("--version", callback=_tell, is_eager=True, help="Say which version this is."),
]
