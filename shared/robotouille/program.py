"""What all programs have in common on their command lines and terminals."""

from __future__ import annotations

import json
from typing import Annotated

import typer

__all__ = ["VersionOption", "printable", "printable_json", "quoted", "tell"]


def _tell(wanted: bool) -> None:
    if wanted:
        from robotouille.release import RELEASE

        typer.echo(RELEASE)
        raise typer.Exit


VersionOption = Annotated[
    bool,
    typer.Option("--version", callback=_tell, is_eager=True, help="Say which version this is."),
]


def printable(text: str) -> str:
    """One line in which each control character, line separator and mark of direction (ESC, U+2028,
    U+202E, …) is seen as U+FFFD: what others wrote must not steer a terminal."""
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


def printable_json(text: str) -> str:
    """The same JSON, with what `printable` would replace written as `\\u…`."""
    lines = text.split("\n")
    return "\n".join(line if line.isprintable() else _escaped(line) for line in lines)


def quoted(words: str) -> str:
    """Somebody else's words, in quotes and on one line: they cannot pass for ours."""
    return printable_json(json.dumps(words, ensure_ascii=False))


def _escaped(line: str) -> str:
    return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in line)


def tell(text: str, *, err: bool = False, nl: bool = True) -> None:
    """Print lines to a terminal: all that is not JSON goes through here, on standard output or,
    with `err`, on standard error.

    Line feeds are the caller's own: whoever takes words from a server or a participant makes one
    line of them first (`printable`).
    """
    typer.echo("\n".join(map(printable, text.split("\n"))), err=err, nl=nl)
