"""`robotouille-server`: every setting is a flag."""

from __future__ import annotations

import asyncio
import inspect
import signal
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer
from pydantic import ValidationError
from pydantic_core import PydanticUndefined
from pydantic_settings import BaseSettings

from robotouille.errors import RobotouilleError
from robotouille.protocol import messages
from robotouille_server.settings import ServerSettings

__all__ = ["main", "run"]


def _flags(model: type[BaseSettings], run: Callable[[BaseSettings], None]) -> Callable[..., None]:
    """A command with one option for each field of a settings model."""

    def command(**given: Any) -> None:
        values = {name: value for name, value in given.items() if value is not None}
        run(_settings(model, values))

    parameters = []
    for name, field in model.model_fields.items():
        default = "" if field.default is PydanticUndefined else field.default
        flag = f"--{name.replace('_', '-')}"
        option = typer.Option(
            f"{flag}/--no-{name}" if field.annotation is bool else flag,
            help=f"{field.description} (default: {_shown(default)})",
            show_default=False,
        )
        kind: Any = bool if field.annotation is bool else str
        annotation = Annotated[kind | None, option]
        parameter = inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation
        )
        parameters.append(parameter)
    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return command


def _shown(default: Any) -> str:
    if default is None or isinstance(default, bool):
        return {None: "none", True: "yes", False: "no"}[default]
    return str(getattr(default, "value", default))


def _settings(model: type[BaseSettings], values: dict[str, Any]) -> BaseSettings:
    try:
        return model(**values)
    except ValidationError as error:
        for fault in error.errors():
            name = ".".join(str(part) for part in fault["loc"])
            flag = f"--{name.replace('_', '-')}"
            print(f"{flag}: {fault['msg']}, found {fault['input']!r}", file=sys.stderr)
    except (OSError, ValueError) as error:
        print(f"--config: {error}", file=sys.stderr)
    raise typer.Exit(2)


def run(settings: BaseSettings) -> None:
    """Serve until SIGINT or SIGTERM; exit status 1 if the server cannot start."""
    from robotouille_server.app import CannotListenError
    from robotouille_server.logs import configure_logs

    if not isinstance(settings, ServerSettings):
        raise TypeError("not the server's settings")
    configure_logs(settings.log_level, settings.log_format)
    try:
        asyncio.run(_serve(settings))
    except RobotouilleError as error:
        print(f"robotouille-server: {error}", file=sys.stderr)
        raise typer.Exit(1 if isinstance(error, CannotListenError) else 2) from None


async def _serve(settings: ServerSettings) -> None:
    from robotouille_server.app import serve

    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for signal_number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(signal_number, stop.set)
    async with serve(settings) as server:
        room = server.lobby.create(messages.Create(), loop.time())
        url = f" --url {server.url}" if server.port != 8765 else ""
        print(
            f"Robotouille is serving {room.world.task.name} ({settings.mode.value}) "
            f"at {server.url}\n"
            f"  the kitchen's code is {room.code}; "
            f"{len(room.world.players)} seat{'s' * (len(room.world.players) > 1)}\n"
            f"  play:   robotouille-client {room.code}{url}\n"
            f"  a bot:  robotouille-bot planner --episode {room.code}{url}\n"
            f"  stop:   Ctrl+C",
            flush=True,
        )
        await stop.wait()


def main() -> None:
    """The entry point of `robotouille-server`."""
    app = typer.Typer(add_completion=False, rich_markup_mode="rich")
    help_text = "Serve Robotouille episodes over WebSocket. Environment: ROBOTOUILLE_<SETTING>."
    app.command(help=help_text)(_flags(ServerSettings, run))
    app()
