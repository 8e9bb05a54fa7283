"""The operator's port: an HTTP server in the game server's event loop."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import ssl
from collections.abc import AsyncIterator, Callable, Collection, Iterable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille_server.admin.http.connection_slots import ConnectionSlots
from robotouille_server.admin.http.guard import Access, Gate, is_loopback
from robotouille_server.admin.http.logins import LoginAudit
from robotouille_server.admin.http.timeouts import KEEP_ALIVE_SECONDS
from robotouille_server.app import CannotListenError, Server
from robotouille_server.auth import RoleGrant
from robotouille_server.runtime.logs import get_logger

if TYPE_CHECKING:
    from robotouille_server.admin.http.event_streams import Streams

__all__ = ["OperatorPort", "openapi", "operator_view", "require_operator"]

BACKLOG = 32
"""Connections that the system completes before they are accepted: they are, at once."""
CLOSE_SECONDS = 3
TICK_SECONDS = 1.0


@dataclass(frozen=True)
class OperatorPort:
    """Where the operator's page is."""

    host: str
    port: int
    secure: bool

    @property
    def url(self) -> str:
        """The page's address, seen from this machine."""
        host = "127.0.0.1" if self.host in ("0.0.0.0", "::") else self.host  # noqa: S104
        return f"http{'s' * self.secure}://{f'[{host}]' if ':' in host else host}:{self.port}/"


def require_operator() -> None:
    """MissingExtraError, with the line that installs them, where the libraries are missing."""
    try:
        import fastapi  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError:
        raise MissingExtraError("the operator's view", "operator") from None


def openapi() -> dict[str, Any]:
    """The API's OpenAPI document, for docs/openapi.json."""
    require_operator()
    from robotouille_server.admin.http.api import document

    return document()


@asynccontextmanager
async def operator_view(
    server: Server,
    host: str = "127.0.0.1",
    port: int = 8766,
    *,
    authorize: Callable[[str], RoleGrant] | None = None,
    ask_token: bool = False,
    allowed_hosts: Collection[str] = (),
    tls: ssl.SSLContext | None = None,
) -> AsyncIterator[OperatorPort]:
    """The operator's page and API of a running server, until the block is left.

    `authorize` says what an operator's token grants, and raises ProtocolError for any other;
    every request needs one if `host` is not loopback or `ask_token` is set. `allowed_hosts` are
    names by which a browser may call this port, beside loopback's. `port` 0 takes a free one.
    """
    require_operator()
    access = _access(host, authorize, ask_token, allowed_hosts)
    listening = _listen(host, port)
    try:
        async with _served(server, access, listening, tls):
            where = OperatorPort(host, listening.getsockname()[1], tls is not None)
            get_logger().info("operator's view", url=where.url, token=access.always)
            yield where
    finally:
        listening.close()


def _access(
    host: str,
    authorize: Callable[[str], RoleGrant] | None,
    ask_token: bool,
    allowed_hosts: Collection[str],
) -> Access:
    always = ask_token or not is_loopback(host)
    if always and authorize is None:
        raise RobotouilleError(
            f"the operator's view on {host} needs operator's tokens; "
            "give the server keys, or let it listen on 127.0.0.1"
        )
    from robotouille_server.admin.http.assets import page_paths

    names = frozenset(name.lower() for name in allowed_hosts)
    return Access(authorize, always, names, page_paths())


def _listen(host: str, port: int) -> socket.socket:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listening = socket.socket(family, kind, protocol)
        try:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.setblocking(False)
            listening.bind(address)
            listening.listen(BACKLOG)
        except OSError:
            listening.close()
            raise
    except OSError as error:
        message = f"the operator's view cannot listen on {host}:{port}: {error.strerror}"
        raise CannotListenError(message) from None
    return listening


@asynccontextmanager
async def _served(
    server: Server, access: Access, listening: socket.socket, tls: ssl.SSLContext | None
) -> AsyncIterator[None]:
    from robotouille_server.admin.admin_service import AdminService
    from robotouille_server.admin.http.api import application
    from robotouille_server.admin.http.event_streams import Streams

    now = asyncio.get_running_loop().time
    service, streams = AdminService(server, now), Streams()
    logins = LoginAudit(server.audit, now, addresses=server.settings.record_addresses)
    http = _http_server(Gate(application(service, streams), access, logins))
    ticks = (service.tick, logins.tick)
    tasks = [
        asyncio.create_task(_tick(ticks, streams), name="operator's figures"),
        asyncio.create_task(http.serve(sockets=[]), name="operator's port"),
    ]
    async with _accepting(http, listening, tls) as accepting:
        try:
            yield
        finally:
            accepting.close()
            streams.stop()
            http.should_exit = True
            await asyncio.wait(tasks, timeout=2 * CLOSE_SECONDS)
            for task in tasks:
                task.cancel()
            for problem in await asyncio.gather(*tasks, return_exceptions=True):
                if isinstance(problem, Exception):
                    get_logger().error("the operator's view failed", exc_info=problem)
            logins.finish()


@asynccontextmanager
async def _accepting(
    http: Any, listening: socket.socket, tls: ssl.SSLContext | None
) -> AsyncIterator[asyncio.Server]:
    """Hand all that connects to the HTTP server: it accepts nobody by itself, since it would
    neither count nor time connections before their first request."""
    from robotouille_server.admin.http.http_port import HttpPort

    slots, opening = ConnectionSlots(), set[asyncio.Task[None]]()

    def connection_factory() -> asyncio.Protocol:
        return HttpPort(http.config, http.server_state, slots, tls, opening)

    loop = asyncio.get_running_loop()
    accepting = await loop.create_server(connection_factory, sock=listening, backlog=BACKLOG)
    try:
        yield accepting
    finally:
        accepting.close()
        slots.clear()
        for task in list(opening):
            task.cancel()
        await asyncio.gather(*opening, return_exceptions=True)


async def _tick(ticks: Iterable[Callable[[], None]], streams: Streams) -> None:
    while not await streams.stopped_within(TICK_SECONDS):
        for tick in ticks:
            try:
                tick()
            except Exception:
                get_logger().exception("the operator's view failed")


def _http_server(app: Any) -> Any:
    """A uvicorn server that leaves signals, and accepting connections, to the program."""
    import uvicorn

    # What fails is logged by the API itself.
    logging.getLogger("uvicorn").setLevel(logging.CRITICAL)

    class Quiet(uvicorn.Server):
        @contextlib.contextmanager
        def capture_signals(self) -> Iterator[None]:
            yield

    config = uvicorn.Config(
        app,
        loop="none",
        http="h11",
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        timeout_keep_alive=KEEP_ALIVE_SECONDS,
        timeout_graceful_shutdown=CLOSE_SECONDS,
    )
    config.load()
    return Quiet(config)
