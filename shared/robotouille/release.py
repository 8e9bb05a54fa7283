"""Which version of Robotouille this is, as every program says it."""

from __future__ import annotations

from importlib.metadata import version
from typing import Annotated

import typer

__all__ = ["RELEASE", "VersionOption"]

RELEASE = f"robotouille {version('robotouille')}"


def _tell(wanted: bool) -> None:
    if wanted:
        typer.echo(RELEASE)
        raise typer.Exit


VersionOption = Annotated[
    bool,
    typer.Option("--version", callback=_tell, is_eager=True, help="Say which version this is."),
]
