"""Options, errors and signals that all commands share.

Progress bars and the seats that outlive a process are in the submodules.
"""

from __future__ import annotations

import functools
import math
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, NoReturn, ParamSpec

import typer

from robotouille.errors import FileError, ProtocolError, RobotouilleError
from robotouille.terminal import printable, quoted, tell, version_option

if TYPE_CHECKING:
    from robotouille.domain.task import Task

__all__ = [
    "SERVER_HOST",
    "SERVER_PORT",
    "HostOption",
    "JsonOption",
    "LenientOption",
    "PortOption",
    "RenderingOption",
    "ServerOptions",
    "TokenOption",
    "UrlOption",
    "VersionOption",
    "check_look",
    "explain",
    "fail",
    "failing",
    "finite",
    "folder",
    "interruptible",
    "name_and_value",
    "server_url",
    "terminable",
    "unicode",
]


VersionOption = Annotated[bool, version_option()]

P = ParamSpec("P")

SERVER_HOST, SERVER_PORT = "127.0.0.1", 8765
"""The default address of a server."""
INTERRUPTED = 130
"""Exit status after Ctrl+C, as in shells."""

UrlOption = Annotated[
    str | None,
    typer.Option(
        help="URL of the server, or several URLs of its nodes with commas between them. Replaces "
        "--host and --port."
    ),
]
HostOption = Annotated[str, typer.Option(help="Host of the server.")]
PortOption = Annotated[int, typer.Option(help="Port of the server.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]

TokenOption = Annotated[
    str | None,
    typer.Option(
        "--token",
        envvar="ROBOTOUILLE_TOKEN",
        help="Signed role token, if the server requires one.",
    ),
]

RenderingOption = Annotated[
    str, typer.Option(help="Name of the rendering that draws the kitchen, such as chalk.")
]

LenientOption = Annotated[
    bool, typer.Option(help="Draw tiles with names in place of missing pictures.")
]


@dataclass(frozen=True, kw_only=True)
class ServerOptions:
    """The address of a server and the token for it, as command-line options."""

    url: UrlOption = None
    host: HostOption = SERVER_HOST
    port: PortOption = SERVER_PORT
    token: TokenOption = None

    @property
    def address(self) -> str:
        """The checked URL of the server."""
        return server_url(self.url, self.host, self.port)


def check_look(task: Task | None, rendering: str, lenient: bool) -> None:
    """Print all faults of a task's pictures and exit, or ignore missing pictures if `lenient`.

    Raises:
        RobotouilleError: The rendering is unknown or unusable.
    """
    from robotouille.world.lint_renderings import lint_look

    errors = lint_look(task, rendering)
    if errors and not lenient:
        lines = "\n".join(map(str, errors))
        fail(f"{lines}\nUse --lenient to draw tiles with names in place of missing pictures")


def explain(error: Exception) -> str:
    """Return an error's message on one line; faults of a file have one line each."""
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
    """Reject infinity and NaN as the value of an option."""
    if value is not None and not math.isfinite(value):  # `min` and `max` let NaN through.
        raise typer.BadParameter(f"{value} is not a finite number")
    return value


def folder(value: Path | None) -> Path | None:
    """Reject the path of a folder that does not exist as the value of an option."""
    try:
        missing = value is not None and not value.is_dir()
    except OSError as error:  # For example, a name of 300 letters.
        raise typer.BadParameter(f"{printable(str(value))}: {error.strerror}") from None
    if missing:
        raise typer.BadParameter(f"no folder {printable(str(value))}")
    return value


def unicode(value: str | None) -> str | None:
    """Reject text that cannot be sent: the bytes of a command line need not be UTF-8."""
    try:
        (value or "").encode()
    except UnicodeEncodeError:
        raise typer.BadParameter(f"{value!r} is not valid UTF-8") from None
    return value


def fail(message: str, status: int = 1) -> NoReturn:
    """Print an error to stderr and exit."""
    tell(message, err=True)
    raise typer.Exit(status)


def failing(command: Callable[P, None]) -> Callable[P, None]:
    """Return the command, which now prints its errors on one line and exits with status 1."""

    @functools.wraps(command)
    def guarded(*arguments: P.args, **options: P.kwargs) -> None:
        try:
            command(*arguments, **options)
        except BrokenPipeError:
            raise  # The reader of the output has gone, which ends the command silently.
        except _expected_errors() as error:
            # The lines of the user's own code that raised, if any: see `OwnPolicyError`.
            if frames := getattr(error, "frames", ""):
                tell(frames, err=True)
            fail(explain(error))

    return guarded


def _expected_errors() -> tuple[type[Exception], ...]:
    from pydantic import ValidationError  # Imported late: pydantic is slow to load.

    return RobotouilleError, ValidationError, OSError


def interruptible(command: Callable[P, None]) -> Callable[P, None]:
    """Return the command, which Ctrl+C now ends without a traceback."""

    @functools.wraps(command)
    def guarded(*arguments: P.args, **options: P.kwargs) -> None:
        try:
            command(*arguments, **options)
        except KeyboardInterrupt:
            raise typer.Exit(INTERRUPTED) from None

    return guarded


@contextmanager
def terminable() -> Iterator[None]:
    """Make SIGTERM interrupt like Ctrl+C, so that files are closed properly."""

    def interrupt(number: int, frame: FrameType | None) -> NoReturn:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def name_and_value(text: str, option: str) -> tuple[str, str]:
    """Split the NAME=VALUE of an option.

    Raises:
        RobotouilleError: The text is not NAME=VALUE.
    """
    name, _, value = text.partition("=")
    if not (name and value):
        raise RobotouilleError(f"{option} {quoted(text)}: expected NAME=VALUE")
    return name, value


def server_url(url: str | None, host: str, port: int) -> str:
    """Return the URL of a server: the given one, or one made of host and port.

    Several URLs, separated by commas, stay one text.

    Raises:
        ConnectionFailedError: A URL is invalid.
    """
    from robotouille_client.sansio.addresses import split_addresses
    from robotouille_client.sockets import server_uri

    if url is None:
        url = f"{f'[{host}]' if ':' in host else host}:{port}"
    urls = [each if "://" in each else f"ws://{each}" for each in split_addresses(url)]
    for each in urls:
        server_uri(each)
    return ",".join(urls)
