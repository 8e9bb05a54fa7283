"""What all commands share: how they fail, how a server is named, and what NAME=VALUE is; progress
on the terminal, and a seat that outlives them, are modules beside this."""

from __future__ import annotations

import functools
import math
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Annotated, NoReturn, ParamSpec

import typer

from robotouille.errors import FileError, ProtocolError, RobotouilleError
from robotouille.program import printable, quoted, tell

if TYPE_CHECKING:
    from robotouille.domain.task import Task

__all__ = [
    "SERVER_HOST",
    "SERVER_PORT",
    "HostOption",
    "LenientOption",
    "PortOption",
    "RenderingOption",
    "TokenOption",
    "UrlOption",
    "check_look",
    "explain",
    "fail",
    "failing",
    "finite",
    "interruptible",
    "name_and_value",
    "server_url",
    "terminable",
    "unicode",
]

P = ParamSpec("P")

SERVER_HOST, SERVER_PORT = "127.0.0.1", 8765
"""Where a server is that nobody has told to be anywhere else."""
INTERRUPTED = 130
"""The exit status after Ctrl+C, as shells have it."""

UrlOption = Annotated[
    str | None, typer.Option(help="The server's URL, instead of its host and port.")
]
HostOption = Annotated[str, typer.Option(help="The server's host.")]
PortOption = Annotated[int, typer.Option(help="The server's port.")]

TokenOption = Annotated[
    str | None,
    typer.Option(
        "--token",
        envvar="ROBOTOUILLE_TOKEN",
        help="A signed role token, where the server asks for one.",
    ),
]

RenderingOption = Annotated[
    str,
    typer.Option(help="What the kitchen looks like, by the name of a rendering, e.g. chalk."),
]

LenientOption = Annotated[
    bool,
    typer.Option(help="Draw tiles with names in place of the pictures that are missing."),
]


def check_look(task: Task | None, rendering: str, lenient: bool) -> None:
    """Print all that is wrong with how things are going to look, and exit; what is only missing
    is for `lenient` to be drawn otherwise.

    Raises:
        RobotouilleError: There is no such rendering, or one cannot be used at all.
    """
    from robotouille.world.lint import lint_look

    errors = lint_look(task, rendering)
    if errors and not lenient:
        lines = "\n".join(map(str, errors))
        fail(f"{lines}\n--lenient draws tiles with names in place of what is missing")


def explain(error: Exception) -> str:
    """An error in words, on one line (those of a file: a line for each); of a value that a schema
    refuses, what it was for."""
    if isinstance(error, ProtocolError):
        return printable(error.message)
    if isinstance(error, FileError):
        return str(error)
    from pydantic import ValidationError

    if not isinstance(error, ValidationError):
        return printable(str(error.args[0]) if isinstance(error, KeyError) else str(error))
    first = error.errors()[0]
    field = ".".join(str(part) for part in first["loc"])
    return f"{field}: {first['msg']}, found {first['input']!r}"


def finite(value: float | None) -> float | None:
    """An option's number, which is no infinity and no NaN: bounds do not keep out the latter."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is no finite number")
    return value


def unicode(value: str | None) -> str | None:
    """An option's words, which can be sent: bytes of a command line need not be UTF-8."""
    try:
        (value or "").encode()
    except UnicodeEncodeError:
        raise typer.BadParameter(f"{value!r} is no UTF-8") from None
    return value


def fail(message: str, status: int = 1) -> NoReturn:
    """Print an error to stderr and exit."""
    tell(message, err=True)
    raise typer.Exit(status)


def failing(command: Callable[P, None]) -> Callable[P, None]:
    """A command whose errors, and values that a schema refuses, are told in a line; the exit status
    is 1."""

    @functools.wraps(command)
    def guarded(*arguments: P.args, **options: P.kwargs) -> None:
        try:
            command(*arguments, **options)
        except _told() as error:
            fail(explain(error))

    return guarded


def _told() -> tuple[type[Exception], ...]:
    """The errors that are told in a line; the schemas' library is slow to load."""
    from pydantic import ValidationError

    return RobotouilleError, ValidationError


def interruptible(command: Callable[P, None]) -> Callable[P, None]:
    """A command that Ctrl+C ends without a word."""

    @functools.wraps(command)
    def guarded(*arguments: P.args, **options: P.kwargs) -> None:
        try:
            command(*arguments, **options)
        except KeyboardInterrupt:
            raise typer.Exit(INTERRUPTED) from None

    return guarded


@contextmanager
def terminable() -> Iterator[None]:
    """SIGTERM interrupts as Ctrl+C does, so that what has been begun is brought to an end."""

    def interrupt(number: int, frame: FrameType | None) -> NoReturn:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def name_and_value(text: str, option: str) -> tuple[str, str]:
    """What an option says of a name, as `condition=a`.

    Raises:
        RobotouilleError: It is no NAME=VALUE.
    """
    name, _, value = text.partition("=")
    if not (name and value):
        raise RobotouilleError(f"{option} {quoted(text)}: write it as NAME=VALUE")
    return name, value


def server_url(url: str | None, host: str, port: int) -> str:
    """The URL of a server: as given, or made of host and port.

    Raises:
        ConnectionFailedError: It is none.
    """
    from robotouille_client.sockets import server_uri

    if url is None:
        url = f"ws://{f'[{host}]' if ':' in host else host}:{port}"
    elif "://" not in url:
        url = f"ws://{url}"
    server_uri(url)
    return url
