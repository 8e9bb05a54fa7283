"""Command `robotouille-server`. Every setting is a flag."""

from __future__ import annotations

import asyncio
import inspect
import os
import re
import signal
import socket
import tomllib
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from typing import TYPE_CHECKING, Annotated, Any

import typer
from pydantic import SecretStr, ValidationError
from pydantic_core import ErrorDetails, PydanticUndefined
from pydantic_settings import BaseSettings

from robotouille.errors import MissingExtraError, ProtocolError, RobotouilleError, did_you_mean
from robotouille.terminal import printable, tell, version_option
from robotouille_server.runtime.process_limits import rare_collections
from robotouille_server.runtime.settings import ServerSettings

if TYPE_CHECKING:
    from robotouille_server.app import Server
    from robotouille_server.cluster.joining import Cluster
    from robotouille_server.cluster.service import ClusterService
    from robotouille_server.rooms.room import Room
    from robotouille_server.runtime.workers import WorkerSlot

SECRET = (SecretStr, SecretStr | None)
"""Types of settings without a flag: all users of the machine can read command lines."""
PROGRAM = "robotouille-server"
NOT_A = {
    "float_parsing": "a number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_parsing": "true or false",
}
"""Expected values, by pydantic's type of error."""
SERVER = "<server>"
"""Owner of the episode that the server opens at startup."""


def _flags(model: type[BaseSettings], run: Callable[[BaseSettings], None]) -> Callable[..., None]:
    """Return a command with one option for each field of a settings model."""

    def command(**given: Any) -> None:
        given.pop("version")
        values = {name: value for name, value in given.items() if value is not None}
        run(_settings(model, values))

    by_name = inspect.Parameter.KEYWORD_ONLY
    version = Annotated[bool, version_option()]
    parameters = [inspect.Parameter("version", by_name, default=False, annotation=version)]
    for name, field in model.model_fields.items():
        if field.annotation in SECRET:
            continue
        default = "" if field.default is PydanticUndefined else field.default
        flag = f"--{name.replace('_', '-')}"
        option = typer.Option(
            f"{flag}/--no-{flag[2:]}" if field.annotation is bool else flag,
            help=f"{field.description} (default: {_shown(default)})",
            show_default=False,
        )
        kind: Any = bool if field.annotation is bool else str
        annotation = Annotated[kind | None, option]
        parameter = inspect.Parameter(name, by_name, default=None, annotation=annotation)
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
            _complain(_complaint(model, name, fault, values))
    except RecursionError:
        _complain(f"{_config(values)}: values are nested too deeply")
    except tomllib.TOMLDecodeError as error:
        _complain(f"{_config(values)}: {error}")
    except (OSError, ValueError) as error:
        _complain(f"--config: {error}")
    raise typer.Exit(2)


def _complain(message: str) -> None:
    tell(printable(f"{PROGRAM}: {message}"), err=True)


def _complaint(
    model: type[BaseSettings], name: str, fault: ErrorDetails, values: dict[str, Any]
) -> str:
    """Return an error about a setting, which is named as the user has written it."""
    file = _config(values)
    if isinstance(fault["input"], dict):
        return (
            f"{file}: unknown table {name!r}; write settings at the top level, such as port = 8765"
        )
    if name not in model.model_fields:
        return f"{file}: unknown setting {name!r}{did_you_mean(name, model.model_fields)}"
    where = f"--{name.replace('_', '-')}"
    variable = f"ROBOTOUILLE_{name.upper()}"
    if name not in values and variable in os.environ:
        where = variable
    elif name not in values and file:
        where = f"{file}: {name}"
    if fault["type"] in ("enum", "literal_error"):
        possible = re.findall("'([^']*)'", fault["ctx"]["expected"])
        near = did_you_mean(fault["input"], possible)
        return f"{where}: unknown value {fault['input']!r}{near} (possible: {', '.join(possible)})"
    if what := NOT_A.get(fault["type"]):
        return f"{where}: {fault['input']!r} is not {what}"
    wrong = fault["msg"].removeprefix("Value error, ")
    return f"{where}: {wrong}, found {fault['input']!r}"


def _config(values: dict[str, Any]) -> str:
    return str(values.get("config") or os.environ.get("ROBOTOUILLE_CONFIG") or "")


def run(settings: BaseSettings) -> None:
    """Serve until SIGINT or SIGTERM; exit status 1 if the server cannot start."""
    from robotouille_server.app import CannotListenError
    from robotouille_server.runtime.logs import configure_logs
    from robotouille_server.runtime.process_limits import raise_limit
    from robotouille_server.runtime.workers import supervise, this_worker

    if not isinstance(settings, ServerSettings):
        raise TypeError("not the server's settings")
    configure_logs(settings.log_level, settings.log_format)
    raise_limit(settings)
    try:
        _check_task(settings)
        worker = this_worker(settings)
        if settings.workers > 1 and worker is None:
            raise typer.Exit(supervise(settings))
        asyncio.run(serve_until_stopped(settings, worker))
    except RobotouilleError as error:
        message = error.message if isinstance(error, ProtocolError) else str(error)
        tell(f"{PROGRAM}: {message}", err=True)
        raise typer.Exit(1 if isinstance(error, CannotListenError) else 2) from None


def _check_task(settings: ServerSettings) -> None:
    """Check that the task of new episodes exists, before any client connects."""
    from robotouille import load_task
    from robotouille_server.runtime.task_folder import read_task_folder

    timing = settings.timing_for(settings.mode)
    own = None
    if settings.tasks is not None:
        folder = read_task_folder(settings.tasks)
        own = folder.load(settings.task, settings.seats, timing, settings.seed)
    try:
        if own is None:
            load_task(settings.task, seats=settings.seats, timing=timing, seed=settings.seed)
    except RobotouilleError as error:
        raise RobotouilleError(f"--task: {error}") from None


async def serve_until_stopped(settings: ServerSettings, worker: WorkerSlot | None = None) -> None:
    """Serve until a signal.

    SIGINT ends all episodes. SIGTERM lets them finish for a while and leaves the others to the next
    process; a second signal does that at once.
    """
    from robotouille_server.app import Surroundings, serve
    from robotouille_server.runtime.stray_errors import StrayErrors

    signals: asyncio.Queue[signal.Signals] = asyncio.Queue()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, signals.put_nowait, number)
    async with AsyncExitStack() as stack:
        around = Surroundings(worker=worker) if worker else None
        cluster = await stack.enter_async_context(_cluster(settings))
        if cluster is not None:
            around = cluster.around
        server = await stack.enter_async_context(serve(settings, around))
        stack.enter_context(StrayErrors(loop.time, server.metrics).logged(loop))
        service = None
        if cluster is not None:
            service = await stack.enter_async_context(cluster.serving(server))
        operator = await stack.enter_async_context(_operator(server))
        await stack.enter_async_context(_broker(server))
        collections = rare_collections(lambda: server.open_count, lambda: server.closed_count)
        await stack.enter_async_context(collections)
        if service is not None:
            tell(_greeting(server, await _first_of_cluster(service), operator))
        elif worker is None or worker.index == 0:
            restored = len(server.lobby.rooms)
            tell(_greeting(server, first_room(server), operator, restored))
        if await signals.get() is signal.SIGTERM:
            if cluster is not None:
                await cluster.node.leave()
            await _drain(server, signals)
            await server.stop("the server is restarted", hand_over=True)
        else:
            await server.stop()


@asynccontextmanager
async def _cluster(settings: ServerSettings) -> AsyncIterator[Cluster | None]:
    """Join a cluster, if the settings name one."""
    if not settings.cluster:
        yield None
        return
    try:
        import cryptography  # noqa: F401
        import nats  # noqa: F401
    except ImportError:
        raise MissingExtraError("--cluster", "cluster") from None
    from robotouille_server.cluster.joining import joined

    if settings.operator:
        # These imports take seconds, in which a member of the cluster would answer no other.
        with suppress(ImportError):
            import uvicorn  # noqa: F401

            import robotouille_server.operator.api  # noqa: F401
    async with joined(settings) as cluster:
        yield cluster


async def _first_of_cluster(service: ClusterService) -> Room | None:
    """Open the server's own episode, if the cluster has no episode."""
    from robotouille.protocol import messages
    from robotouille_server.requests import Opening
    from robotouille_server.runtime.logs import get_logger

    if len(service.node.directory):
        return None
    try:
        created = await service.create(Opening(request=messages.Create(), owner=SERVER))
    except ProtocolError as error:
        # This is no reason to stop: clients open episodes when the cluster answers again.
        get_logger().error("first episode not opened", reason=error.message)
        return None
    return service.services.lobby.rooms.get(created.episode)


@asynccontextmanager
async def _operator(server: Server) -> AsyncIterator[str]:
    """Serve the operator page; yield its address, or an empty string without one."""
    from robotouille_server.app import CannotListenError
    from robotouille_server.operator import operator_view
    from robotouille_server.runtime.logs import get_logger

    settings = server.settings
    stack = AsyncExitStack()
    try:
        view = operator_view(
            server,
            settings.operator_host,
            _operator_port(server),
            authorize=server.authorize,
            ask_token=settings.require_token,
            allowed_hosts=[name for name in settings.operator_names.split(",") if name.strip()],
            tls=server.tls,
        )
        url = (await stack.enter_async_context(view)).url if settings.operator else ""
    except (CannotListenError, MissingExtraError) as error:
        if settings.operator_port is not None:
            raise
        get_logger().warning("no operator page", reason=str(error))
        url = ""
    async with stack:
        yield url


@asynccontextmanager
async def _broker(server: Server) -> AsyncIterator[None]:
    """Connect the server to its MQTT broker, if the settings name one."""
    if not server.settings.mqtt:
        yield
        return
    try:
        import aiomqtt  # noqa: F401
    except ImportError:
        raise MissingExtraError("--mqtt", "mqtt") from None
    from robotouille_server.mqtt.service import on_broker

    async with on_broker(server):
        yield


def _operator_port(server: Server) -> int:
    """Return the port that is set, or the first one after the server's own ports."""
    settings, worker = server.settings, server.worker
    if settings.operator_port is not None:
        return settings.operator_port + (worker.index if settings.operator_port else 0)
    if settings.port == 0:
        return 0
    return settings.port + 1 + (worker.count + worker.index if worker.count > 1 else 0)


async def _drain(server: Server, signals: asyncio.Queue[signal.Signals]) -> None:
    draining = asyncio.ensure_future(server.drain(server.settings.drain_seconds))
    second = asyncio.ensure_future(signals.get())
    await asyncio.wait({draining, second}, return_when=asyncio.FIRST_COMPLETED)
    for task in (draining, second):
        task.cancel()


def first_room(server: Server) -> Room | None:
    """Return the room of the server's own episode: a new one, or the one from before a restart.

    Return None if it cannot be recorded, or if all restored episodes belong to others. Their codes
    must not be printed.
    """
    from robotouille.protocol import messages

    live = [r for r in server.lobby.rooms.values() if not r.episode.ended]
    if live:
        own = (room for room in live if room.owner == SERVER)
        return min(own, key=lambda room: room.episode.step, default=None)
    from robotouille_server.runtime.logs import get_logger

    try:
        return server.lobby.create(messages.Create(), owner=SERVER)
    except ProtocolError as error:
        if error.code not in ("server/recording", "server/full"):
            raise
        get_logger().error("first episode not opened", reason=error.message)
        return None


def _greeting(server: Server, room: Room | None, operator: str, restored: int = 0) -> str:
    """Return the text to print at startup; `restored` counts the episodes from before."""
    settings = server.settings
    lines = (
        [f"Robotouille is serving at {server.public_url}"]
        if room is None
        else _invitation(server, room)
    )
    if operator:
        lines.append(f"  operator page:  {operator}")
        lines.append("  several games:  the button Open episodes on the operator page")
    if settings.is_local:
        lines.append("  only programs on this machine can connect; --host 0.0.0.0 admits others")
    if restored:
        earlier = f"{restored} earlier episode{'s' * (restored > 1)}"
        lines.append(f"  continuing {earlier}, so no new one was opened;")
        lines.append("  for a fresh start use another --recordings folder")
    return "\n".join([*lines, "  stop:   Ctrl+C"])


def _invitation(server: Server, room: Room) -> list[str]:
    address = server.public_url
    url = f" --url {address}" if address != "ws://127.0.0.1:8765" else ""
    token = " --token TOKEN" if server.settings.require_token else ""
    clock, seats = room.episode.rules.clock.value, len(room.world.players)
    there = f"{room.code}{url}{token}"
    entries = [
        f"  play:   robotouille-client {there}",
        f"  a bot:  robotouille-bot planner --episode {there}",
        *_page(server, room),
    ]
    if room.episode.rules.limited_sight is not None:
        entries = [
            "  players see a part of the kitchen, so only language models and own programs play:",
            f"          robotouille-bot llm --model MODEL --episode {there}",
            f"  watch:  robotouille-client {there} --watch",
        ]
    return [
        f"Robotouille is serving {room.world.task.name} ({clock}) at {address}",
        f"  for {seats} player{'s' * (seats > 1)}, the kitchen's code is {room.code}",
        _validity(room),
        f"  another game:  robotouille-client --create TASK{url}{token}",
        *entries,
        *_for_others(server, room, token),
    ]


def _page(server: Server, room: Room) -> list[str]:
    """Return the link for browsers. With `require_token`, each person needs a personal link."""
    page = server.listener.page_url
    if not page or server.settings.require_token:
        return []
    return [f"  in a browser:  {page}#{room.code}"]


def _validity(room: Room) -> str:
    """Return how long the code of an episode without players is valid."""
    from robotouille.episode.presence import LOBBY_SECONDS

    minutes = round(max(room.episode.rules.grace, LOBBY_SECONDS) / 60)
    return f"  it closes after {minutes} minutes without players"


def _for_others(server: Server, room: Room, token: str) -> list[str]:
    """Return how to connect from another machine, if that is possible."""
    if server.settings.host not in ("0.0.0.0", "::") or server.public_url != server.url:  # noqa: S104
        return []
    scheme = server.url.partition(":")[0]
    url = f"{scheme}://{socket.gethostname()}:{server.port}"
    return [f"  from other machines:  robotouille-client {room.code} --url {url}{token}"]


def main() -> None:
    """Run `robotouille-server`."""
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    help_text = (
        "Serve Robotouille episodes over WebSocket. "
        "Environment variables ROBOTOUILLE_<SETTING> set the same options."
    )
    app.command(help=help_text)(_flags(ServerSettings, run))
    app()


if __name__ == "__main__":
    main()
