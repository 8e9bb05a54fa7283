"""Start and stop of the operator port, an HTTP server in the game server's event loop."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections.abc import AsyncIterator, Callable, Collection, Iterable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from robotouille.errors import MissingExtraError, RobotouilleError
from robotouille_server.app import CannotListenError, Server
from robotouille_server.auth import RoleGrant
from robotouille_server.operator.guard import Access, Guard, LoginAudit, is_loopback
from robotouille_server.operator.load import RequestRates, Turns
from robotouille_server.runtime.logs import get_logger
from robotouille_server.transport import ServerTLS

if TYPE_CHECKING:
    from robotouille_server.operator.event_streams import EventStreams

BACKLOG = 32
"""Connections that the kernel holds for the event loop, which accepts them at once."""
CLOSE_SECONDS = 3
TICK_SECONDS = 1.0


@dataclass(frozen=True)
class OperatorPort:
    """Address of the operator page."""

    host: str
    port: int
    secure: bool

    @property
    def url(self) -> str:
        """The page's address for a browser on this machine."""
        host = "127.0.0.1" if self.host in ("0.0.0.0", "::") else self.host  # noqa: S104
        return f"http{'s' * self.secure}://{f'[{host}]' if ':' in host else host}:{self.port}/"


def require_operator() -> None:
    """Raise MissingExtraError if the libraries of the operator page are not installed."""
    try:
        import fastapi  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError:
        raise MissingExtraError("the operator page", "operator") from None


def openapi() -> dict[str, Any]:
    """Return the API's OpenAPI document."""
    require_operator()
    from robotouille_server.operator.api import document

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
    tls: ServerTLS | None = None,
) -> AsyncIterator[OperatorPort]:
    """Serve the operator page and API of a running server until the block ends.

    Args:
        server: The running game server.
        host: Address to listen on.
        port: Port to listen on; 0 chooses a free one.
        authorize: Returns what an operator's token grants; raises ProtocolError for other tokens.
        ask_token: If true, requests from this machine need a token too. Requests to an address
            that is not loopback always need one.
        allowed_hosts: Names that a browser may use for this port, besides those of this machine.
        tls: Certificate and key, for HTTPS.
    """
    require_operator()
    access = _access(host, authorize, ask_token, allowed_hosts)
    listening = _listen(host, port)
    with contextlib.closing(listening):
        where = OperatorPort(host, listening.getsockname()[1], tls is not None)
        async with _served(server, access, listening, where, tls):
            get_logger().info("operator page", url=where.url, token=access.always)
            yield where


def _access(
    host: str,
    authorize: Callable[[str], RoleGrant] | None,
    ask_token: bool,
    allowed_hosts: Collection[str],
) -> Access:
    always = ask_token or not is_loopback(host)
    if always and authorize is None:
        raise RobotouilleError(
            f"the operator page on {host} needs operator tokens; "
            "start the server with a key file, or use the operator host 127.0.0.1"
        )
    from robotouille_server.operator.api import page_paths

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
            # Listen already here: browsers may connect as soon as the address is known.
            listening.listen(BACKLOG)
        except OSError:
            listening.close()
            raise
    except OSError as error:
        message = f"the operator page cannot listen on {host}:{port}: {error.strerror}"
        raise CannotListenError(message) from None
    return listening


@asynccontextmanager
async def _served(
    server: Server,
    access: Access,
    listening: socket.socket,
    where: OperatorPort,
    tls: ServerTLS | None,
) -> AsyncIterator[None]:
    from robotouille_server.operator.answering import answering
    from robotouille_server.operator.api import application
    from robotouille_server.operator.connections import ConnectionFactory, ConnectionSlots
    from robotouille_server.operator.event_streams import EventStreams
    from robotouille_server.operator.service import OperatorService

    now = asyncio.get_running_loop().time
    service, streams = OperatorService(server, now), EventStreams()
    logins = LoginAudit(server.audit, now, addresses=server.settings.record_addresses)
    slots = ConnectionSlots(now)
    connections = ConnectionFactory(slots, tls, server.admission.loop_budget)
    rates = RequestRates(now)
    app = application(service, streams, rates)
    refusals = Turns(server.admission.loop_budget, now)
    guard = Guard(app, access, logins, rates, service.turns, refusals)
    http = _http_server(guard, connections)
    ticks = (service.tick, logins.tick, slots.check)
    tasks = [
        asyncio.create_task(_tick(ticks, streams), name="operator port: ticks"),
        asyncio.create_task(http.serve(sockets=[listening]), name="operator port: HTTP"),
    ]
    try:
        async with answering(app, server, service.turns, where.url, tokens_only=access.always):
            yield
    finally:
        streams.stop()
        http.should_exit = True
        # uvicorn waits CLOSE_SECONDS for requests; leave it the time to give up by itself.
        await asyncio.wait(tasks, timeout=2 * CLOSE_SECONDS)
        for task in tasks:
            task.cancel()
        for problem in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(problem, Exception):
                get_logger().error("operator page failed", exc_info=problem)
        await connections.close()
        logins.finish()


async def _tick(ticks: Iterable[Callable[[], None]], streams: EventStreams) -> None:
    while not await streams.stopped_within(TICK_SECONDS):
        for tick in ticks:
            try:
                tick()
            except Exception:
                # The page is not worth an episode: keep the server and the other ticks running.
                get_logger().exception("operator page failed")


def _http_server(app: Any, connections: Any) -> Any:
    """Return a uvicorn server that leaves signals to the program."""
    # These imports need the extra `operator`, which is optional.
    import uvicorn

    from robotouille_server.operator.connections import KEEP_ALIVE_SECONDS

    # The API logs its failures itself.
    logging.getLogger("uvicorn").setLevel(logging.CRITICAL)

    class SignalFreeServer(uvicorn.Server):
        @contextlib.contextmanager
        def capture_signals(self) -> Iterator[None]:
            yield

    config = uvicorn.Config(
        app,
        loop="none",
        http=connections,
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        backlog=BACKLOG,
        timeout_keep_alive=KEEP_ALIVE_SECONDS,
        timeout_graceful_shutdown=CLOSE_SECONDS,
    )
    return SignalFreeServer(config)
