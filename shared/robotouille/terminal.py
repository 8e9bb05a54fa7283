"""Text for terminals and spreadsheets: safe output, and command options as one dataclass."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
import re
import sys
from collections.abc import Callable
from enum import StrEnum
from typing import Any, TypeVar, get_type_hints

from robotouille.errors import did_you_mean

E = TypeVar("E", bound=StrEnum)


def printable(text: str) -> str:
    """Return the text with control characters, line separators and direction marks replaced.

    Each of them (ESC, U+2028, U+202E, …) becomes U+FFFD, so that text from other people cannot
    control the terminal.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


def printable_json(text: str) -> str:
    """Return the JSON text with every character that `printable` replaces escaped."""
    lines = text.split("\n")
    return "\n".join(line if line.isprintable() else _escaped(line) for line in lines)


def quoted(text: str) -> str:
    """Return text from another person as one quoted line."""
    return printable_json(json.dumps(text, ensure_ascii=False))


_BLANK = (
    "\\x00-\\x20\\x7f-\u00a0\u00ad\u034f\u061c\u115f\u1160\u1680\u17b4\u17b5\u180b-\u180f"
    "\u2000-\u200f\u2028-\u202f\u205f-\u206f\u2800\u3000\u3164\ufe00-\ufe0f\ufeff\uffa0\ufff0-\ufffb"
    "\U000e0000-\U000e0fff"
)
"""Ranges of controls, spaces and characters without a width. Programs may trim or ignore them."""
# The characters after them are those that OWASP lists for CSV injection.
FORMULA = f"\\A(?:[{_BLANK}]*[=+\\-@\uff1d\uff0b\uff0d\uff20]|[\\t\\r\\n])"
"""Regular expression for texts that a spreadsheet may interpret as a formula."""


def spreadsheet_cell(text: str) -> str:
    """Return the text with an apostrophe before it if a spreadsheet may read it as a formula."""
    return f"'{text}" if re.match(FORMULA, text) else text


def csv_cell(text: str) -> str:
    """Return the text for a CSV file: inert, and with line feeds as the only line ends."""
    # Python's writer does not quote carriage returns, so readers would begin a new row at each.
    return spreadsheet_cell(re.sub(r"\r\n?", "\n", text))


def _escaped(line: str) -> str:
    return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in line)


def tell(text: str, *, err: bool = False, nl: bool = True) -> None:
    """Print text that is not JSON, on standard output or, with `err`, on standard error.

    Line feeds in `text` are kept. Apply `printable` first to text from a server or participant,
    so that it stays on one line.
    """
    lines = "\n".join(map(printable, text.split("\n")))
    print(lines, file=sys.stderr if err else sys.stdout, end="\n" if nl else "", flush=True)


def options_from(options: type[Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that turns the parameter `options` of a command into one flag per field.

    `options` is a dataclass whose fields are annotated like the parameters of a Typer command.
    Typer reads a command's parameters from its signature, so a command with twenty flags would
    otherwise need twenty parameters.
    """
    hints = get_type_hints(options, include_extras=True)
    fields = [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=_default(field),
            annotation=hints[field.name],
        )
        for field in dataclasses.fields(options)
    ]

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(command)
        def run(*args: Any, **kwargs: Any) -> Any:
            values = {each.name: kwargs.pop(each.name) for each in fields if each.name in kwargs}
            return command(*args, options=options(**values), **kwargs)

        own = inspect.signature(command, eval_str=True)
        kept = [each for name, each in own.parameters.items() if name != "options"]
        parameters = sorted([*kept, *fields], key=lambda each: each.kind)
        vars(run)["__signature__"] = own.replace(parameters=parameters)
        run.__annotations__ = {each.name: each.annotation for each in parameters}
        del run.__wrapped__  # Typer would read its signature.
        return run

    return decorate


def one_of(kind: type[E]) -> Callable[[str], E]:
    """Return a parser for Typer, which reads a value of an enumeration and suggests the nearest.

    Typer's own error has words of pydantic and no suggestion.
    """

    def parse(text: str) -> E:
        import typer  # Slow, and unused in processes that only print.

        if text in list(kind):
            return kind(text)
        known = [str(each) for each in kind]
        near = did_you_mean(text, known)
        raise typer.BadParameter(f"unknown value {text!r}{near} (possible: {', '.join(known)})")

    return parse


def version_option() -> Any:
    """Return Typer's option `--version`, which prints the release and ends the program."""
    import typer  # Slow, and unused in processes that only print.

    from robotouille.installation import RELEASE

    def show(wanted: bool) -> None:
        if wanted:
            typer.echo(RELEASE)
            raise typer.Exit

    description = "Print the version and exit."
    return typer.Option("--version", callback=show, is_eager=True, help=description)


def _default(field: dataclasses.Field[Any]) -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return inspect.Parameter.empty if field.default is dataclasses.MISSING else field.default
